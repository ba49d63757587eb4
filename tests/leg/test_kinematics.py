"""Forward and inverse kinematics as laws over random legs, and against paper A and MuJoCo."""

import jax
import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg import rotations
from jaxleg.leg import kinematics
from jaxleg.leg.kinematics import Reach
from jaxleg.leg.plane import fold_of
from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.vectors import vector

N = 200
forward = jax.jit(jax.vmap(kinematics.foot_position))
inverse = jax.jit(jax.vmap(kinematics.leg_angles))
slopes = jax.jit(jax.vmap(jax.jacobian(kinematics.foot_position, argnums=2)))
rotation_from_quaternion, reach_for_bend = map(jax.jit, (rotations.rotation_from_quaternion, kinematics.reach_for_bend))
foot_position, leg_angles, leg_frames, knee_bend = (
    jax.jit(f)
    for f in (
        kinematics.foot_position,
        kinematics.leg_angles,
        kinematics.leg_frames,
        kinematics.knee_bend,
    )
)


@jax.jit
def joint_rates(axis, offset, angles, velocity, acceleration):
    return kinematics.joint_rates(axis, offset, fold_of(axis, angles), vector(velocity), vector(acceleration))


@pytest.fixture(scope="module")
def legs():
    """Random legs of either side, every link offset in all directions, and feet below their hips in reach."""
    rng = np.random.default_rng(1)
    side = rng.choice([-1.0, 1.0], N)
    axis = np.zeros((N, 3, 3))
    axis[:, 0, 0], axis[:, 1:, 1] = side, -1.0
    offset = np.zeros((N, 3, 3))
    offset[:, 0] = rng.uniform([-0.1, 0.0, -0.05], [0.1, 0.1, 0.05], (N, 3))
    offset[:, 1:] = rng.uniform([-0.08, -0.03, -0.4], [0.08, 0.03, -0.2], (N, 2, 3))
    offset[..., 1] *= side[:, None]
    lengths = np.hypot(offset[:, 1:, 0], offset[:, 1:, 2])
    near, far = abs(lengths[:, 0] - lengths[:, 1]) + 0.03, lengths.sum(axis=1) - 0.005
    reach, pitch, roll = rng.uniform(near, far), rng.uniform(-0.9, 0.9, N), rng.uniform(-0.7, 0.7, N)
    x, lateral = offset[:, 0, 0] + reach * np.sin(pitch), offset[..., 1].sum(axis=1)
    depth = np.maximum(reach * np.cos(pitch) - offset[:, 0, 2], 0.02)
    y, z = lateral * np.cos(roll) + depth * np.sin(roll), lateral * np.sin(roll) - depth * np.cos(roll)
    return axis, offset, np.stack([x, y, z], axis=-1)


def first_leg(robot):
    return np.asarray(robot.joint_axis)[0], np.asarray(robot.link_offset)[0]


def paper_foot(hip, lengths, angles):
    """Paper A, equation (2): right leg."""
    (x_hip, y_hip, z_hip), (l1, l2, l3), (t1, t2, t3) = hip, lengths, angles
    drop = l2 * np.cos(t2) + l3 * np.cos(t2 + t3)
    y0, z0 = y_hip - l1 * np.cos(t1), z_hip + l1 * np.sin(t1)
    x2 = x_hip + l2 * np.sin(t2) + l3 * np.sin(t2 + t3)
    return np.array([x2, y0 - np.sin(t1) * drop, z0 - np.cos(t1) * drop])


@pytest.mark.parametrize("knee_sign", [1.0, -1.0])
def test_forward_undoes_inverse_on_both_knee_branches(legs, knee_sign):
    axis, offset, foot = legs
    angles, status = jax.device_get(inverse(axis, offset, np.full(N, knee_sign), foot))
    assert np.mean(status == Reach.OK) > 0.9
    ok = status == Reach.OK
    assert_allclose(np.asarray(forward(axis, offset, angles))[ok], foot[ok], atol=1e-9)
    tilt = np.arctan2(offset[:, 1:, 0], -offset[:, 1:, 2])
    assert np.all((angles[:, 2] + tilt[:, 1] - tilt[:, 0])[ok] * knee_sign > 0)


@pytest.mark.parametrize("leg", [1, 3])
def test_right_legs_are_equation_2(pegasus, leg):
    rng = np.random.default_rng(2)
    for angles in rng.uniform(-1.2, 1.2, (5, 3)):
        ours = forward(pegasus.joint_axis, pegasus.link_offset, np.tile(angles, (4, 1)))[leg]
        hip = np.asarray(pegasus.hip_position)[leg]
        assert_allclose(hip + ours, paper_foot(hip, (0.08, 0.26, 0.34), angles), atol=1e-12)


def test_left_legs_mirror_right_ones(pegasus):
    angles = np.tile([0.3, -0.4, 0.9], (4, 1))
    foot = np.asarray(forward(pegasus.joint_axis, pegasus.link_offset, angles))
    assert_allclose(foot[0::2], foot[1::2] * np.array([[1.0, -1.0, 1.0]]), atol=1e-12)
    assert np.all(foot[0::2, 1] > 0.2)  # positive hip: outwards


def test_all_feet_are_mujocos(pegasus):
    model = mujoco.MjModel.from_xml_string(robot_mjcf(pegasus))
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    for _ in range(5):
        angles, quat = rng.uniform(-1.5, 1.5, (4, 3)), rng.normal(size=4)
        quat /= np.linalg.norm(quat)
        place = rng.normal(size=3)
        data.qpos[:] = np.concatenate([place, quat, angles.ravel()])
        mujoco.mj_kinematics(model, data)
        feet = np.asarray(forward(pegasus.joint_axis, pegasus.link_offset, angles))
        turn = np.asarray(rotation_from_quaternion(quat))
        assert_allclose(place + (np.asarray(pegasus.hip_position) + feet) @ turn.T, data.site_xpos, atol=1e-12)


def test_jacobian_is_the_derivative(legs):
    axis, offset, foot = legs
    angles, _ = inverse(axis, offset, np.ones(N), foot)
    ours = jax.jit(jax.vmap(lambda *a: kinematics.foot_jacobian(kinematics.leg_frames(*a))))
    assert_allclose(ours(axis, offset, angles), slopes(axis, offset, angles), atol=1e-12)


@pytest.mark.parametrize(
    ("foot", "status", "bend"),
    [
        ((0.1, 0.08, -0.5), Reach.OK, None),
        ((0.3, 0.08, -0.6), Reach.TOO_FAR, 0.0),
        ((0.0, 0.08, -0.61), Reach.TOO_FAR, 0.0),
        ((0.0, 0.08, -0.05), Reach.TOO_NEAR, np.pi),
        ((0.2, 0.05, -0.01), Reach.TOO_NEAR, None),  # nearer the roll axis than the hip link
    ],
)
def test_reach(pegasus, foot, status, bend):
    axis, offset = first_leg(pegasus)
    angles, ours = jax.device_get(leg_angles(axis, offset, 1.0, np.array(foot)))
    assert ours == status
    assert np.all(np.isfinite(angles))
    if bend is not None:
        assert_allclose(knee_bend(axis, offset, angles), bend, atol=1e-9)


inverse_slope = jax.jit(jax.jacobian(lambda *a: kinematics.leg_angles(*a)[0], argnums=3))


@pytest.mark.parametrize("z", [-0.60, -0.65, -0.08, -0.05, 0.0])
@pytest.mark.parametrize("knee_sign", [1.0, -1.0])
def test_gradients_are_finite_stretched_folded_and_beyond(pegasus, knee_sign, z):
    slope = inverse_slope(*first_leg(pegasus), knee_sign, np.array([0.0, 0.08, z]))
    assert np.all(np.isfinite(slope))


def test_inverse_jacobian_is_the_gradient_of_the_inverse(legs):
    axis, offset, foot = legs
    angles, status = jax.device_get(inverse(axis, offset, np.ones(N), foot))
    inverses = jax.jit(jax.vmap(jax.jacobian(lambda *a: kinematics.leg_angles(*a)[0], argnums=3)))
    product = np.asarray(inverses(axis, offset, np.ones(N), foot)) @ np.asarray(slopes(axis, offset, angles))
    product = product[status == Reach.OK]
    assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-8)


@pytest.mark.parametrize("leg", range(4))
def test_joint_rates_are_finite_differences(pegasus, leg):
    axis, offset, h = np.asarray(pegasus.joint_axis)[leg], np.asarray(pegasus.link_offset)[leg], 1e-4
    start = np.array([-0.05, offset[0, 1], -0.5])

    def foot(t):
        return start + np.array([0.1 * np.sin(3 * t), 0.05 * np.sin(2 * t + 1), 0.06 * np.cos(4 * t)])

    def rate(t, order):
        phase = order * np.pi / 2
        amounts = (0.1 * 3**order, 0.05 * 2**order, 0.06 * 4**order)
        return np.array(amounts) * np.array([np.sin(3 * t + phase), np.sin(2 * t + 1 + phase), np.cos(4 * t + phase)])

    times = np.array([0.2, 0.9, 1.7])
    around = np.stack([[foot(t + k * h) for k in (-1, 0, 1)] for t in times]).reshape(-1, 3)
    q = np.stack([leg_angles(axis, offset, 1.0, place)[0] for place in around]).reshape(3, 3, 3)
    for t, (before, now, after) in zip(times, q):
        velocity, acceleration = joint_rates(axis, offset, now, rate(t, 1), rate(t, 2))
        assert_allclose(velocity, (after - before) / (2 * h), atol=1e-5)
        assert_allclose(acceleration, (after - 2 * now + before) / h**2, atol=1e-4)


def test_joint_rates_give_back_the_motion_of_the_joints(legs):
    """The foot's velocity and acceleration by differentiating forward kinematics, whatever the axes' signs."""
    axis, offset, foot = legs
    rng = np.random.default_rng(6)
    axis = axis * rng.choice([-1.0, 1.0], (N, 3, 1))
    angles, status = jax.device_get(inverse(axis, offset, np.ones(N), foot))
    rate, rate_on = rng.normal(size=(2, N, 3))

    @jax.jit
    @jax.vmap
    def back(axis, offset, angles, rate, rate_on):
        def velocity(angles, rate):
            return jax.jvp(lambda q: kinematics.foot_position(axis, offset, q), (angles,), (rate,))[1]

        v, a = jax.jvp(velocity, (angles, rate), (rate, rate_on))
        return joint_rates(axis, offset, angles, v, a)

    ours, ours_on = jax.device_get(back(axis, offset, angles, rate, rate_on))
    ok = status == Reach.OK
    assert_allclose(ours[ok], rate[ok], atol=1e-8)
    assert_allclose(ours_on[ok], rate_on[ok], atol=1e-7)


def test_joint_rates_are_finite_at_the_stretched_leg(pegasus):
    rates = joint_rates(*first_leg(pegasus), np.zeros(3), np.ones(3), np.ones(3))
    assert np.all(np.isfinite(rates))


@pytest.mark.parametrize("degrees", [0.0, 20.0, 90.0, 150.0])
def test_reach_for_bend_is_the_distance_at_that_bend(pegasus, degrees):
    (axis, offset), bend = first_leg(pegasus), np.radians(degrees)
    foot = np.asarray(foot_position(axis, offset, np.array([0.0, -0.3, bend])))
    assert_allclose(reach_for_bend(offset, bend), np.linalg.norm(foot - offset[0]), atol=1e-12)
    assert_allclose(knee_bend(axis, offset, np.array([0.0, -0.3, -bend])), bend)


def test_knee_bend_is_the_angle_between_thigh_and_shank_whatever_the_axes_signs(legs):
    """Both directions in the leg's plane, from forward kinematics; one foot, two signs of the knee: one bend."""
    axis, offset, foot = legs
    signs = np.random.default_rng(4).choice([-1.0, 1.0], (N, 2))
    turned = axis.copy()
    turned[:, 1:, 1] *= signs
    angles, status = jax.device_get(inverse(turned, offset, np.ones(N), foot))
    frames = jax.device_get(jax.jit(jax.vmap(kinematics.leg_frames))(turned, offset, angles))
    links = np.stack([frames.origin[:, 2] - frames.origin[:, 1], frames.foot - frames.origin[:, 2]], axis=1)
    pitch = frames.axis[:, 1:2]
    thigh, shank = np.moveaxis(links - np.sum(links * pitch, -1, keepdims=True) * pitch, 1, 0)
    lengths = np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shank, axis=-1)
    between = np.arctan2(np.linalg.norm(np.cross(thigh, shank), axis=-1), np.sum(thigh * shank, axis=-1))
    bend = jax.jit(jax.vmap(kinematics.knee_bend))
    ok = (status == Reach.OK) & (lengths > 0.0)
    for axes, q in ((turned, angles), (axis, inverse(axis, offset, np.ones(N), foot)[0])):
        assert_allclose(np.asarray(bend(axes, offset, q))[ok], between[ok], atol=1e-7)


@pytest.mark.parametrize("angle", [3.0, 4.0, -3.5, 9.0])
def test_knee_bend_of_a_turned_round_knee_is_at_most_a_half_turn(pegasus, angle):
    bend = knee_bend(*first_leg(pegasus), np.array([0.0, 0.0, angle]))
    assert_allclose(bend, np.arccos(np.cos(angle)), atol=1e-12)


def test_range_slack_is_the_way_to_the_nearer_end():
    spans = np.array([[-1.0, 2.0], [0.5, 0.7], [-3.0, -2.0]])
    assert_allclose(jax.jit(kinematics.range_slack)(spans, np.array([0.5, 0.4, -2.9])), [1.5, -0.1, 0.1], atol=1e-12)


@pytest.mark.parametrize("foot", [(np.nan, 0.08, -0.5), (0.0, np.nan, -0.5), (0.0, 0.08, np.nan), (np.inf, 0.0, -np.inf)])
def test_a_target_that_is_not_finite_is_never_reached(pegasus, foot):
    status = leg_angles(*first_leg(pegasus), 1.0, np.array(foot))[1]
    assert status == Reach.NOT_FINITE


@pytest.mark.parametrize("knee_sign", [1.0, -1.0])
def test_the_inverses_posture_is_that_of_its_angles_in_reach_and_beyond(legs, knee_sign):
    """Cosines and sines without the angles; clamped targets and every sign of the axes included."""
    axis, offset, foot = legs
    rng = np.random.default_rng(5)
    axis, foot = axis * rng.choice([-1.0, 1.0], (N, 3, 1)), foot * rng.uniform(0.3, 1.4, (N, 1))

    @jax.jit
    @jax.vmap
    def both(axis, offset, foot):
        found = kinematics.leg_inverse(axis, offset, knee_sign, vector(foot))
        return found.fold, fold_of(axis, found.angles), found.reach

    ours, of_angles, status = jax.device_get(both(axis, offset, foot))
    assert {Reach.OK, Reach.TOO_FAR, Reach.TOO_NEAR} == set(status)
    assert_allclose(np.stack(jax.tree.leaves(ours)), np.stack(jax.tree.leaves(of_angles)), atol=1e-7)


def test_vmap_is_a_stack(legs):
    axis, offset, foot = legs
    one_by_one = [leg_angles(axis[i], offset[i], 1.0, foot[i])[0] for i in range(3)]
    assert_allclose(np.asarray(inverse(axis, offset, np.ones(N), foot)[0])[:3], np.stack(one_by_one))
