"""The lowest point of the convex model, against scipy's and in closed form, and the derivatives of what it minimises."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import approx_fprime, minimize

from jaxleg.search.convex import Corners, Problem, _rounded, lowest
from jaxleg.search.penalty import fine, fine_slopes


def drawn(seed, numbers=3, constraints=4, rows=6):
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((numbers, numbers))
    corners = [
        Corners(
            rows=rng.uniform(-0.2, 1.0, (count, each)),
            slopes=3.0 * rng.standard_normal((count, each, numbers)),
            weight=rng.uniform(0.1, 0.9, count),
        )
        for count, each in ((constraints - 1, rows), (1, 2))
    ]
    return Problem(rng.standard_normal(numbers), root @ root.T + 0.1 * np.eye(numbers), corners)


def test_a_fine_and_its_slopes():
    """0.83 for one unit, nearly 2 v - 2 for many; slopes against differences."""
    violation = np.array([0.0, 0.3, 1.0, 40.0])
    assert_allclose(fine(violation)[2:], [2.0 * (np.sqrt(2.0) - 1.0), 2.0 * np.sqrt(1601.0) - 2.0])
    first, second = fine_slopes(violation)
    h = 1e-5
    assert_allclose(first, (fine(violation + h) - fine(violation - h)) / (2 * h), atol=1e-8)
    assert_allclose(second, (fine(violation + h) - 2.0 * fine(violation) + fine(violation - h)) / h**2, atol=1e-3)


def test_without_constraints_it_is_newtons_step_or_the_boxes_side():
    curvature = np.diag([2.0, 4.0, 1.0])
    problem = Problem(np.array([-1.0, 2.0, -8.0]), curvature, ())
    step = lowest(problem, np.full(3, -1.0), np.full(3, 1.0))
    assert_allclose(step, [0.5, -0.5, 1.0], atol=1e-5)
    assert problem.value(step) == pytest.approx(-0.25 - 0.5 - 7.5, abs=1e-4)


def test_in_a_valley_with_a_sharp_bottom_it_finds_the_corner():
    """Two walls that meet at d = 0.3 and cost far more than the way down saves; a gradient would see one of them."""
    rows, slopes = np.array([[0.3, 1e6]]), np.array([[[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]]) * 1e3
    problem = Problem(np.array([-1.0, 0.0, 0.0]), 1e-3 * np.eye(3), [Corners(1e3 * rows, slopes, np.ones(1))])
    step = lowest(problem, np.full(3, -1.0), np.full(3, 1.0))
    assert_allclose(step[0], 0.3, atol=1e-3)


@pytest.mark.parametrize("seed", range(8))
def test_no_lower_point_is_found_by_scipy(seed):
    problem = drawn(seed)
    low, high = np.full(3, -0.4), np.array([0.5, 0.2, 0.0])
    step = lowest(problem, low, high)
    assert np.all((step >= low) & (step <= high))
    rng = np.random.default_rng(100 + seed)
    tries = [rng.uniform(low, high) for _ in range(12)]
    options = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000}
    box = list(zip(low, high))
    others = [minimize(problem.value, x, method="Nelder-Mead", bounds=box, options=options).fun for x in tries]
    assert problem.value(step) <= min(others) + 2e-4 * (1.0 + abs(min(others)))


@pytest.mark.parametrize("weight", [0.1, 1e-3])
def test_slope_and_curvature_of_the_rounded_model_are_its_differences(weight):
    problem, low, high = drawn(3), np.full(3, -0.4), np.full(3, 0.5)
    at = np.array([0.1, -0.05, 0.2])
    _, slope, curvature = _rounded(problem, low, high, at, weight)
    assert_allclose(slope, approx_fprime(at, lambda x: _rounded(problem, low, high, x, weight)[0], 1e-7), rtol=1e-4, atol=1e-3)
    seen = [approx_fprime(at, lambda x: _rounded(problem, low, high, x, weight)[1][i], 1e-7) for i in range(3)]  # noqa: B023
    assert_allclose(curvature, seen, rtol=1e-4, atol=1e-3)
