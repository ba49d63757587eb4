"""The rollout: what it records adds up to its meters, a standing robot weighs what it weighs, up and down comes back."""

import jax
import numpy as np
import pytest

from jaxleg.conventions import GRAVITY
from jaxleg.leg.energy import CONVENTIONS, electrical, motor_power
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import mjx_engine
from jaxleg.sim.legged import legged_engine
from jaxleg.sim.rollout import record, simulate
from jaxleg.terrain import Grid, flat
from jaxleg.walk.reference import reference
from jaxleg.walk.standing import stand_first, up_down
from tests.crawls import gait

GROUND = flat(Grid(60, 40, 0.03, (-0.9, -0.6)))
SAMPLES, SECONDS = (12, 12), 1.2
STAND = 0.5  # [s]


@pytest.fixture(scope="module")
def rollout(pegasus):
    """A short stand, then three times up and down between 0.40 and 0.46 m, recorded, and metered twice."""
    engine = legged_engine(pegasus)

    @jax.jit
    def run(robot):
        walk = up_down(robot, gait(), GROUND, 0.40, 0.46, SECONDS)
        track = stand_first(reference(robot, walk, SAMPLES), STAND, 10)
        numbers = engine, robot, Ground(), GROUND, track, 16
        return track, *record(*numbers), simulate(*numbers)

    track, meters, kept, again = run(pegasus)
    return *jax.tree.map(np.asarray, (track, kept)), meters, again


def test_recorded_power_adds_up_to_the_meters(rollout, pegasus):
    _, kept, meters, again = rollout
    assert not meters.fell
    assert np.all(kept.alive)
    dt = np.diff(kept.time, prepend=0.0)[:, None, None]
    power = jax.jit(motor_power)(pegasus, kept.torque, kept.speed)
    for convention in CONVENTIONS:
        energy = np.sum(dt * np.asarray(electrical(power, convention)), axis=0)
        for seen in (meters, again):
            np.testing.assert_allclose(energy, electrical(seen.energy, convention), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(kept.time[-1], STAND + 6 * SECONDS)


@pytest.mark.slow
def test_mjx_walks_the_same(rollout, pegasus):
    """Seconds of contact with MJX's terms instead of those written out."""
    track, _, meters, _ = rollout
    follow = jax.jit(lambda robot, track: simulate(mjx_engine(pegasus), robot, Ground(), GROUND, track, 16))
    other = follow(pegasus, track)
    for ours, theirs in zip(jax.tree.leaves(meters), jax.tree.leaves(other)):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9)


def test_standing_feet_carry_the_weight_and_motors_hold_it(rollout, pegasus):
    track, kept, *_ = rollout
    still = (kept.time > 0.3) & (kept.time < STAND)
    np.testing.assert_allclose(kept.normal_force[still].sum(axis=1), pegasus.mass * GRAVITY, rtol=2e-3)
    np.testing.assert_allclose(kept.torque[still].mean(axis=0), track.joint_torque[0], atol=0.3)


def test_the_trunk_follows_up_and_down(rollout):
    track, kept, *_ = rollout
    planned = np.interp(kept.time, track.time, track.trunk_pos[:, 2])
    assert np.ptp(planned) > 0.059
    np.testing.assert_allclose(kept.trunk_pos[:, 2], planned, atol=3e-3)


def test_the_stand_is_the_first_pose_and_then_the_walk(rollout):
    track = rollout[0]
    np.testing.assert_array_equal(track.joint_pos[:10], np.broadcast_to(track.joint_pos[0], (10, 4, 3)))
    assert np.all(track.joint_vel[:10] == 0.0)
    assert np.all(np.diff(track.time) > 0.0)
    assert np.ptp(np.linalg.norm(track.joint_torque[:11], axis=(1, 2))) < 1e-6  # the walk begins at rest
