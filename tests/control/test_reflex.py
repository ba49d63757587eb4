"""The reactive controller without a simulation: where its feet stand, and what it commands once the walk is over."""

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
NONE, NOWHERE = np.zeros(4, bool), np.zeros((4, 3))


@pytest.fixture(scope="module")
def commands(pegasus):
    """A walk that ends standing with a shift of the trunk; command and memory at a time of a phase, some feet just landed
    and all sensed so far off where they are held."""
    params = gait(step=0.16)
    planner = dataclasses.replace(planner_of(params, settings(bend=20.0)), standing=True)
    stations, none = planner.route.stations(params, None, 4), no_choice(1, jnp.asarray(0.0).dtype)
    walk = jax.jit(build_walk)(planner, pegasus, open_site(terrain_of("flat")), stations, none)
    controller = reflex(pegasus, walk, reflexes(pegasus), feeling(pegasus), jnp.asarray(DT))

    @jax.jit
    def at(phase, seconds, landed, off):
        memory = controller.start()._replace(phase=phase, clock=seconds, held=walk.feet[-1], landed=landed)
        state = State(jnp.zeros(19).at[3].set(1.0), jnp.zeros(18))
        return controller.command(memory, Reading(state, walk.feet[-1] + off, jnp.zeros((4, 3, 3))), None)

    def after(phase, seconds, landed=NONE, off=NOWHERE):
        return at(phase, seconds, landed, off)

    return walk, after


def test_after_the_last_shift_the_trunk_stays_where_it_has_come_to(commands):
    walk, after = commands
    count = int(np.sum(walk.used))
    assert np.abs(np.asarray(walk.phases.trunk_to - walk.phases.trunk_from))[count - 1].max() > 0.01
    ended, _ = after(count, 0.0)
    within, _ = after(count - 1, float(walk.phases.duration[count - 1]))
    np.testing.assert_allclose(ended.position, within.position, atol=1e-9)
    for seconds in (0.1, 1.0):
        late, _ = after(count, seconds)
        np.testing.assert_allclose(late.position, ended.position, atol=1e-9)
        np.testing.assert_allclose(late.velocity, 0.0, atol=1e-9)


def test_a_foot_that_has_landed_stands_where_it_is_and_others_follow_their_slip_slowly(commands):
    """The foot in the air is where its own law has it."""
    walk, after = commands
    off, feet = np.full((4, 3), 0.02), np.asarray(walk.feet[-1])
    phase = walk.legs.index(2)  # the left hind leg swings
    seconds = 0.5 * float(walk.phases.duration[phase])
    _, memory = after(phase, seconds, np.array([False, True, False, False]), off)
    moved = np.asarray(memory.held) - feet
    np.testing.assert_allclose(moved[1], 0.02, atol=1e-9)
    np.testing.assert_allclose(moved[[0, 3]], 0.02 * DT / 1.0, atol=1e-9)
    np.testing.assert_allclose(moved[2], 0.0, atol=1e-9)
