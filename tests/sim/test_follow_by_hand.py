"""Feedback and felt forces by hand: interpolation and its ends, the held feet's time constant, the law to first order."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.control.contract import State
from jaxleg.control.course import Posture, command, corrected, course, held_feet
from jaxleg.control.sensing import Joints, Smoothed, at_rest, felt_forces, measured, smoothed
from jaxleg.control.swing_leg import feeling
from jaxleg.leg.dynamics import all_leg_frames
from jaxleg.leg.kinematics import foot_jacobian, foot_position
from jaxleg.posture.body import joint_angles
from jaxleg.rotations import trunk_quaternion, trunk_rotation
from jaxleg.walk.between import at_time
from jaxleg.walk.data import Reference

SHAPES = ((), (4, 3), (4, 3), (4, 3), (3,), (4,), (6,), (4, 3), (4,))
FEET = np.array([[0.36, 0.2, 0.03], [0.28, -0.2, 0.0], [-0.28, 0.2, 0.01], [-0.36, -0.2, -0.02]])
PLANNED = np.array([0.02, 0.01, 0.46, 0.05, -0.04, 0.3])
OFF = np.array([0.6, -0.5, 0.4, 0.7, -0.8, 0.9])  # of the trunk, times a small number
SLIPPED = np.random.default_rng(0).normal(size=(4, 3))
look, rotation_of = jax.jit(at_time), jax.jit(trunk_rotation)


def sample(seed, time):
    rng = np.random.default_rng(seed)
    return Reference(np.asarray(time), *(np.asarray(rng.normal(size=shape)) for shape in SHAPES[1:]))


LOW, HIGH = sample(0, 1.0), sample(1, 1.4)


@pytest.mark.parametrize(("time", "end"), [(0.3, LOW), (1.0, LOW), (1.4, HIGH), (9.0, HIGH)])
def test_outside_the_interval_it_is_the_nearer_sample(time, end):
    for found, expected in zip(look(LOW, HIGH, time), end):
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_inside_everything_is_linear_but_the_angles_which_keep_their_rates_at_the_ends():
    """Hermite's polynomial at a quarter: 27/32 and 5/32 of the values, 9/64 and -3/64 of the interval times the rates."""
    row = look(LOW, HIGH, 1.1)
    for name in set(Reference._fields) - {"joint_pos"}:
        np.testing.assert_allclose(getattr(row, name), 0.75 * getattr(LOW, name) + 0.25 * getattr(HIGH, name), atol=1e-12)
    hermite = (27.0 * LOW.joint_pos + 5.0 * HIGH.joint_pos) / 32.0
    hermite += 0.4 * (9.0 * LOW.joint_vel - 3.0 * HIGH.joint_vel) / 64.0
    np.testing.assert_allclose(row.joint_pos, hermite, atol=1e-12)


def test_a_command_has_the_angles_of_now_the_velocity_of_the_end_and_the_torque_of_the_middle():
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    low, high = (x._replace(trunk_pos=PLANNED[:3], trunk_quat=upright, foot_pos=FEET) for x in (LOW, HIGH))
    on_plan = Posture(PLANNED[:3], upright, FEET, np.broadcast_to(np.eye(3), (4, 3, 3)))
    order = jax.jit(command)(low, high, 1.1, 0.1, on_plan)
    np.testing.assert_allclose(order.position, look(LOW, HIGH, 1.1).joint_pos, atol=1e-12)
    np.testing.assert_allclose(order.velocity, 0.5 * LOW.joint_vel + 0.5 * HIGH.joint_vel, atol=1e-12)
    np.testing.assert_allclose(order.torque, 0.625 * LOW.joint_torque + 0.375 * HIGH.joint_torque, atol=1e-12)
    np.testing.assert_allclose(order.dt, 0.1)


def test_a_course_begins_with_the_feet_where_the_plan_has_them_at_first():
    both = Reference(*(jnp.stack([low, high]) for low, high in zip(LOW, HIGH)))
    begun = course(both, jnp.asarray(1, jnp.int32), jnp.asarray(0.002)).start()
    np.testing.assert_array_equal(begun.held, LOW.foot_pos)
    assert begun.index == begun.ticks == 0


@jax.jit
def wait(away, load):
    """A second of 500 ticks."""
    return jax.lax.fori_loop(0, 500, lambda _, held: held_feet(held, jnp.zeros((4, 3)), load, jnp.asarray(0.002)), away)


@pytest.mark.parametrize(("load", "left"), [(1.0, np.exp(-1.0)), (0.51, np.exp(-1.0)), (0.49, 0.0), (0.0, 0.0)])
def test_a_standing_foots_slip_is_forgotten_in_a_second(load, left):
    """To 1/e; a foot that carries less than half its load is where it is."""
    np.testing.assert_allclose(wait(np.full((4, 3), 0.02), np.full(4, load)), 0.02 * left, rtol=2e-3)


@pytest.fixture(scope="module")
def law(pegasus):
    """Feet in B by the corrected angles, for a trunk and feet off their plan."""

    @jax.jit
    def run(size, contact):
        planned, planned_feet = jnp.asarray(PLANNED), jnp.asarray(FEET)
        angles, _ = joint_angles(pegasus, planned, planned_feet)
        zero, turn = jnp.zeros((4, 3)), trunk_quaternion(planned[3:])
        row = Reference(jnp.array(0.0), angles, zero, zero, planned[:3], turn, jnp.zeros(6), planned_feet, contact)
        pose, feet = planned + size * OFF, planned_feet + size * SLIPPED
        jacobian = jnp.einsum("ij,ljk->lik", trunk_rotation(pose[3:]), jax.vmap(foot_jacobian)(all_leg_frames(pegasus, angles)))
        wanted = corrected(row, Posture(pose[:3], trunk_quaternion(pose[3:]), feet, jacobian))
        return jax.vmap(foot_position)(pegasus.joint_axis, pegasus.link_offset, wanted) + pegasus.hip_position

    return lambda size, contact: np.asarray(run(size, contact))


def places(size):
    """Feet in B as the law wants them, standing: planned trunk, feet as they stand; swinging: trunk as it is, planned feet."""
    planned, actual = (np.asarray(rotation_of(turn)) for turn in (PLANNED[3:], (PLANNED + size * OFF)[3:]))
    standing = (FEET + size * SLIPPED - PLANNED[:3]) @ planned
    swinging = (FEET - (PLANNED + size * OFF)[:3]) @ actual
    return standing, swinging


@pytest.mark.parametrize("load", [1.0, 0.7, 0.2, 0.0])
def test_the_law_moves_the_foot_by_what_it_should_to_first_order(law, load):
    """Ten times nearer to the plan it is a hundred times nearer to the mark; loads blend."""
    errors = []
    for size in (1e-3, 1e-4):
        standing, swinging = places(size)
        wanted = load * standing + (1.0 - load) * swinging
        errors.append(np.abs(law(size, np.full(4, load)) - wanted).max())
        assert np.abs(wanted - places(0.0)[0]).max() > 0.5 * size
    assert errors[0] < 3e-5
    assert errors[1] < 0.02 * errors[0]


def test_each_leg_goes_by_its_own_load(law):
    standing, swinging = places(1e-4)
    found = law(1e-4, np.array([1.0, 0.0, 1.0, 0.0]))
    np.testing.assert_allclose(found[::2], standing[::2], atol=1e-6)
    np.testing.assert_allclose(found[1::2], swinging[1::2], atol=1e-6)


def test_what_a_leg_feels_is_the_force_that_was_put_on_it(bodies, pegasus):
    """A trunk held still at any turn, its legs moving under torques and forces on the feet by MuJoCo's equation of motion."""
    lossy = dataclasses.replace(pegasus, joint_damping=3.0 * pegasus.joint_damping)
    rng, turn, feel = np.random.default_rng(3), np.array([0.2, -0.1, 0.7]), jax.jit(felt_forces)
    for _ in range(4):
        angles = np.tile([0.0, -0.7, 1.3], (4, 1)) + 0.3 * rng.normal(size=(4, 3))
        rate, torque, force = rng.normal(size=(4, 3)), 20.0 * rng.normal(size=(4, 3)), 80.0 * rng.normal(size=(4, 3))
        q = np.concatenate([rng.normal(size=3), trunk_quaternion(jnp.asarray(turn)), angles.ravel()])
        body = bodies(q, np.concatenate([np.zeros(6), rate.ravel()]))
        push = torque.ravel() - np.asarray(lossy.joint_damping).ravel() * rate.ravel()
        push = push + np.einsum("lik,li->k", body.jacobian, force)[6:] - body.bias[6:]
        acceleration = np.linalg.solve(body.mass[6:, 6:], push).reshape(4, 3)
        joints = Joints(Smoothed(angles, rate, acceleration), Smoothed(torque, *np.zeros((2, 4, 3))), jnp.zeros((), jnp.int32))
        senses = feeling(lossy).senses
        np.testing.assert_allclose(feel(lossy, senses, joints, turn), force, atol=1e-6)
        blind = feel(lossy, dataclasses.replace(senses, inertia=jnp.asarray(0.0)), joints, turn)
        legs = (body.mass[6:, 6:] @ acceleration.ravel()).reshape(4, 3)
        missing = [np.linalg.solve(body.jacobian[i, :, 6 + 3 * i : 9 + 3 * i].T, legs[i]) for i in range(4)]
        np.testing.assert_allclose(blind, force - np.stack(missing), atol=1e-6)


def test_a_leg_that_is_believed_too_heavy_feels_the_difference_of_its_weight_at_rest(bodies, pegasus):
    """Links 10 % heavier in the model: a still leg in the air feels the ground hold a tenth of its gravity torque."""
    angles = np.tile([0.05, -0.6, 1.2], (4, 1))
    q = np.concatenate([np.zeros(3), [1.0, 0.0, 0.0, 0.0], angles.ravel()])
    body, still = bodies(q), np.zeros((4, 3))
    weight = body.bias[6:].reshape(4, 3)
    joints = Joints(Smoothed(angles, still, still), Smoothed(weight, still, still), jnp.zeros((), jnp.int32))
    felt = jax.jit(felt_forces)(pegasus, feeling(pegasus, mass_error=0.1).senses, joints, jnp.zeros(3))
    wanted = [np.linalg.solve(body.jacobian[i, :, 6 + 3 * i : 9 + 3 * i].T, 0.1 * weight[i]) for i in range(4)]
    np.testing.assert_allclose(felt, wanted, atol=1e-6)
    assert np.abs(felt).max() > 0.3  # N


def test_the_low_pass_lags_a_ramp_by_its_delay_and_finds_rate_and_acceleration():
    """x = 3 t + 2 t^2 after a while: rate and acceleration those of `delay` before; both exact for small dt."""
    dt, delay, time = 1e-4, 0.02, np.arange(4000) * 1e-4

    def tick(past, now):
        after = smoothed(past, now, jnp.asarray(delay), dt)
        return after, after

    zero = jnp.zeros(1)
    _, seen = jax.lax.scan(tick, Smoothed(zero, zero, zero), jnp.asarray(3.0 * time + 2.0 * time**2)[:, None])
    late = time[-1] + dt - delay
    np.testing.assert_allclose(seen.acceleration[-1], 4.0, rtol=1e-6)
    np.testing.assert_allclose(seen.rate[-1], 3.0 + 4.0 * late, rtol=2e-3)
    spread = 2.0 * 2.0 * (0.5 * delay) ** 2  # a second-order pass delays a parabola a little more
    np.testing.assert_allclose(seen.value[-1], 3.0 * late + 2.0 * late**2 + spread, rtol=2e-3)


def test_noise_is_as_strong_as_told_and_friction_rubs_against_the_motion(pegasus):
    """Many ticks of a standing robot, unfiltered (delay ~ 0), and one of a moving one."""
    senses = feeling(pegasus, delay=1e-9, torque_noise=2.0, friction=1.5).senses
    q = jnp.zeros(19).at[3].set(1.0)

    def tick(joints, speed):
        after = measured(senses, joints, jnp.zeros((4, 3)), State(q, jnp.zeros(18).at[6:].set(speed)), 0.0025)
        return after, after.torque.value

    still = jnp.zeros((4, 3))
    _, torque = jax.lax.scan(tick, at_rest(still, still), jnp.concatenate([jnp.zeros(2000), jnp.full(2000, -0.5)]))
    np.testing.assert_allclose(np.std(torque[:2000], axis=0), 2.0, rtol=0.1)
    np.testing.assert_allclose(np.mean(torque[:2000], axis=0), 0.0, atol=0.2)
    np.testing.assert_allclose(np.mean(torque[2000:], axis=0), -1.5, atol=0.2)
