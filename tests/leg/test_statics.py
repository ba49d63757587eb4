"""Torque maps and standing loads: the facts of paper A, Section III, and moment balance."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from jaxleg.conventions import GRAVITY
from jaxleg.leg import statics

LEG_LOAD = 86.2
leg_torque = jax.jit(statics.leg_torque)
holding_torque = jax.jit(statics.holding_torque)
torque_map = statics.torque_map
standing_load = jax.jit(statics.standing_load)
FEET = np.array([[0.25, 0.2, 0.0], [0.35, -0.2, 0.0], [-0.35, 0.2, 0.0], [-0.25, -0.2, 0.0]])


def printed_equation_3(theta_2, theta_3, f_x, f_z):
    """Paper A, equation (3): thigh and knee."""
    l2, l3 = 0.26, 0.34
    shank_sin, shank_cos = l3 * np.sin(theta_2 + theta_3), l3 * np.cos(theta_2 + theta_3)
    thigh = -(l2 * np.sin(theta_2) + shank_sin) * f_x + (l2 * np.cos(theta_2) + shank_cos) * f_z
    return thigh, -shank_sin * f_x + shank_cos * f_z


@pytest.mark.parametrize(("f_x", "f_z"), [(0.0, LEG_LOAD), (20.0, 0.0), (-15.0, 70.0)])
@pytest.mark.parametrize("pitch", [(-0.5, 0.9), (0.2, -0.7), (-1.0, 1.6)])
def test_equation_3_is_the_load_with_theta_2_from_the_horizontal(pegasus, pitch, f_x, f_z):
    for leg in range(4):
        angles, force = np.array([0.0, *pitch]), np.array([f_x, 0.0, f_z])
        axis, offset = (np.asarray(x)[leg] for x in (pegasus.joint_axis, pegasus.link_offset))
        motors = np.asarray(holding_torque(axis, offset, angles, force))
        assert_allclose(-motors[1:], printed_equation_3(pitch[0] - np.pi / 2, pitch[1], f_x, f_z), atol=1e-9)


@pytest.mark.parametrize("height", [0.3, 0.48, 0.52, 0.58])
def test_no_thigh_torque_with_the_foot_under_the_hip(pegasus, height):
    torque = leg_torque(pegasus, 0.0, height, LEG_LOAD)
    assert torque.reachable
    assert_allclose(torque.thigh, 0.0, atol=1e-9)
    assert abs(torque.knee) > 1.0


@pytest.mark.parametrize(("height", "printed"), [(0.48, -0.219), (0.50, -0.205), (0.52, -0.188)])
def test_no_knee_torque_with_the_foot_under_the_knee(pegasus, height, printed):
    line = statics.knee_zero_line(pegasus, height)
    assert_allclose(line, printed, atol=1e-3)
    assert_allclose(leg_torque(pegasus, line, height, LEG_LOAD).knee, 0.0, atol=1e-9)
    root = brentq(lambda x: float(leg_torque(pegasus, x, height, LEG_LOAD).knee), -0.28, 0.0, xtol=1e-10)
    assert_allclose(line, root, atol=1e-6)


def test_knee_forward_mirrors_the_line(pegasus):
    forward = pegasus.__class__(**(vars(pegasus) | {"knee_sign": -pegasus.knee_sign}))
    heights = np.linspace(0.4, 0.55, 4)
    assert_allclose(statics.knee_zero_line(forward, heights), -np.asarray(statics.knee_zero_line(pegasus, heights)))


def test_map_scales_with_the_load_and_is_its_points(pegasus):
    x, height = np.linspace(-0.3, 0.1, 5), np.linspace(0.4, 0.59, 4)
    full, half = (jax.device_get(torque_map(pegasus, x, height, load)) for load in (LEG_LOAD, LEG_LOAD / 2))
    assert full.thigh.shape == (5, 4)
    assert_allclose(full.thigh, 2 * half.thigh, rtol=1e-9, atol=1e-12)
    assert_allclose(full.knee, 2 * half.knee, rtol=1e-9, atol=1e-12)
    one = leg_torque(pegasus, x[1], height[2], LEG_LOAD)
    assert_allclose((one.thigh, one.knee), (full.thigh[1, 2], full.knee[1, 2]))
    assert np.array_equal(full.reachable, np.hypot(x[:, None], height) < 0.6)


def test_least_torque_under_the_hip_is_near_full_stretch(pegasus):
    heights = np.linspace(0.3, 0.599, 60)
    torque = jax.device_get(torque_map(pegasus, np.zeros(1), heights, LEG_LOAD))
    total = (np.abs(torque.thigh) + np.abs(torque.knee))[0]
    assert np.all(torque.reachable)
    assert np.argmin(total) == 59
    assert np.all(np.diff(total[heights > 0.45]) < 0)
    assert torque.bend[0, -1] < 0.15


@pytest.mark.parametrize("airborne", [None, 0, 1, 2, 3])
def test_standing_load_balances_weight_and_moments(pegasus, airborne):
    loaded = np.arange(4) != airborne
    feet = FEET + np.array([1.0, -2.0, 0.3])
    com = feet[loaded].mean(axis=0) + np.array([0.02, -0.01, 0.5])
    force = np.asarray(standing_load(pegasus, com, feet, loaded))
    weight = np.array([0.0, 0.0, float(pegasus.mass) * GRAVITY])
    assert_allclose(force.sum(axis=0), weight, atol=1e-9)
    assert_allclose(np.cross(feet - com, force).sum(axis=0), 0.0, atol=1e-9)
    assert np.all(force[loaded, 2] > 0)
    assert_allclose(force[~loaded], 0.0)


def test_standing_load_is_negative_outside_the_support_triangle(pegasus):
    loaded = np.array([True, True, True, False])
    force = standing_load(pegasus, np.array([-0.2, -0.15, 0.5]), np.array(FEET), loaded)
    assert np.asarray(force)[0, 2] < 0
