"""The reactive controller without a simulation: what it commands once the walk is over."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.control.contract import Reading, State
from jaxleg.control.reflex import reflex
from jaxleg.control.swing_leg import feeling, reflexes
from jaxleg.walk.build import build_walk
from jaxleg.walk.choices import no_choice
from tests.crawls import gait, open_site, planner_of, settings, terrain_of

DT = 0.0025


@pytest.fixture(scope="module")
def commands(pegasus):
    """Of a walk that ends standing with a shift of the trunk: its last pose, and the command so long after its end."""
    params = gait(step=0.16)
    planner = dataclasses.replace(planner_of(params, settings(bend=20.0)), standing=True)
    stations, none = planner.route.stations(params, None, 4), no_choice(1, jnp.asarray(0.0).dtype)
    walk = jax.jit(build_walk)(planner, pegasus, open_site(terrain_of("flat")), stations, none)
    controller = reflex(pegasus, walk, reflexes(pegasus), feeling(pegasus), jnp.asarray(DT))

    @jax.jit
    def after(phases, seconds):
        memory = controller.start()._replace(phase=phases, clock=seconds, held=walk.feet[-1])
        state = State(jnp.zeros(19).at[3].set(1.0), jnp.zeros(18))
        return controller.command(memory, Reading(state, walk.feet[-1], jnp.zeros((4, 3, 3))), None)[0]

    return walk, after


def test_after_the_last_shift_the_trunk_stays_where_it_has_come_to(commands):
    walk, after = commands
    count = int(np.sum(walk.used))
    assert np.abs(np.asarray(walk.phases.trunk_to - walk.phases.trunk_from))[count - 1].max() > 0.01
    ended = after(count, 0.0)
    within = after(count - 1, float(walk.phases.duration[count - 1]))
    np.testing.assert_allclose(ended.position, within.position, atol=1e-9)
    for seconds in (0.1, 1.0):
        late = after(count, seconds)
        np.testing.assert_allclose(late.position, ended.position, atol=1e-9)
        np.testing.assert_allclose(late.velocity, 0.0, atol=1e-9)
