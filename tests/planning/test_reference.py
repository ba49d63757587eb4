"""The reference: exact rates, and feed-forward torque that is statics at rest and Newton's law in motion."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.energy import CONVENTIONS, electrical, motor_power
from jaxleg.gait import SWING_LEG
from jaxleg.kinematics import foot_position
from jaxleg.plan import PlanStatus
from jaxleg.planning.proxy import evaluate
from jaxleg.planning.reference import instant, phase_samples, reference
from tests.planning.conftest import gait, settings

SAMPLES = (60, 50)


@pytest.fixture(scope="module")
def planned(walk_on, pegasus):
    walk = walk_on(gait(), "rough")
    return walk, jax.jit(lambda w: reference(pegasus, w, settings(), SAMPLES))(walk)


def test_feet_are_where_the_plan_puts_them(planned, pegasus):
    _, track = planned
    forward = jax.vmap(jax.vmap(foot_position), in_axes=(None, None, 0))
    in_trunk = forward(pegasus.joint_axis, pegasus.link_offset, track.joint_pos) + pegasus.hip_position[None]
    pitch = 2.0 * np.arctan2(-track.trunk_quat[:, 2], track.trunk_quat[:, 0])
    c, s = np.cos(pitch)[:, None], np.sin(pitch)[:, None]
    x = c * in_trunk[..., 0] - s * in_trunk[..., 2]
    z = s * in_trunk[..., 0] + c * in_trunk[..., 2]
    world = np.stack([x, in_trunk[..., 1], z], axis=-1) + np.asarray(track.trunk_pos)[:, None]
    np.testing.assert_allclose(world, track.foot_pos, atol=1e-9)


def test_velocities_are_the_derivatives_of_the_angles(planned, pegasus):
    walk, _ = planned
    shares = jnp.array([0.13, 0.31, 0.47, 0.66, 0.89])
    at = jax.jit(lambda i, s: instant(pegasus, walk, settings(), jax.tree.map(lambda x: x[i], walk.phases), s))
    for phase in (6, 7, 11):
        for share in shares:
            h = 1e-5
            here, ahead, behind = at(phase, share), at(phase, share + h), at(phase, share - h)
            seconds = 2 * h * walk.phases.duration[phase]
            np.testing.assert_allclose((ahead.angles - behind.angles) / seconds, here.velocity, atol=1e-5)


def test_standing_torques_hold_the_weight(planned, pegasus):
    """Between the phases nothing moves: the ground carries the weight, so J^T f of the feet balances gravity."""
    walk, track = planned
    phase, share = phase_samples(SAMPLES, SWING_LEG * 2)
    rest = np.flatnonzero((share == 0.0) & (phase > 0))[0]
    assert np.abs(track.joint_vel[rest]).max() < 1e-9
    light = dataclasses.replace(pegasus, link_mass=pegasus.link_mass * 1e-9, link_inertia=pegasus.link_inertia * 1e-9)
    first = jax.tree.map(lambda x: x[int(phase[rest])], walk.phases)
    at = instant(light, walk, settings(), first, 0.0)
    np.testing.assert_allclose(jnp.sum(at.load), light.mass * 9.81, rtol=1e-6)


def test_the_samples_are_those_of_the_phases(planned):
    walk, track = planned
    phase, _ = phase_samples(SAMPLES, SWING_LEG * 2)
    assert track.time.shape == (2 * (2 * 60 + 4 * 50) + 1,)
    assert np.all(np.diff(track.time) > 0)
    np.testing.assert_allclose(track.time[-1], jnp.sum(walk.cycle_time))
    np.testing.assert_allclose(track.time[np.flatnonzero(np.diff(phase)) + 1], walk.phases.start[1:])
    np.testing.assert_allclose(jnp.linalg.norm(track.trunk_quat, axis=1), 1.0)


@pytest.fixture(scope="module")
def proxy():
    return jax.jit(lambda robot, walk: evaluate(robot, walk, settings()))


def test_the_proxy_is_the_integral_of_the_reference(planned, pegasus, proxy):
    walk, _ = planned
    fine = jax.jit(lambda w: reference(pegasus, w, settings(), (400, 400)))(walk)
    power = motor_power(pegasus, fine.joint_torque, fine.joint_vel)
    seconds = np.diff(fine.time)[:, None, None]
    seen = proxy(pegasus, walk)
    integral = jax.tree.map(lambda p: np.sum(0.5 * (p[1:] + p[:-1]) * seconds), power)
    total = jax.tree.map(jnp.sum, seen.energy)
    for convention in CONVENTIONS:
        np.testing.assert_allclose(electrical(total, convention), electrical(integral, convention), rtol=3e-3)


@pytest.mark.parametrize("knee_deg", [(48.0, 156.0), (-180.0, 40.0), (20.0, 150.0)])
def test_the_room_of_the_joints_is_the_least_over_the_walk(planned, pegasus, proxy, knee_deg):
    walk, track = planned
    spans = np.deg2rad([[-30.0, 40.0], [-100.0, 100.0], knee_deg])
    robot = dataclasses.replace(pegasus, joint_range=jnp.broadcast_to(spans, (4, 3, 2)))
    angles = np.asarray(track.joint_pos)
    room = np.minimum(angles - spans[:, 0], spans[:, 1] - angles).min()
    np.testing.assert_allclose(proxy(robot, walk).checks.joint_room, room, atol=2e-3)


@pytest.mark.parametrize("spoilt", ["waypoints", "cycle_time", "footholds"])
def test_a_walk_that_is_not_finite_is_never_ok(planned, pegasus, proxy, spoilt):
    """The phases are made of all three."""
    walk, _ = planned
    parts = {"waypoints": "trunk_to", "cycle_time": "duration", "footholds": "feet_to"}
    phases = walk.phases._replace(**{parts[spoilt]: getattr(walk.phases, parts[spoilt]).at[3].set(jnp.nan)})
    bad = walk._replace(phases=phases, **{spoilt: jnp.full_like(getattr(walk, spoilt), jnp.nan)})
    assert proxy(pegasus, bad).checks.status == PlanStatus.NOT_FINITE
