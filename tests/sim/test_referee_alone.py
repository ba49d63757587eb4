"""The referee's verdict against MuJoCo stepped by hand: its ground, its motors, what it measures, and from when on."""

import dataclasses
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, interp1d
from scipy.spatial import ConvexHull

from jaxleg.control.course import course
from jaxleg.conventions import GRAVITY
from jaxleg.sim.model import build_model
from jaxleg.sim.referee import replay, replay_each
from jaxleg.sim.referee_feedback import follow_all, lockstep
from jaxleg.terrain.heightmap import HeightMap, height
from jaxleg.walk.data import Reference
from tests.motions import FEET, shift_and_step, sloping

STEP, SETTLE = 0.002, 0.3
FRICTION = 0.8
TERRAIN = sloping(0.0, 0.0)
SECONDS, SAMPLES, LATE = (0.5, 0.5), (10, 16), 6  # 0.3 s
BUMPS = HeightMap(jnp.asarray(np.random.default_rng(2).uniform(-0.3, 0.2, (11, 7))), jnp.array([-0.2, 0.5]), jnp.array(0.1))


def alone(verdict):
    """The verdict on the first lane."""
    return jax.tree.map(lambda x: x[0], verdict)


@pytest.fixture(scope="module")
def track(pegasus):
    return jax.tree.map(np.asarray, shift_and_step(pegasus, TERRAIN, SECONDS, SAMPLES))


def wanted(robot, track, time):
    """What the motors' controllers are told at a time after the settling: kp position + kd velocity + torque."""
    at = max(time, 0.0)
    position, velocity, torque = (
        np.asarray(x, float).reshape(-1, 12) for x in (track.joint_pos, track.joint_vel, track.joint_torque)
    )
    position = CubicHermiteSpline(track.time, position, velocity)(at)
    velocity, torque = (interp1d(track.time, x, axis=0)(at) for x in (velocity, torque))
    return 3000.0 * position + 80.0 * velocity * (time > 0.0) + torque


def step_by_hand(robot, track, terrain=TERRAIN):
    """States before and after each step, the sensors seen in it and the motors' torques as the implicit step applied them."""
    model = build_model(robot, terrain, FRICTION)
    data = mujoco.MjData(model)
    data.qpos[:] = np.concatenate([np.asarray(x[0]).ravel() for x in (track.trunk_pos, track.trunk_quat, track.joint_pos)])
    rows = []
    for n in range(round((SETTLE + float(track.time[-1])) / STEP)):
        q, v = data.qpos.copy(), data.qvel.copy()
        data.ctrl[:] = wanted(robot, track, n * STEP - SETTLE)
        mujoco.mj_step(model, data)
        torque = data.actuator_force - 80.0 * (data.qvel[6:] - v[6:])
        rows.append((q, v, data.qpos.copy(), data.qvel.copy(), data.sensordata.copy(), torque))
    q, v, later_q, later_v, sensors, torque = (np.stack(x) for x in zip(*rows))
    return SimpleNamespace(q=q, v=v, later_q=later_q, later_v=later_v, sensors=sensors, torque=torque)


@pytest.fixture(scope="module")
def by_hand(pegasus, track):
    return step_by_hand(pegasus, track)


@pytest.fixture(scope="module")
def verdicts(pegasus, track):
    """Metered from the first sample and from a later one."""
    return [(alone(replay(pegasus, [TERRAIN], [track], FRICTION, first)), first) for first in (0, LATE)]


def steps_from(track, first):
    return slice(round((SETTLE + float(track.time[first])) / STEP), None)


def test_energy_time_and_distance_are_those_of_the_walk_after_settling(by_hand, verdicts, track):
    power = by_hand.torque * 0.5 * (by_hand.v[:, 6:] + by_hand.later_v[:, 6:])
    heat = (by_hand.torque / (0.217 * 44.5)) ** 2 * 2.28
    for verdict, first in verdicts:
        steps = steps_from(track, first)
        assert not verdict.fell
        np.testing.assert_allclose(verdict.time, 1.0 - float(track.time[first]), atol=1e-9)
        np.testing.assert_allclose(verdict.energy.joule, STEP * heat[steps].sum(), rtol=1e-3)
        np.testing.assert_allclose(verdict.energy.mechanical_positive, STEP * np.maximum(power, 0.0)[steps].sum(), rtol=1e-3)
        np.testing.assert_allclose(verdict.energy.mechanical, STEP * power[steps].sum(), rtol=1e-3)
        np.testing.assert_allclose(verdict.moved[:2], by_hand.later_q[-1, :2] - by_hand.q[steps][0, :2], atol=1e-6)
    (early, _), (late, _) = verdicts
    assert early.energy.joule - late.energy.joule > 1.0
    assert early.energy.mechanical_positive > 1.3 * late.energy.mechanical_positive


def loaded(walk, bodies):
    """Which feet carry more than a hundredth of the weight."""
    return walk.sensors[:, 12:16] > 0.01 * GRAVITY * bodies.model.body_mass.sum()


def test_slip_is_the_way_of_the_loaded_feet(by_hand, bodies, verdicts, track):
    feet, load = by_hand.sensors[:, :12].reshape(-1, 4, 3), loaded(by_hand, bodies)
    way = np.linalg.norm(np.diff(feet, axis=0), axis=-1) * (load[1:] & load[:-1])
    for verdict, first in verdicts:
        np.testing.assert_allclose(verdict.slip, way[steps_from(track, first).start - 1 :].sum(axis=0).mean(), rtol=1e-3)
    assert verdicts[0][0].slip > 1e-4


def test_margin_is_of_the_centre_of_mass_in_the_hull_of_the_loaded_feet(by_hand, bodies, verdicts, track):
    feet, load, com = by_hand.sensors[:, :12].reshape(-1, 4, 3), loaded(by_hand, bodies), by_hand.sensors[:, 16:19]
    for verdict, first in verdicts:
        margins = []
        for n in range(len(feet))[steps_from(track, first)][::10]:
            sides = ConvexHull(feet[n, load[n] | load[n - 1], :2]).equations  # no contact is lost in a single step
            margins.append(np.min(-sides[:, :2] @ com[n, :2] - sides[:, 2]))
        np.testing.assert_allclose(verdict.margin, min(margins), atol=1e-4)
    assert 0.02 < verdicts[0][0].margin < 0.15


def test_a_robot_that_has_settled_stands_on_its_touch_sensors_with_its_weight(by_hand):
    settled = by_hand.sensors[100:149]
    np.testing.assert_allclose(settled[:, 12:16].sum(axis=1), 35.2 * GRAVITY, rtol=5e-3)
    np.testing.assert_allclose(settled[-1, :12].reshape(4, 3)[:, :2], FEET, atol=3e-3)
    assert not settled[:, 19].any()
    assert np.ptp(by_hand.q[100:149, 7:], axis=0).max() < 1e-3  # held in the first pose


def test_a_walk_that_begins_in_motion_is_settled_at_rest_in_its_first_pose(pegasus, track):
    """Its first velocities would hold the joints off their angles by kd v / kp."""
    late = Reference(*(np.asarray(x)[4:] for x in track))._replace(time=np.asarray(track.time)[4:] - float(track.time[4]))
    walked = step_by_hand(pegasus, late)
    off = walked.q[145, 7:] - late.joint_pos[0].ravel()
    assert np.abs(off).max() < 4e-3 < 0.2 * np.abs(80.0 / 3000.0 * late.joint_vel[0]).max()
    verdict, steps = alone(replay(pegasus, [TERRAIN], [late], FRICTION)), steps_from(late, 0)
    power = walked.torque * 0.5 * (walked.v[:, 6:] + walked.later_v[:, 6:])
    np.testing.assert_allclose(verdict.energy.mechanical_positive, STEP * np.maximum(power, 0.0)[steps].sum(), rtol=0.02)
    np.testing.assert_allclose(
        verdict.energy.joule, STEP * ((walked.torque / (0.217 * 44.5)) ** 2 * 2.28)[steps].sum(), rtol=0.02
    )


def test_motors_are_controllers_with_their_gains_and_limits(pegasus):
    rng = np.random.default_rng(0)
    numbers = {"stiffness": 100.0, "velocity_gain": 10.0, "torque_limit": 50.0}
    numbers = {name: scale * rng.uniform(0.5, 1.5, (4, 3)) for name, scale in numbers.items()}
    robot = dataclasses.replace(pegasus, **{name: jnp.asarray(value) for name, value in numbers.items()})
    kp, kd, limit = (value.ravel() for value in numbers.values())
    model = build_model(robot, TERRAIN, FRICTION)
    data = mujoco.MjData(model)
    for _ in range(5):
        data.qpos[:] = np.concatenate([[0.0, 0.0, 3.0, 1.0, 0.0, 0.0, 0.0], rng.normal(size=12)])
        data.qvel[:], data.ctrl[:] = rng.normal(size=18), 40.0 * rng.normal(size=12)
        mujoco.mj_forward(model, data)
        expected = np.clip(data.ctrl - kp * data.qpos[7:] - kd * data.qvel[6:], -limit, limit)
        np.testing.assert_allclose(data.actuator_force, expected, rtol=1e-9)
        np.testing.assert_allclose(data.qfrc_actuator[6:], expected, rtol=1e-9)


def test_the_height_field_is_the_terrain(pegasus):
    """Rays straight down beside the corners of the field's cells, half as wide as the map's; more along x than along y, and
    beyond the map's border, where the ground goes on level."""
    model = build_model(pegasus, BUMPS, FRICTION)
    data = mujoco.MjData(model)
    data.qpos[2] = 50.0
    mujoco.mj_forward(model, data)
    surface, geom = jax.jit(jax.vmap(height, in_axes=(None, 0))), np.zeros(1, np.int32)
    x, y = np.meshgrid(-0.2 + 0.05 * np.arange(-5, 26), 0.5 + 0.05 * np.arange(-5, 18), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()]) + np.array([1e-5, 2e-5])  # a ray along an edge may miss both sides
    found = []
    for place in points:
        away = mujoco.mj_ray(model, data, np.array([*place, 5.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom, None)
        found.append(5.0 - away)
    np.testing.assert_allclose(found, surface(BUMPS, jnp.asarray(points)), atol=2e-4)
    assert np.ptp(found) > 0.3


def test_with_feedback_it_measures_the_same_walk_alike(pegasus, track, verdicts):
    """On level ground nothing leads off the plan, so that feedback changes little."""
    verdict, _ = verdicts[0]
    watched = follow_all(pegasus, [TERRAIN], [track], FRICTION)
    judged = alone(watched.verdict)
    assert not judged.fell
    np.testing.assert_allclose(judged.time, 1.0, atol=0.004)
    np.testing.assert_allclose(judged.energy.joule, verdict.energy.joule, rtol=0.05)
    np.testing.assert_allclose(judged.energy.mechanical_positive, verdict.energy.mechanical_positive, rtol=0.08)
    np.testing.assert_allclose(
        judged.energy.mechanical, verdict.energy.mechanical, atol=0.08 * verdict.energy.mechanical_positive
    )
    np.testing.assert_allclose(judged.slip, verdict.slip, rtol=0.5)
    np.testing.assert_allclose(watched.trunk[0], track.trunk_pos[-1], atol=5e-3)


def test_with_feedback_a_robot_that_stands_is_measured_as_statics_has_it(pegasus, bodies, track):
    """Heat of the holding torques for as long as it stands, no work, no slip, the margin of its stance."""
    still = track._replace(**{name: 0.0 * getattr(track, name) for name in ("joint_vel", "trunk_vel")})
    stands = type(track)(*(np.repeat(np.asarray(x)[:1], 5, axis=0) for x in still))._replace(time=np.linspace(0.0, 0.4, 5))
    watched = follow_all(pegasus, [TERRAIN], [stands], FRICTION)
    judged = alone(watched.verdict)
    assert not judged.fell
    np.testing.assert_allclose(judged.time, 0.4, atol=1e-9)
    heat = np.sum((np.asarray(track.joint_torque)[0] / (0.217 * 44.5)) ** 2 * 2.28)
    np.testing.assert_allclose(judged.energy.joule, 0.4 * heat, rtol=0.05)
    body = bodies(np.concatenate([np.asarray(x)[0].ravel() for x in (track.trunk_pos, track.trunk_quat, track.joint_pos)]))
    sides = ConvexHull(FEET).equations
    np.testing.assert_allclose(judged.margin, np.min(-sides[:, :2] @ body.com[:2] - sides[:, 2]), atol=2e-3)
    np.testing.assert_allclose(watched.shots[0, 0, :3], track.trunk_pos[0], atol=1e-4)  # the plan's torques hold it
    assert abs(judged.energy.mechanical) < 1e-2
    assert judged.slip < 1e-4


def test_on_a_slippery_slope_it_slides_down_by_the_friction_it_was_told(pegasus, bodies):
    """g (sin - mu cos) along the slope, from the settling on; the trunk is parallel to the ground, legs all alike."""
    angles = np.tile([0.0, -0.7, 1.3], (4, 1))
    drop = bodies(np.concatenate([np.zeros(3), [1.0, 0.0, 0.0, 0.0], angles.ravel()])).feet[0, 2]
    half = 0.5 * np.arctan(0.25)
    up = np.array([-0.25, 0.0, 1.0]) / np.hypot(0.25, 1.0)
    rows = (
        angles,
        np.zeros((4, 3)),
        np.zeros((4, 3)),
        (0.004 - drop) * up,
        [np.cos(half), 0.0, -np.sin(half), 0.0],
        np.zeros(6),
    )
    held = [np.repeat(np.asarray(x, float)[None], 2, axis=0) for x in (*rows, np.zeros((4, 3)), np.ones(4))]
    verdict = alone(replay(pegasus, [sloping(0.25, 0.0)], [Reference(np.array([0.0, 0.7]), *held)], 0.1))
    way = 0.5 * GRAVITY * (0.25 - 0.1) * (1.0**2 - 0.3**2) / (1.0 + 0.25**2)
    assert not verdict.fell
    np.testing.assert_allclose(verdict.moved[0], -way, rtol=0.05)


def test_each_lane_has_a_robot_and_a_friction_of_its_own(pegasus, track):
    """Lanes side by side are what each is alone."""
    weak = dataclasses.replace(pegasus, stiffness=0.3 * pegasus.stiffness)
    lanes = [(pegasus, 0.8), (weak, 0.8), (pegasus, 0.02)]
    robots, frictions = ([lane[i] for lane in lanes] for i in (0, 1))
    together = replay_each(robots, [TERRAIN] * 3, [track] * 3, frictions)
    each = [replay(robot, [TERRAIN], [track], friction) for robot, friction in lanes]
    jax.tree.map(np.testing.assert_array_equal, together, jax.tree.map(lambda *x: np.concatenate(x), *each))
    assert len(np.unique(together.energy.mechanical)) == 3


def test_a_controller_of_another_tick_is_refused(pegasus, track):
    rows = jax.tree.map(lambda x: np.asarray(x)[None], track)
    wrong = jax.vmap(course, in_axes=(0, 0, None))(rows, np.array([3], np.int32), jnp.asarray(0.0025))
    with pytest.raises(ValueError, match=r"controllers\.dt is 0\.0025 s, but must be PERIOD = 0\.004 s"):
        lockstep(pegasus, [TERRAIN], wrong, [track], FRICTION, 4)
