"""Gait constraints of paper A, (4)-(7), with the numbers the paper derives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

from jaxleg.gait.limits import Binding, gait_constraints, gait_region, half_step_skew, search_limit, skew_limits, step_limit
from jaxleg.leg.kinematics import Reach, leg_angles
from tests.crawls import gait, nominal_along_x


def test_the_papers_limits(pegasus):
    slack = jax.device_get(jax.jit(gait_constraints)(pegasus, 0.5, 0.2, 0.3))
    assert slack.search_behind + 0.3 == pytest.approx(0.40)  # (5): L_Search < 0.4
    assert slack.step_reach + 0.2 == pytest.approx(0.33, abs=2e-3)  # (6): L_Step < 0.33
    assert slack.search_reach + 0.3 == pytest.approx(0.56, abs=4e-3)  # (7): L_Search < 0.56
    assert slack.knee_clear == pytest.approx(0.24)
    assert half_step_skew(0.2) == 0.1  # (4)


def test_stances_are_mirrored_parallelograms():
    stance = np.asarray(jax.jit(nominal_along_x, static_argnums=1)(gait(step=0.2, skew=0.1, length=0.6, width=0.4), 2))
    left, right = stance[:, [0, 2]], stance[:, [1, 3]]
    np.testing.assert_allclose(left[0] - right[0], [[0.1, 0.4]] * 2)  # before the right legs swing
    np.testing.assert_allclose(left[0] - right[1], [[-0.1, 0.4]] * 2)  # before the left ones: mirrored
    np.testing.assert_allclose(stance[:, 0] - stance[:, 2], [[0.6, 0.0]] * 2)
    np.testing.assert_allclose(stance[1] - stance[0], [[0.2, 0.0]] * 4)


def reaches(robot, ahead, height):
    """Whether the first leg reaches a foot `ahead` of and `height` below its hip, by its inverse kinematics."""
    offset = robot.link_offset[0].at[:, 1].set(0.0)
    return leg_angles(robot.joint_axis[0], offset, 1.0, jnp.stack([ahead, 0.0 * ahead, -height]))[1] == Reach.OK


def walks(robot, height, step, search):
    """Feasibility from the walk itself: nominal feet shifted by half a search rectangle, legs tested by kinematics."""
    before, after = nominal_along_x(gait(step=step, skew=0.5 * step, length=0.6, width=0.4), 2)
    right_before, right_after, left = before[1, 0], after[1, 0], before[0, 0]
    hip = 0.5 * (right_after + left)  # over the mean front foothold of the new stance
    flying = reaches(robot, right_after + 0.5 * search - hip, height)
    trailing = reaches(robot, -step, height)  # a hind foot a whole step behind its hip
    return (right_after - 0.5 * search > right_before) & trailing & flying & (height > 0.26)


def test_region_is_where_the_legs_reach(pegasus):
    """Brute force: the walk's feet and the legs' kinematics on random points, also out of the region."""
    height, step, search = np.random.default_rng(3).uniform([[0.2], [0.0], [0.0]], [[0.65], [0.5], [0.8]], (3, 2000))
    region = gait_region(pegasus, height, step, search)
    brute = jax.jit(jax.vmap(walks, in_axes=(None, 0, 0, 0)))(pegasus, height, step, search)
    assert np.array_equal(region.feasible, brute)
    assert 50 < np.sum(brute) < 1950


@pytest.mark.parametrize("height", [0.3, 0.45, 0.5, 0.58])
def test_borders_are_the_polygons(pegasus, height):
    """Vertices of the closed region by linear programming, along directions that single each one out."""
    half = np.sqrt(0.6**2 - height**2)
    rows, right = [[-2.0, 1.0], [1.0, 0.0], [0.5, 1.0]], [0.0, half, 2.0 * half]
    vertex = lambda d: linprog(-np.array(d), A_ub=rows, b_ub=right, bounds=[(0, None)] * 2).x  # noqa: E731
    assert step_limit(pegasus, height).length == pytest.approx(vertex([1.0, 0.0])[0])
    top, corner = vertex([0.0, 1.0]), vertex([1.0, 0.1])
    for step, search in (top, corner):
        assert search_limit(pegasus, height, step - 1e-9).length == pytest.approx(search, abs=1e-8)
    assert search_limit(pegasus, height, top[0] - 1e-3).binding == Binding.SEARCH_BEHIND
    assert search_limit(pegasus, height, top[0] + 1e-3).binding == Binding.SEARCH_REACH


def test_the_papers_limits_and_what_sets_them(pegasus):
    step, search = step_limit(pegasus, 0.5), search_limit(pegasus, 0.5, 0.2)
    assert step.length == pytest.approx(0.3317, abs=1e-4)
    assert step.binding == Binding.STEP_REACH
    assert search.length == pytest.approx(0.4)
    assert search.binding == Binding.SEARCH_BEHIND
    chosen = gait_region(pegasus, 0.5, 0.2, 0.3)
    assert chosen.feasible
    assert chosen.slack == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("point", "binding"),
    [
        ((0.5, 0.1, 0.3), Binding.SEARCH_BEHIND),
        ((0.5, 0.35, 0.1), Binding.STEP_REACH),
        ((0.5, 0.3, 0.55), Binding.SEARCH_REACH),
        ((0.5, 0.2, 0.3, 0.7, 0.6), Binding.SKEW),
        ((0.5, 0.2, 0.3, -0.45, 0.6), Binding.SKEW),  # the other stance's offset, L_Skew - L_Step
        ((0.26, 0.2, 0.3), Binding.TOO_LOW),
        ((0.601, 0.2, 0.3), Binding.TOO_HIGH),
        ((0.75, 0.0, 0.0), Binding.TOO_HIGH),
        ((np.nan, 0.2, 0.3), Binding.INVALID),
        ((0.5, np.inf, 0.3), Binding.INVALID),
        ((0.5, 0.2, -0.1), Binding.INVALID),
    ],
)
def test_refusals_have_a_reason(pegasus, point, binding):
    region = jax.device_get(gait_region(pegasus, *point))
    assert not region.feasible
    assert region.binding == binding
    assert region.slack <= 0.0


def test_limits_at_heights_that_are_out_of_reach(pegasus):
    heights = np.array([0.2, 0.26, 0.601, 0.9, np.nan])
    for limit in (step_limit(pegasus, heights), search_limit(pegasus, heights, 0.2)):
        assert np.array_equal(limit.length, np.zeros(5))
        assert np.asarray(limit.binding).tolist() == [Binding.TOO_LOW] * 2 + [Binding.TOO_HIGH] * 2 + [Binding.INVALID]
    refused = search_limit(pegasus, 0.5, np.array([0.0, 0.34]))
    assert np.array_equal(refused.length, np.zeros(2))
    assert np.asarray(refused.binding).tolist() == [Binding.SEARCH_BEHIND, Binding.STEP_REACH]


def test_skew_limits_are_where_the_region_ends(pegasus):
    least, greatest = jax.device_get(jax.jit(skew_limits)(0.2, 0.6))
    for inside, outside in ((least + 1e-9, least - 1e-9), (greatest - 1e-9, greatest + 1e-9)):
        skew = np.stack([inside, outside])
        assert np.asarray(gait_region(pegasus, 0.5, 0.2, 0.3, skew, 0.6).feasible).tolist() == [True, False]
    assert 0.5 * (least + greatest) == pytest.approx(half_step_skew(0.2))  # (4) is midway


def test_region_broadcasts_and_has_a_gradient(pegasus):
    heights, steps, searches = np.array([0.45, 0.5]), np.linspace(0.0, 0.4, 4), np.linspace(0.0, 0.6, 3)
    grid = gait_region(pegasus, heights[:, None, None], steps[:, None], searches)
    assert grid.feasible.shape == grid.binding.shape == (2, 4, 3)
    one = jax.jit(jax.vmap(lambda s: gait_region(pegasus, 0.5, 0.2, s)))(searches)
    np.testing.assert_array_equal(one.slack, gait_region(pegasus, 0.5, 0.2, searches).slack)
    slope = jax.jit(jax.grad(lambda h: step_limit(pegasus, h).length))
    assert slope(0.5) == pytest.approx(-0.5 / np.sqrt(0.11))
    assert slope(0.601) == slope(0.7) == 0.0
