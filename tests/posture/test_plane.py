"""Trunk poses: rotations against scipy, rates against differentiation, planes and the point of the centre of gravity."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxleg.gait.order import STEP_LEGS
from jaxleg.gait.support import CogRule, cog_point, crossing, stability_margin
from jaxleg.posture.body import com_position, joint_angles
from jaxleg.posture.plane import Plane, feet_yaw, plane_height, plane_turn, support_plane
from jaxleg.rotations import trunk_quaternion, trunk_rotation, trunk_spin
from tests.crawls import gait

stable = jax.jit(stability_margin)
point_of = jax.jit(cog_point)
plane_of, height_of, turn_of, yaw_of = (jax.jit(f) for f in (support_plane, plane_height, plane_turn, feet_yaw))
rotation_of, spin_of = jax.jit(trunk_rotation), jax.jit(trunk_spin)
TURNS = np.random.default_rng(0).uniform(-1.2, 1.2, (20, 3)) * [1.0, 1.0, 2.5]
FEET = np.array([[0.36, 0.17, 0.05], [0.24, -0.19, -0.02], [-0.25, 0.18, 0.01], [-0.33, -0.16, 0.07]])


def cog(rule="median", ratio=0.5):
    return CogRule(jnp.array(ratio), rule)


def plan(weight=0.0, levelling=0.0, **options):
    return Plane(cog(**options), jnp.array(weight), jnp.array(levelling))


def test_rotation_and_quaternion_are_scipys():
    """Yaw about z, then pitch about the turned -y, then roll about x: intrinsic ZYX with the pitch's sign turned."""
    ours = jax.jit(jax.vmap(trunk_rotation))(TURNS)
    scipys = Rotation.from_euler("ZYX", TURNS[:, [2, 0, 1]] * [1.0, -1.0, 1.0])
    np.testing.assert_allclose(ours, scipys.as_matrix(), atol=1e-12)
    quaternion = np.asarray(jax.jit(jax.vmap(trunk_quaternion))(TURNS))
    np.testing.assert_allclose(Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]).as_matrix(), ours, atol=1e-12)


def test_spin_is_the_rotations_rate():
    rate = np.array([0.3, -0.7, 1.1])
    moved = jax.jit(lambda turn: jax.jvp(trunk_rotation, (turn,), (rate,)))
    for turn in TURNS[:5]:
        rotation, change = map(np.asarray, moved(turn))
        cross = rotation.T @ change  # R^T dR/dt is the cross product matrix of the spin in B
        np.testing.assert_allclose(spin_of(turn, rate), [cross[2, 1], cross[0, 2], cross[1, 0]], atol=1e-12)
        np.testing.assert_allclose(cross, -cross.T, atol=1e-12)


@pytest.mark.parametrize("flying", range(4))
def test_the_plane_goes_through_the_standing_feet(flying):
    standing = np.arange(4) != flying
    plane = plane_of(FEET, np.where(standing, 1.0, 0.0))
    heights = np.array([height_of(plane, foot[:2]) for foot in FEET])
    np.testing.assert_allclose(heights[standing], FEET[standing, 2], atol=1e-12)
    assert abs(heights[flying] - FEET[flying, 2]) > 1e-3


def test_the_plane_of_four_feet_is_the_least_squares_one():
    rows = np.column_stack([np.ones(4), FEET[:, :2]])
    expected = np.linalg.lstsq(rows, FEET[:, 2], rcond=None)[0]
    np.testing.assert_allclose(plane_of(FEET, np.ones(4)), expected, atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_a_trunk_with_the_plane_has_its_normal(yaw):
    turn = np.append(turn_of(np.array([0.1, 0.3, -0.2]), yaw), yaw)
    normal = np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([-0.3, 0.2, 1.0])
    np.testing.assert_allclose(np.asarray(rotation_of(turn))[:, 2], normal, atol=1e-12)


def test_yaw_follows_the_feet_without_a_jump():
    turned = FEET @ np.asarray(rotation_of(np.array([0.0, 0.0, 3.0]))).T
    straight = float(yaw_of(FEET, 0.0))
    for last, turns in ((2.9, 0), (-3.2, -1), (9.1, 1)):
        np.testing.assert_allclose(yaw_of(turned, last), straight + 3.0 + turns * 2.0 * np.pi, atol=1e-12)


def stepped(feet, leg, way):
    """The feet with one moved."""
    return feet + np.eye(4)[leg][:, None] * way


@pytest.mark.parametrize("leg", STEP_LEGS)
@pytest.mark.parametrize("rule", ["median", "overlap"])
def test_the_point_lies_inside_both_support_triangles_of_a_side(leg, rule):
    """Paper C, (21) and Fig. 3: for the hind and the front swing of a side alike."""
    hind, front = (leg, leg - 2) if leg >= 2 else (leg + 2, leg)
    target = stepped(FEET, hind, [0.2, 0.0, 0.0])
    before, after = (FEET, target) if leg >= 2 else (target, stepped(target, front, [0.2, 0.0, 0.0]))
    point = point_of(cog(rule), before, after, np.array(leg))
    for flying, feet in ((hind, FEET), (front, target)):
        assert stable(point, feet[:, :2], np.arange(4) != flying) > 0.03


def test_the_median_runs_from_the_crossing_to_the_standing_side():
    target = stepped(FEET, 3, [0.2, 0.0, 0.0])
    at = [point_of(cog(ratio=k), FEET, target, np.array(3)) for k in (0.0, 1.0)]
    np.testing.assert_allclose(at[1], 0.5 * (FEET[0, :2] + FEET[2, :2]), atol=1e-12)
    crossed = jax.jit(crossing)(FEET[0, :2], target[3, :2], FEET[2, :2], FEET[1, :2])
    np.testing.assert_allclose(at[0], crossed, atol=1e-12)


def test_the_pose_has_its_height_its_centre_of_mass_and_its_turn(pegasus):
    """The five steps of paper C, 3.1, checked on the pose that comes out."""
    target = stepped(FEET, 3, [0.2, 0.02, -0.03])
    adjust = np.array([0.03, 0.1, -0.05])
    make = jax.jit(lambda p, *x: p.swing(pegasus, gait(0.42, offset=0.0), *x))
    pose, level = (np.asarray(make(p, FEET, target, np.array(3), adjust, 0.0)) for p in (plan(), plan(levelling=1.0)))
    plane = plane_of(target, np.array([1.0, 1.0, 1.0, 0.0]))
    np.testing.assert_allclose(pose[2] - height_of(plane, pose[:2]), 0.45, atol=1e-12)
    np.testing.assert_allclose(pose[5], yaw_of(target, 0.0), atol=1e-12)
    np.testing.assert_allclose(pose[3:5], turn_of(plane, pose[5]) + adjust[1:], atol=1e-12)
    angles, _ = jax.jit(joint_angles)(pegasus, pose, target)
    com = np.asarray(jax.jit(com_position)(pegasus, pose, angles))
    np.testing.assert_allclose(com[:2], point_of(cog(), FEET, target, np.array(3)), atol=1e-3)
    np.testing.assert_allclose(level[3:5], adjust[1:], atol=1e-12)
