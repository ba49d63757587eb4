"""The one tick: any controller in it, a fall freezes state and memory, and what is over or not metered does not count."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.control.contract import Controller, State, Tracking
from jaxleg.leg.energy import Power
from jaxleg.pytree import pytree
from jaxleg.sim import rollout
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Terms
from jaxleg.sim.rollout import World, ticker
from jaxleg.sim.step import Measured
from jaxleg.terrain import Grid, flat

FEET = np.array([[0.3, 0.2, 0.0], [0.3, -0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0]])
GROUND, DT, TICKS = flat(Grid(60, 40, 0.04, (-1.2, -0.8))), 0.01, 30


class Memory(NamedTuple):
    """How often it commanded, and the sum of the torques it felt."""

    ticks: jax.Array
    torque: jax.Array


@pytree
class Counter(Controller[Memory, jax.Array]):
    """Asks for its row of torque; its walk is over after so many ticks."""

    last: jax.Array

    def start(self):
        return Memory(jnp.array(0), jnp.zeros(()))

    def command(self, memory, sensed, row):
        zero = jnp.zeros((4, 3))
        return Tracking(zero, zero, zero + row, jnp.array(DT)), memory._replace(ticks=memory.ticks + 1)

    def felt(self, memory, torque, after):
        return memory._replace(torque=memory.torque + torque[0, 0])

    def over(self, memory):
        return memory.ticks >= self.last


def engine(q, v):
    zero, eye = jnp.zeros((4, 3)), jnp.broadcast_to(jnp.eye(3), (4, 3, 3))
    return Terms(jnp.eye(6), jnp.zeros((4, 6, 3)), eye, v[:6], zero, jnp.asarray(FEET), jnp.zeros((4, 3, 6)), eye, q[:3])


def sinks(terms, robot, ground, terrain, state, now):
    """A step that takes the trunk down by a centimetre; every motor gives the torque it is told, at 1 W."""
    one = jnp.ones((4, 3))
    seen = Measured(Power(one, one, one), now.torque, one, one[:, 0], 50.0 * one[:, 0], one[:, 0], terms.com, terms.foot)
    return State(state.q - 0.01 * jnp.eye(19)[2], state.v), seen


@pytest.fixture(scope="module")
def walk(pegasus):
    """Lanes and what is told of each tick, of a walk that ends after so many ticks and is metered from one on."""
    start = State(jnp.zeros(19).at[2].set(0.405).at[3].set(1.0), jnp.zeros(18))

    @jax.jit
    def run(last, metered_from):
        first, tick = ticker(World(engine, pegasus, Ground(), GROUND), Counter(last), start, jnp.asarray(FEET))

        def body(lane, row):
            lane, ticked = tick(lane, *row)
            return lane, (lane, ticked)

        count = jnp.arange(TICKS)
        return jax.lax.scan(body, first, (count.astype(float), count >= metered_from))[1]

    patch = pytest.MonkeyPatch()
    patch.setattr(rollout, "advance", sinks)
    run(100, 0)
    patch.undo()
    return lambda *numbers: jax.tree.map(np.asarray, run(*numbers))


FALL = 20  # ticks after which the next one leaves less than half of the trunk's 0.405 m


def test_a_fall_freezes_state_and_memory(walk):
    lanes, _ = walk(100, 0)
    assert lanes.alive.tolist() == [n < FALL for n in range(TICKS)]
    np.testing.assert_allclose(lanes.state.q[:, 2], 0.405 - 0.01 * np.minimum(np.arange(1, TICKS + 1), FALL))
    assert lanes.memory.ticks.tolist() == np.minimum(np.arange(1, TICKS + 1), FALL).tolist()


def test_a_controller_gets_its_rows_and_feels_what_they_did(walk):
    lanes, ticked = walk(100, 0)
    np.testing.assert_allclose(ticked.measured.torque[:, 2, 1], np.arange(TICKS))
    np.testing.assert_allclose(lanes.memory.torque[:FALL], np.cumsum(np.arange(FALL)))


@pytest.mark.parametrize(("last", "metered_from"), [(100, 0), (12, 0), (100, 7), (12, 7), (5, 7)])
def test_only_what_is_under_way_metered_and_upright_counts(walk, last, metered_from):
    lanes, ticked = walk(last, metered_from)
    counted = np.array([metered_from <= n < min(last, FALL) for n in range(TICKS)])
    assert ticked.counted.tolist() == counted.tolist()
    np.testing.assert_allclose(lanes.tally.sums.time[-1], DT * counted.sum(), atol=1e-12)
    np.testing.assert_allclose(lanes.tally.sums.energy.joule[-1], DT * counted.sum(), atol=1e-12)
