"""Every meter recomputed from the states of a walk that was stepped by hand, MuJoCo's kinematics and plain formulas.

The energy that the motors give is what the robot has more (MuJoCo's energies), what its joints lose and what the ground takes.
"""

import dataclasses
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from jaxleg.control.contract import Tracking
from jaxleg.control.tracking import interpolate
from jaxleg.leg.energy import electrical
from jaxleg.sim.contact import Ground
from jaxleg.sim.referee import replay
from jaxleg.sim.rollout import simulate
from jaxleg.sim.step import initial_state
from tests.motions import SWINGS, applied_torque, contact_force, shift_and_step, sloping

GROUND, TERRAIN = Ground(), sloping(0.0, 0.0)
SECONDS, SAMPLES, EACH = (0.5, 0.5), (10, 16), 36  # steps an interval
LATE = 4  # sample from which the meters count
COUNT, FIRST = sum(SAMPLES) * EACH, LATE * EACH


begin = jax.jit(lambda robot, track: (interpolate(track, EACH), initial_state(robot, GROUND, track)))


@pytest.fixture(scope="module")
def track(pegasus):
    return jax.tree.map(np.asarray, shift_and_step(pegasus, TERRAIN, SECONDS, SAMPLES))


@pytest.fixture(scope="module")
def metered(engine):
    """Meters from the sample `LATE` on, in the middle of the shift."""
    return jax.jit(lambda robot, track: simulate(engine, robot, GROUND, TERRAIN, track, EACH, LATE))


@pytest.fixture(scope="module")
def by_hand(pegasus, bodies, roll, track):
    """Everything about the walk, step by step, from its states."""
    tracking, start = jax.tree.map(np.asarray, begin(pegasus, track))
    states, seen = roll(pegasus, GROUND, TERRAIN, start, tracking)
    q, v = (np.concatenate([np.asarray(a)[None], np.asarray(b)]) for a, b in zip(start, states))
    dt, radius = np.asarray(tracking.dt), float(pegasus.contact_radius)
    rows = []
    for n in range(COUNT):
        body = bodies(q[n], v[n])
        now, moving, later = Tracking(*(x[n] for x in tracking)), body.jacobian @ v[n], body.jacobian @ v[n + 1]
        force = np.stack(
            [contact_force(GROUND, radius, (0.0, 0.0), body.feet[i], moving[i], later[i], dt[n]) for i in range(4)]
        )
        rows.append(
            dict(
                torque=applied_torque(pegasus, now, q[n], v[n], v[n + 1]),
                energy=body.energy,
                force=force,
                work=np.sum(force * (body.jacobian @ (v[n] + v[n + 1]) / 2.0)),
                slides=np.linalg.norm(later[:, :2], axis=1),
                depth=radius - body.feet[:, 2],
                feet=body.feet,
                com=body.com,
            )
        )
    columns = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    return SimpleNamespace(q=q, v=v, dt=dt, seen=seen, end=bodies(q[-1], v[-1]).energy, **columns)


def power_of(walk):
    """By joint [W]: with regeneration, without, and heat, from the motor's printed numbers."""
    mechanical = walk.torque * 0.5 * (walk.v[1:, 6:] + walk.v[:-1, 6:])
    return mechanical, np.maximum(mechanical, 0.0), (walk.torque / (0.217 * 44.5)) ** 2 * 2.28


def test_energy_is_torque_times_midstep_speed_and_the_windings_heat(metered, by_hand, pegasus, track):
    meters = metered(pegasus, track)
    assert not meters.fell
    for found, watts in zip(meters.energy, power_of(by_hand)):
        np.testing.assert_allclose(found, (by_hand.dt[:, None] * watts)[FIRST:].sum(axis=0).reshape(4, 3), rtol=1e-6, atol=1e-7)
    mechanical, driving, heat = (np.sum((by_hand.dt[:, None] * watts)[FIRST:]) for watts in power_of(by_hand))
    braking = driving - mechanical
    assert min(driving, braking) > 1.0
    for name, joules in (("net", mechanical + heat), ("positive", driving + heat), ("absolute", driving + braking + heat)):
        np.testing.assert_allclose(np.sum(electrical(meters.energy, name)), joules, rtol=1e-7)


def loads(walk, bodies):
    """Which feet carry more than a hundredth of the weight."""
    return walk.force[..., 2] > 0.01 * 9.81 * bodies.model.body_mass.sum()


def test_distance_time_and_slip_add_up(metered, by_hand, bodies, pegasus, track):
    meters, pressed = metered(pegasus, track), loads(by_hand, bodies)[FIRST:]
    assert np.sum(~pressed) > 100
    np.testing.assert_allclose(meters.moved, by_hand.q[-1, :2] - by_hand.q[FIRST, :2], atol=1e-9)
    np.testing.assert_allclose(meters.time, sum(SECONDS) - 0.2)
    ways = by_hand.dt[FIRST:, None] * by_hand.slides[FIRST:]
    slip = np.sum(ways * pressed, axis=0)
    np.testing.assert_allclose(meters.slip, slip, rtol=1e-6, atol=1e-9)
    assert np.all(slip > 1e-5)
    assert slip[SWINGS] < 0.2 * ways.sum(axis=0)[SWINGS]  # the swing is none


def test_the_extremes_are_those_of_the_steps(metered, by_hand, bodies, pegasus, track):
    meters, pressed = metered(pegasus, track), loads(by_hand, bodies)
    assert np.all(pressed.sum(axis=1) >= 3)
    margin = np.empty(COUNT)
    for n in range(COUNT):
        sides = ConvexHull(by_hand.feet[n, pressed[n], :2]).equations
        margin[n] = np.min(-sides[:, :2] @ by_hand.com[n, :2] - sides[:, 2])
    up = Rotation.from_quat(np.roll(by_hand.q[1:, 3:7], -1, axis=1)).as_matrix()[:, 2, 2]
    np.testing.assert_allclose(meters.penetration, by_hand.depth[FIRST:].max(), rtol=1e-7)
    np.testing.assert_allclose(meters.margin, margin[FIRST:].min(), atol=1e-7)
    np.testing.assert_allclose(meters.tilt, np.arccos(up[FIRST:].min()), atol=1e-6)


def test_the_motors_work_is_what_the_robot_has_more_and_joints_and_ground_have_taken(metered, by_hand, pegasus, track):
    """From full motion to rest. Kinetic and potential energy are MuJoCo's; what is left is the step's own error."""
    meters = metered(pegasus, track)
    middle = 0.5 * (by_hand.v[1:, 6:] + by_hand.v[:-1, 6:])
    lost = np.asarray(pegasus.joint_damping).ravel() * by_hand.v[1:, 6:] * middle
    damping = np.sum((by_hand.dt[:, None] * lost)[FIRST:])
    ground = -np.sum((by_hand.dt * by_hand.work)[FIRST:])
    gain = by_hand.end - by_hand.energy[FIRST]
    motors = float(np.sum(meters.energy.mechanical))
    moved = float(np.sum(electrical(meters.energy, "absolute") - meters.energy.joule))
    assert min(abs(gain), damping, ground) > 0.01 * moved
    assert abs(motors - gain - damping - ground) < 1e-3 * moved


def test_a_robot_that_is_too_weak_falls_is_flagged_and_measured_no_further(metered, roll, pegasus, track):
    """The step of the fall from the states: trunk below half its height over the feet, or tilted by more than 45 degrees."""
    weak = dataclasses.replace(pegasus, torque_limit=0.05 * pegasus.torque_limit)
    tracking, start = begin(weak, track)
    states, seen = roll(weak, GROUND, TERRAIN, start, tracking)
    q, feet = np.asarray(states.q), np.asarray(seen.foot)
    stand = float(start.q[2]) - np.mean(np.asarray(track.foot_pos)[0, :, 2])
    low = q[:, 2] - feet[:, :, 2].mean(axis=1) < 0.5 * stand
    tilted = Rotation.from_quat(np.roll(q[:, 3:7], -1, axis=1)).as_matrix()[:, 2, 2] < np.cos(np.pi / 4)
    falls = int(np.argmax(low | tilted))
    assert FIRST < falls < COUNT - 50
    meters, dt = metered(weak, track), np.asarray(tracking.dt)
    assert meters.fell
    np.testing.assert_allclose(meters.time, dt[FIRST:falls].sum(), rtol=1e-9)
    joule = np.sum((dt[:, None, None] * np.asarray(seen.power.joule))[FIRST:falls], axis=0)
    np.testing.assert_allclose(meters.energy.joule, joule, rtol=1e-6)
    np.testing.assert_allclose(meters.moved, q[falls - 1, :2] - q[FIRST - 1, :2], atol=1e-9)
    assert replay(weak, [TERRAIN], [track], 0.8).fell[0]


def test_c_mujoco_measures_the_same_walk_alike(metered, pegasus, track):
    """Other contacts, another integrator, another step."""
    meters, verdict = metered(pegasus, track), replay(pegasus, [TERRAIN], [track], 0.8, LATE)
    verdict = jax.tree.map(lambda x: x[0], verdict)
    assert not verdict.fell
    np.testing.assert_allclose(verdict.time, meters.time, atol=0.003)
    np.testing.assert_allclose(verdict.moved[:2], meters.moved, atol=4e-3)  # within a twentieth of its greater part
    np.testing.assert_allclose(verdict.energy.joule, np.sum(meters.energy.joule), rtol=0.05)
    driving, mechanical = (float(np.sum(x)) for x in (meters.energy.mechanical_positive, meters.energy.mechanical))
    np.testing.assert_allclose(verdict.energy.mechanical_positive, driving, rtol=0.05)
    np.testing.assert_allclose(verdict.energy.mechanical, mechanical, atol=0.05 * driving)
    # With straight lines between the samples the referee was 4 mm nearer: on four times as many samples it is not.
    np.testing.assert_allclose(verdict.margin, meters.margin, atol=0.013)
