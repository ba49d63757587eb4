"""The reference: exact rates, and feed-forward torque that is statics at rest and Newton's law in motion."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.gait.order import SWING_LEG
from jaxleg.leg.energy import CONVENTIONS, electrical, motor_power
from jaxleg.leg.kinematics import foot_position
from jaxleg.status import Status
from jaxleg.walk.proxy import evaluate
from jaxleg.walk.reference import at_places, phase_instant, phase_samples, reference
from tests.crawls import gait

SAMPLES = (400, 380)


@jax.jit
def sampled(robot, walk):
    return reference(robot, walk, SAMPLES)


@jax.jit
def instant_at(robot, walk, phase, share):
    phase = jax.tree.map(lambda x: x[phase], walk.phases)
    return phase_instant(robot, phase, share, walk.load_share)


@jax.jit
def proxy(robot, walk):
    return evaluate(robot, walk)


@pytest.fixture(scope="module")
def planned(walk_on, pegasus):
    walk = walk_on(gait(), "rough")
    return walk, jax.tree.map(np.asarray, sampled(pegasus, walk))


def test_feet_are_where_the_plan_puts_them(planned, pegasus):
    _, track = planned
    forward = jax.jit(jax.vmap(jax.vmap(foot_position), in_axes=(None, None, 0)))
    in_trunk = np.add(forward(pegasus.joint_axis, pegasus.link_offset, track.joint_pos), pegasus.hip_position)
    pitch = 2.0 * np.arctan2(-track.trunk_quat[:, 2], track.trunk_quat[:, 0])
    c, s = np.cos(pitch)[:, None], np.sin(pitch)[:, None]
    x = c * in_trunk[..., 0] - s * in_trunk[..., 2]
    z = s * in_trunk[..., 0] + c * in_trunk[..., 2]
    world = np.stack([x, in_trunk[..., 1], z], axis=-1) + track.trunk_pos[:, None]
    np.testing.assert_allclose(world, track.foot_pos, atol=1e-9)


def test_velocities_are_the_derivatives_of_the_angles(planned, pegasus):
    walk, _ = planned
    for phase in (6, 7, 11):
        for share in (0.13, 0.31, 0.47, 0.66, 0.89):
            h = 1e-5
            here, ahead, behind = (instant_at(pegasus, walk, phase, share + k * h) for k in (0, 1, -1))
            seconds = 2 * h * walk.phases.duration[phase]
            np.testing.assert_allclose(np.subtract(ahead.angles, behind.angles) / seconds, here.velocity, atol=1e-5)


def test_many_instants_at_once_are_those_one_by_one(planned, pegasus):
    walk, _ = planned
    index, share = np.array([0, 1, 3, 5]), jnp.asarray([0.3, 0.05, 0.5, 0.97])
    many = jax.jit(lambda robot, walk: phase_instant(robot, *at_places(walk.phases, index, share), walk.load_share))
    together = jax.device_get(many(pegasus, walk))
    for k, phase in enumerate(index):
        alone = jax.device_get(instant_at(pegasus, walk, phase, share[k]))
        for name, one, all_ in zip(alone._fields, alone, together):
            np.testing.assert_allclose(all_[..., k], one, rtol=1e-9, atol=1e-9, err_msg=name)


def test_standing_torques_hold_the_weight(planned, pegasus):
    """Between the phases nothing moves: the ground carries the weight, so J^T f of the feet balances gravity."""
    walk, track = planned
    phase, share = phase_samples(SAMPLES, SWING_LEG * 2)
    rest = np.flatnonzero((share == 0.0) & (phase > 0))[0]
    assert np.abs(track.joint_vel[rest]).max() < 1e-9
    light = dataclasses.replace(pegasus, link_mass=pegasus.link_mass * 1e-9, link_inertia=pegasus.link_inertia * 1e-9)
    at = instant_at(light, walk, int(phase[rest]), 0.0)
    np.testing.assert_allclose(np.sum(at.load), light.mass * 9.81, rtol=1e-6)


def test_the_samples_are_those_of_the_phases(planned):
    walk, track = planned
    phase, _ = phase_samples(SAMPLES, SWING_LEG * 2)
    assert track.time.shape == (2 * (2 * 400 + 4 * 380) + 1,)
    assert np.all(np.diff(track.time) > 0)
    np.testing.assert_allclose(track.time[-1], walk.phases.duration.sum())
    np.testing.assert_allclose(track.time[np.flatnonzero(np.diff(phase)) + 1], walk.phases.start[1:])
    np.testing.assert_allclose(np.linalg.norm(track.trunk_quat, axis=1), 1.0)


def test_the_proxy_is_the_integral_of_the_reference(planned, pegasus):
    walk, track = planned
    power = jax.tree.map(np.asarray, jax.jit(motor_power)(pegasus, track.joint_torque, track.joint_vel))
    seconds = np.diff(track.time)[:, None, None]
    seen = proxy(pegasus, walk)
    integral = jax.tree.map(lambda p: jnp.asarray(np.sum(0.5 * (p[1:] + p[:-1]) * seconds)), power)
    total = jax.tree.map(lambda x: jnp.asarray(np.sum(x)), seen.energy)
    for convention in CONVENTIONS:
        np.testing.assert_allclose(electrical(total, convention), electrical(integral, convention), rtol=3e-3)


@pytest.mark.parametrize("knee_deg", [(48.0, 156.0), (-180.0, 40.0), (20.0, 150.0)])
def test_the_room_of_the_joints_is_the_least_over_the_walk(planned, pegasus, knee_deg):
    walk, track = planned
    spans = np.deg2rad([[-30.0, 40.0], [-100.0, 100.0], knee_deg])
    robot = dataclasses.replace(pegasus, joint_range=jnp.asarray(np.broadcast_to(spans, (4, 3, 2))))
    room = np.minimum(track.joint_pos - spans[:, 0], spans[:, 1] - track.joint_pos).min()
    np.testing.assert_allclose(proxy(robot, walk).checks.joint_room, room, atol=2e-3)


@pytest.mark.parametrize("spoilt", ["trunk_to", "duration", "feet_to"])
def test_a_walk_that_is_not_finite_is_never_ok(planned, pegasus, spoilt):
    """The phases are made of all three."""
    walk, _ = planned
    rows = getattr(walk.phases, spoilt).copy()
    rows[3] = np.nan
    bad = dataclasses.replace(walk, phases=walk.phases._replace(**{spoilt: rows}))
    assert proxy(pegasus, bad).checks.status == Status.NOT_FINITE
