"""The feedback law against inverse kinematics, and the look-up of the reference."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.control.course import Posture, corrected, held_feet, samples_at, to_rows
from jaxleg.leg.dynamics import all_leg_frames
from jaxleg.leg.kinematics import foot_jacobian
from jaxleg.posture.body import joint_angles
from jaxleg.rotations import trunk_quaternion, trunk_rotation
from jaxleg.walk.between import at_time
from jaxleg.walk.data import Reference

FEET = np.array([[0.36, 0.2, 0.03], [0.28, -0.2, 0.0], [-0.28, 0.2, 0.01], [-0.36, -0.2, -0.02]])
PLANNED = np.array([0.02, 0.01, 0.46, 0.05, -0.04, 0.3])
angles_at = jax.jit(lambda robot, pose, feet: joint_angles(robot, pose, feet)[0])


@jax.jit
def row(pegasus, contact):
    planned, feet = jnp.asarray(PLANNED), jnp.asarray(FEET)
    angles, _ = joint_angles(pegasus, planned, feet)
    zero = jnp.zeros((4, 3))
    turn = trunk_quaternion(planned[3:])
    return Reference(jnp.array(0.0), angles, zero, zero, planned[:3], turn, jnp.zeros(6), feet, contact)


@pytest.fixture(scope="module")
def law(pegasus):
    @jax.jit
    def run(contact, pose, feet):
        """What the law asks for at a pose, the feet where they are; and the exact angles there."""
        angles, _ = joint_angles(pegasus, pose, feet)
        jacobian = trunk_rotation(pose[3:]) @ jax.vmap(foot_jacobian)(all_leg_frames(pegasus, angles))
        now = Posture(pose[:3], trunk_quaternion(pose[3:]), feet, jacobian)
        return corrected(row(pegasus, contact), now), angles

    return run


def test_on_the_plan_nothing_is_corrected(law, pegasus):
    for contact in (np.ones(4), np.array([1.0, 1.0, 0.0, 1.0])):
        wanted, _ = law(contact, PLANNED, FEET)
        np.testing.assert_allclose(wanted, row(pegasus, contact).joint_pos, atol=1e-12)


def test_standing_legs_take_the_trunk_back_over_the_feet_as_they_stand(law, pegasus):
    """Feet off their places by millimetres: the angles of the planned trunk pose over these feet."""
    feet = FEET + 0.003 * np.random.default_rng(0).normal(size=FEET.shape)
    exact = np.asarray(angles_at(pegasus, PLANNED, feet))
    for off in (np.zeros(6), np.array([0.004, -0.003, 0.002, 0.005, -0.004, 0.006])):
        wanted, _ = law(np.ones(4), PLANNED + off, feet)
        np.testing.assert_allclose(wanted, exact, atol=2e-3)
        assert np.abs(exact - row(pegasus, np.ones(4)).joint_pos).max() > 5e-3


def test_a_swinging_leg_goes_to_its_place_in_the_world(law, pegasus):
    """The trunk is off: the angles that put the foot where the plan has it, from where the trunk is."""
    pose = PLANNED + np.array([0.003, -0.0025, 0.002, 0.005, -0.005, 0.005])
    contact = np.array([1.0, 0.0, 1.0, 1.0])
    exact = np.asarray(angles_at(pegasus, pose, FEET))[1]
    wanted, _ = law(contact, pose, FEET)
    np.testing.assert_allclose(np.asarray(wanted)[1], exact, atol=1e-3)
    assert np.abs(exact - np.asarray(row(pegasus, contact).joint_pos)[1]).max() > 1e-2


def test_a_standing_foots_place_follows_slip_slowly_and_a_flying_ones_at_once():
    feet = FEET + 0.01
    held = np.asarray(jax.jit(held_feet)(FEET, feet, np.array([1.0, 0.0, 1.0, 0.0]), 0.002))
    np.testing.assert_allclose(held[1::2], feet[1::2])
    np.testing.assert_allclose(held[::2] - FEET[::2], 0.01 * 0.002, rtol=1e-6)


def test_looking_up_a_reference_interpolates_its_samples(pegasus):
    """A cubic motion of the joints is met exactly, everything else linearly."""
    time = np.array([0.0, 0.1, 0.25, 0.3])
    rates = np.random.default_rng(1).normal(size=(4, 3))
    pos, vel = time[:, None, None] ** 3 * rates, 3.0 * time[:, None, None] ** 2 * rates
    rest = [np.outer(time, np.arange(1.0, n + 1.0)) for n in (12, 3, 4, 6, 12, 4)]
    shapes = [(4, 3), (3,), (4,), (6,), (4, 3), (4,)]
    torque, trunk, quat, trunk_vel, feet, contact = (x.reshape(4, *s) for x, s in zip(rest, shapes))
    reference = Reference(time, pos, vel, torque, trunk, quat, trunk_vel, feet, contact)
    low, high = jax.jit(lambda reference, index: samples_at(to_rows(reference), index))(reference, 1)
    for mine, whole in zip(low, reference):
        np.testing.assert_allclose(mine, whole[1])
    at, after = (jax.jit(at_time)(low, high, time) for time in (0.2, 0.9))
    np.testing.assert_allclose(at.joint_pos, 0.2**3 * rates, atol=1e-12)
    np.testing.assert_allclose(at.joint_torque, 0.2 * np.arange(1.0, 13.0).reshape(4, 3), atol=1e-12)
    np.testing.assert_allclose(after.trunk_pos, trunk[2], atol=1e-12)
