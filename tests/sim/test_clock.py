"""Long walks in single precision: the clock, the meters and the end of the plan, with an engine that costs nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.leg.energy import Power
from jaxleg.sim import rollout
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Terms
from jaxleg.sim.follow import follow
from jaxleg.sim.step import Measured
from jaxleg.terrain import Grid, flat
from jaxleg.walk.data import Reference

pytestmark = pytest.mark.slow

TICK, SECONDS, EVERY = 0.0025, 2000.0, 0.5
FEET = np.array([[0.3, 0.2, 0.0], [0.3, -0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0]])
PER_STEP = 100


def standing() -> Reference:
    """A plan that stands for so long."""
    time = np.arange(0.0, SECONDS + 0.5 * EVERY, EVERY)
    sample = dict(
        joint_pos=np.full((4, 3), 0.1), joint_vel=np.zeros((4, 3)), joint_torque=np.zeros((4, 3)), trunk_pos=[0.0, 0.0, 0.46]
    )
    sample |= dict(trunk_quat=[1.0, 0.0, 0.0, 0.0], trunk_vel=np.zeros(6), foot_pos=FEET, contact=np.ones(4))
    rows = {name: np.broadcast_to(np.float32(x), (len(time), *np.shape(x))) for name, x in sample.items()}
    return Reference(time=jnp.float32(time), **{name: jnp.asarray(x) for name, x in rows.items()})


def engine(q, v) -> Terms:
    """A robot that is where it is."""
    zero, eye = jnp.zeros((4, 3), q.dtype), jnp.broadcast_to(jnp.eye(3, dtype=q.dtype), (4, 3, 3))
    blocks = jnp.eye(6, dtype=q.dtype), jnp.zeros((4, 6, 3), q.dtype), eye, v[:6], zero
    return Terms(*blocks, jnp.asarray(FEET, q.dtype), jnp.zeros((4, 3, 6), q.dtype), eye, q[:3])


def idle(terms, robot, ground, terrain, state, now):
    """A step in which nothing moves but every meter runs: 40 W, 3 W and 0.7 W a joint, 1 mm/s of slip."""
    one = jnp.ones((4, 3), state.q.dtype)
    feet = one[:, 0]
    still = Power(40.0 * one, 3.0 * one, 0.7 * one), one, one, 0.0 * feet, 50.0 * feet, 1e-3 * feet
    return state, Measured(*still, terms.com, terms.foot)


@pytest.fixture(scope="module")
def followed(pegasus):
    patch = pytest.MonkeyPatch()
    patch.setattr(rollout, "advance", idle)
    robot = jax.tree.map(jnp.float32, pegasus)
    ground = jax.tree.map(jnp.float32, flat(Grid(60, 40, 0.04, (-1.2, -0.8))))
    run = jax.jit(
        lambda track, last, ticks: follow(engine, robot, Ground(), ground, track, last, PER_STEP, jnp.float32(TICK), ticks)
    )
    track = standing()
    last = jnp.int32(len(track.time) - 1)
    whole = run(track, last, jnp.int32(SECONDS / TICK + 1))
    half = run(track, last, jnp.int32(0.5 * SECONDS / TICK))
    patch.undo()
    return whole, half, last


def test_a_walk_is_followed_to_its_end(followed):
    whole, half, last = followed
    assert whole.reached == last
    assert whole.finished
    assert half.reached == last // 2
    assert not half.finished
    assert not half.meters.fell


def test_the_meters_are_those_of_exact_sums(followed):
    meters = followed[0].meters
    assert meters.time.dtype == jnp.float32
    np.testing.assert_allclose(meters.time, SECONDS, rtol=1e-6)
    for value, watts in zip(meters.energy, (40.0, 3.0, 0.7)):
        np.testing.assert_allclose(value, watts * SECONDS, rtol=1e-6)
    np.testing.assert_allclose(meters.slip, 1e-3 * SECONDS, rtol=1e-6)
