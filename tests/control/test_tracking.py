"""What the controllers follow: exact for cubic motions, and its steps fill the reference's time."""

import itertools

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.control.tracking import interpolate
from jaxleg.walk.data import Reference

track = jax.jit(interpolate, static_argnums=1)
TIMES = np.array([0.0, 0.1, 0.25, 0.25, 0.6, 1.0])  # unequal, with a phase's end and the next one's start
CUBIC = np.random.default_rng(0).normal(size=(4, 4, 3))  # coefficient, leg, joint


def motion(times, order=0):
    coefficients = np.polynomial.polynomial.polyder(CUBIC, order) if order else CUBIC
    return np.moveaxis(np.polynomial.polynomial.polyval(times, coefficients), -1, 0)


def reference(torque):
    t = len(TIMES)
    zero, quaternion, twist, feet = (np.zeros((t, *shape)) for shape in ((3,), (4,), (6,), (4, 3)))
    return Reference(TIMES, motion(TIMES), motion(TIMES, 1), torque, zero, quaternion, twist, feet, np.ones((t, 4)))


def step_starts(steps):
    return np.concatenate([a + (b - a) * np.arange(steps) / steps for a, b in itertools.pairwise(TIMES)])


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_positions_of_a_cubic_motion_are_exact(steps):
    tracking = track(reference(motion(TIMES)), steps)
    assert_allclose(tracking.position, motion(step_starts(steps)), atol=1e-12)


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_steps_fill_the_time(steps):
    dt = np.asarray(track(reference(motion(TIMES)), steps).dt)
    assert_allclose(dt.sum(), TIMES[-1] - TIMES[0])
    assert_allclose(np.concatenate([[0.0], np.cumsum(dt)[:-1]]), step_starts(steps), atol=1e-12)
    assert_allclose(dt.reshape(-1, steps).sum(axis=1), np.diff(TIMES))


@pytest.mark.parametrize("steps", [1, 4])
def test_velocity_is_at_the_end_of_a_step_and_torque_at_its_middle(steps):
    ramp = np.stack([np.full((4, 3), t) for t in TIMES])
    tracking = track(reference(ramp)._replace(joint_vel=ramp), steps)
    start, dt = step_starts(steps)[:, None, None], np.asarray(tracking.dt)[:, None, None]
    assert_allclose(tracking.velocity, np.broadcast_to(start + dt, tracking.velocity.shape), atol=1e-12)
    assert_allclose(tracking.torque, np.broadcast_to(start + dt / 2, tracking.torque.shape), atol=1e-12)
