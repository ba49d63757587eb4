"""The step against C MuJoCo's mass matrix, bias and Jacobians, a contact written anew, and motions worked out by hand."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from jaxleg.control.contract import State, Tracking
from jaxleg.conventions import GRAVITY
from jaxleg.sim.contact import Ground
from jaxleg.sim.step import initial_state
from jaxleg.walk.data import Reference
from tests.motions import applied_torque, contact_force, sloping

STEPS, DT = 936, 0.0025  # as many as in test_meters: compiled once
ANGLES = np.tile([0.0, -0.7, 1.3], (4, 1))  # all legs alike: the feet's plane is parallel to the trunk's
GROUND = Ground(5e4, 700.0, 6e-4, 0.6, 4e-3)
LOOK = range(0, 400, 9)


def upright(slope):
    """Rotation that puts the trunk on a slope, parallel to it."""
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    turn = np.cross([0.0, 0.0, 1.0], normal)
    size = np.linalg.norm(turn)
    return Rotation.from_rotvec(turn * (np.arcsin(size) / size if size else 0.0))


def standing_on(bodies, slope, radius, depth=1e-3, v=None):
    """At rest over a slope's origin, the feet so deep in it."""
    q = np.concatenate([np.zeros(3), [1.0, 0.0, 0.0, 0.0], ANGLES.ravel()])
    turn = upright(slope)
    q[:3] = turn.apply([0.0, 0.0, radius - depth - bodies(q).feet[0, 2]])
    q[3:7] = np.roll(turn.as_quat(), 1)
    return State(q, np.zeros(18) if v is None else v)


def hold(angles=ANGLES, noise=0.0, torque=0.0, seed=0):
    rng = np.random.default_rng(seed)
    position = np.broadcast_to(angles, (STEPS, 4, 3)) + noise * rng.normal(size=(STEPS, 4, 3))
    velocity = 10.0 * noise * rng.normal(size=(STEPS, 4, 3))
    torques = torque * rng.normal(size=(STEPS, 4, 3))
    return Tracking(position, velocity, torques, np.full(STEPS, DT))


def chain(start, states):
    """Configurations and velocities from the start on."""
    return (np.concatenate([np.asarray(a)[None], np.asarray(b)]) for a, b in zip(start, states))


SLOPE = (0.12, -0.08)


@pytest.fixture(scope="module")
def shaken(pegasus, bodies, roll):
    """A robot with lossy joints shaken by its motors on a slope: feet come and go, motors reach their limit."""
    lossy = dataclasses.replace(pegasus, torque_limit=jnp.asarray(np.tile([30.0, 42.0, 36.0], (4, 1))))
    velocity = np.concatenate([[0.1, -0.05, 0.8, 0.6, -0.8, 1.0], 0.2 * np.random.default_rng(1).normal(size=12)])
    start, tracking = standing_on(bodies, SLOPE, float(pegasus.contact_radius), v=velocity), hold(noise=0.008, torque=3.0)
    states, seen = roll(lossy, GROUND, sloping(*SLOPE), start, tracking)
    return lossy, tracking, *chain(start, states), seen


def forces(robot, body, v, later):
    """On each foot, from its velocity before and after the step."""
    radius = float(robot.contact_radius)
    return np.stack(
        [
            contact_force(GROUND, radius, SLOPE, body.feet[i], body.jacobian[i] @ v, body.jacobian[i] @ later, DT)
            for i in range(4)
        ]
    )


def test_every_step_is_newtons_law_with_contact_damping_and_gain_at_its_end(shaken, bodies):
    """M (v+ - v) / dt = tau(v+) - D v+ - bias + J^T f(v+), whatever was solved for it."""
    robot, tracking, q, v, seen = shaken
    damping = np.concatenate([np.zeros(6), np.asarray(robot.joint_damping).ravel()])
    limited, lifted = 0, 0
    for n in LOOK:
        body, now = bodies(q[n], v[n]), Tracking(*(x[n] for x in tracking))
        torque, force = applied_torque(robot, now, q[n], v[n], v[n + 1]), forces(robot, body, v[n], v[n + 1])
        push = np.concatenate([np.zeros(6), torque]) + np.einsum("lik,li->k", body.jacobian, force)
        np.testing.assert_allclose(body.mass @ (v[n + 1] - v[n]) / DT, push - damping * v[n + 1] - body.bias, atol=1e-6)
        np.testing.assert_allclose(np.asarray(seen.torque[n]).ravel(), torque, atol=1e-8)
        limited += np.sum(np.abs(torque) == np.asarray(robot.torque_limit).ravel())
        lifted += np.sum(np.linalg.norm(force, axis=1) < 1.0)
    assert 10 < limited < 12 * len(LOOK) / 2
    assert 10 < lifted < 4 * len(LOOK) - 10


def test_what_a_step_measures_is_so(shaken, bodies):
    robot, _, q, v, seen = shaken
    normal = np.array([-SLOPE[0], -SLOPE[1], 1.0]) / np.sqrt(1.0 + SLOPE[0] ** 2 + SLOPE[1] ** 2)
    for n in LOOK:
        body = bodies(q[n], v[n])
        force, moving = forces(robot, body, v[n], v[n + 1]), body.jacobian @ v[n + 1]
        depth = float(robot.contact_radius) - body.feet @ normal
        for found, expected in (
            (seen.normal_force[n], force @ normal),
            (seen.sliding[n], np.linalg.norm(np.cross(moving, normal), axis=1)),
            (seen.penetration[n], depth),
            (seen.foot[n], body.feet),
            (seen.com[n], body.com),
            (np.asarray(seen.speed[n]).ravel(), 0.5 * (v[n, 6:] + v[n + 1, 6:])),
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)


def test_the_configuration_goes_on_by_the_new_velocity(shaken):
    """Positions in W, the turn about the trunk's own axes: scipy's rotations."""
    _, _, q, v, _ = shaken
    np.testing.assert_allclose(np.diff(q[:, :3], axis=0), DT * v[1:, :3], atol=1e-14)
    np.testing.assert_allclose(np.diff(q[:, 7:], axis=0), DT * v[1:, 6:], atol=1e-14)
    turns = Rotation.from_quat(np.roll(q[:, 3:7], -1, axis=1))
    expected = turns[:-1] * Rotation.from_rotvec(DT * v[1:, 3:6])
    assert np.max((expected.inv() * turns[1:]).magnitude()) < 1e-6  # a step turns by up to a hundredth
    assert np.max(turns.magnitude()) > 0.05
    np.testing.assert_allclose(np.linalg.norm(q[:, 3:7], axis=1), 1.0, atol=1e-12)


def test_nothing_holds_a_robot_in_the_air(pegasus, bodies, roll):
    """Semi-implicit: after n steps it has fallen g dt^2 n (n + 1) / 2 and goes on sideways, in its pose."""
    velocity = np.concatenate([[0.3, -0.2, 0.5], np.zeros(15)])
    start = standing_on(bodies, (0.0, 0.0), 40.0, v=velocity)
    states, seen = roll(pegasus, GROUND, sloping(0.0, 0.0), start, hold())
    n = np.arange(1, STEPS + 1)
    way = np.asarray(states.q)[:, :3] - np.asarray(start.q)[:3]
    np.testing.assert_allclose(way[:, :2], DT * n[:, None] * [0.3, -0.2], atol=1e-9)
    np.testing.assert_allclose(way[:, 2], DT * n * 0.5 - GRAVITY * DT**2 * n * (n + 1) / 2, atol=1e-9)
    np.testing.assert_allclose(states.q[:, 3:], np.broadcast_to(start.q[3:], (STEPS, 16)), atol=1e-9)
    assert np.max(seen.normal_force) == 0.0
    assert np.max(np.abs(seen.torque)) < 1e-6


def test_legs_that_move_in_the_air_do_not_move_the_centre_of_mass(pegasus, bodies, roll):
    """But for the steps' own error, the centre of mass falls freely and the angular momentum stays 0."""
    start = standing_on(bodies, (0.0, 0.0), 40.0)
    states, seen = roll(pegasus, GROUND, sloping(0.0, 0.0), start, hold(ANGLES + np.array([0.3, -0.2, 0.2])))
    n = np.arange(400)
    assert np.ptp(np.asarray(states.q)[:, 7:], axis=0).min() > 0.1
    com = np.asarray(seen.com)[:400] - np.asarray(seen.com)[0]
    np.testing.assert_allclose(com[:, :2], 0.0, atol=2e-3)
    np.testing.assert_allclose(com[:, 2], -GRAVITY * DT**2 * n * (n + 1) / 2, atol=6e-3)


def test_a_robot_that_stands_presses_with_its_weight_as_deep_as_the_spring_says(pegasus, bodies, roll):
    start = standing_on(bodies, (0.0, 0.0), float(pegasus.contact_radius))
    states, seen = roll(pegasus, GROUND, sloping(0.0, 0.0), start, hold())
    weight = 35.2 * GRAVITY
    np.testing.assert_allclose(np.sum(np.asarray(seen.normal_force)[-1]), weight, rtol=1e-3)
    spring = 30.0 * np.log(1.0 + np.exp(np.asarray(seen.penetration[-1]) / 6e-4))
    np.testing.assert_allclose(spring, seen.normal_force[-1], rtol=1e-3)
    assert np.abs(states.v[-1]).max() < 1e-3


def test_a_rollout_begins_as_deep_as_four_feet_press_with_the_weight(pegasus):
    rows = [np.zeros(1), ANGLES[None], *(np.zeros((1, 4, 3)),) * 2, [[0.1, 0.2, 0.5]], [[1.0, 0, 0, 0]], np.zeros((1, 6))]
    first = (np.asarray(x, float) for x in (*rows, np.zeros((1, 4, 3)), np.ones((1, 4))))
    track = Reference(*(np.concatenate([x, x + 0.1]) for x in first))  # the second sample is none of its business
    state = jax.tree.map(np.asarray, jax.jit(initial_state)(pegasus, GROUND, track))
    depth = brentq(lambda d: 30.0 * np.log(1.0 + np.exp(d / 6e-4)) - 35.2 * GRAVITY / 4.0, 0.0, 0.01)
    np.testing.assert_allclose(state.q[:7], [0.1, 0.2, 0.5 - depth, 1.0, 0.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_array_equal(state.q[7:], ANGLES.ravel())
    assert not np.any(state.v)


@pytest.mark.parametrize("slope", [(0.25, 0.0), (0.0, -0.25)])
def test_on_a_gentle_slope_it_creeps_down_as_viscous_friction_lets_it(pegasus, bodies, roll, slope):
    """mu N w / sqrt(w^2 + v_0^2) = m g sin: w = v_0 r / sqrt(1 - r^2), r = tan / mu."""
    start = standing_on(bodies, slope, float(pegasus.contact_radius))
    states, seen = roll(pegasus, GROUND._replace(creep=0.04), sloping(*slope), start, hold())
    ratio = 0.25 / 0.6
    speed = 0.04 * ratio / np.sqrt(1.0 - ratio**2)
    np.testing.assert_allclose(seen.sliding[-1], speed, rtol=0.02)
    down = -np.array([*slope, 0.25**2]) / np.hypot(0.25, 0.25**2)
    np.testing.assert_allclose(states.v[-1, :3], speed * down, atol=0.03 * speed)


def test_on_a_slippery_slope_it_slides_down_at_the_slopes_acceleration(pegasus, bodies, roll):
    """g (sin - mu cos), once it slides faster than v_0."""
    start = standing_on(bodies, (0.25, 0.0), float(pegasus.contact_radius))
    states, _ = roll(pegasus, GROUND._replace(friction=0.1), sloping(0.25, 0.0), start, hold())
    speed = np.linalg.norm(np.asarray(states.v)[:, :3], axis=1)
    acceleration = GRAVITY * (0.25 - 0.1) / np.sqrt(1.0 + 0.25**2)
    np.testing.assert_allclose((speed[360] - speed[160]) / (200 * DT), acceleration, rtol=0.01)


def test_a_motor_at_its_limit_gives_that_and_no_more(pegasus, bodies, roll):
    """In the air, one joint far off its target: exactly the limit, whatever its speed, until it comes near."""
    start = standing_on(bodies, (0.0, 0.0), 40.0)
    far = ANGLES + np.eye(12)[7].reshape(4, 3) * 1.0
    _, seen = roll(pegasus, GROUND, sloping(0.0, 0.0), start, hold(far))
    assert np.all(np.asarray(seen.torque)[:20, 2, 1] == 60.0)
    assert np.max(np.abs(np.asarray(seen.torque))) <= 60.0
    assert np.max(np.asarray(seen.speed)[:20, 2, 1]) > 0.5
