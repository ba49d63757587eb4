"""Up and down over the feet: where the plan says, without a swing, with the torque of statics at rest."""

import dataclasses

import jax
import numpy as np
import pytest

from jaxleg.conventions import GRAVITY
from jaxleg.terrain import Grid, flat
from jaxleg.walk.reference import reference
from jaxleg.walk.standing import stand_first, up_down
from tests.crawls import gait, in_numpy

GROUND = flat(Grid(40, 30, 0.05, (-1.0, -0.75)))
LOW, HIGH, SECONDS, SAMPLES = 0.13, 0.58, 2.0, 10


@jax.jit
def planned(robot):
    walk = up_down(robot, gait(), GROUND, LOW, HIGH, SECONDS)
    return walk, reference(robot, walk, (SAMPLES, SAMPLES))


@pytest.fixture(scope="module")
def moved(pegasus):
    walk, track = planned(pegasus)
    return in_numpy(walk), jax.tree.map(np.asarray, track)


def test_the_hips_move_between_the_heights_over_feet_that_stand(moved, pegasus):
    walk, track = moved
    np.testing.assert_array_equal(track.foot_pos, np.broadcast_to(walk.footholds[0], track.foot_pos.shape))
    assert np.all(track.contact == 1.0)
    hip = track.trunk_pos[:, 2] + np.asarray(pegasus.hip_position)[0, 2] - walk.footholds[0, 0, 2]
    np.testing.assert_allclose(hip[::SAMPLES], [LOW, HIGH] * 3 + [LOW], atol=1e-12)
    assert np.abs(track.joint_vel[::SAMPLES]).max() < 1e-9
    np.testing.assert_allclose(track.time[::SAMPLES], SECONDS * np.arange(7))


def test_at_rest_the_knee_holds_its_distance_from_the_foot_times_the_load(pegasus):
    """A (3) with the foot under the hip and links without weight: thigh torque 0, knee torque x_knee f_z."""
    light = dataclasses.replace(pegasus, link_mass=pegasus.link_mass * 1e-9, link_inertia=pegasus.link_inertia * 1e-9)
    torque = np.asarray(planned(light)[1].joint_torque)
    thigh, shank = 0.26, 0.34
    for sample, height in ((0, LOW), (SAMPLES, HIGH)):
        above = (shank**2 + height**2 - thigh**2) / (2.0 * height)  # height of the knee over the foot
        expected = 0.25 * float(light.mass) * GRAVITY * np.sqrt(shank**2 - above**2)
        np.testing.assert_allclose(torque[sample, :, 1], 0.0, atol=1e-6)
        np.testing.assert_allclose(np.abs(torque[sample, :, 2]), expected, rtol=1e-6)


def test_a_stand_holds_the_first_pose_and_delays_the_rest(moved):
    track = moved[1]
    stood = jax.tree.map(np.asarray, jax.jit(stand_first, static_argnums=(1, 2))(track, 3.0, 5))
    for before, after in zip(track, stood):
        assert after.shape == (before.shape[0] + 5, *before.shape[1:])
    np.testing.assert_allclose(stood.time[:6], np.arange(6) * 0.6)
    np.testing.assert_allclose(stood.time[5:] - 3.0, track.time)
    np.testing.assert_array_equal(stood.joint_pos[:5], np.broadcast_to(track.joint_pos[0], (5, 4, 3)))
    np.testing.assert_array_equal(stood.joint_torque[:5], np.broadcast_to(track.joint_torque[0], (5, 4, 3)))
    np.testing.assert_array_equal(stood.joint_torque[5:], track.joint_torque)
    assert not np.any(stood.joint_vel[:5])
    assert not np.any(stood.trunk_vel[:5])
