"""Best workspaces against brute force, means against another quadrature, and the mirror image of the other knee."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import dblquad

from jaxleg.leg import workspace
from jaxleg.leg.statics import torque_map
from jaxleg.leg.workspace import Workspace

LEG_LOAD = 86.2
PAPER = Workspace(-0.20, 0.0, 0.48, 0.52)
best_window = jax.jit(workspace.best_window, static_argnums=2)
mean_cost = jax.jit(workspace.mean_cost, static_argnums=3)
centres = jax.jit(workspace.centres, static_argnums=2)


def forward(robot):
    return robot.__class__(**(vars(robot) | {"knee_sign": -robot.knee_sign}))


@pytest.mark.parametrize("cells", [(1, 1), (3, 2), (7, 5)])
@pytest.mark.parametrize("share", [0.0, 0.03])
def test_best_window_is_that_of_brute_force(cells, share):
    draw = np.random.default_rng(1)
    values, allowed = draw.normal(size=(12, 9)), draw.uniform(size=(12, 9)) >= share
    means = np.full((13 - cells[0], 10 - cells[1]), np.inf)
    for i, j in np.ndindex(means.shape):
        part = np.s_[i : i + cells[0], j : j + cells[1]]
        if allowed[part].all():
            means[i, j] = values[part].mean()
    found = jax.device_get(best_window(values, allowed, cells))
    assert (found.x, found.h) == np.unravel_index(means.argmin(), means.shape)
    assert_allclose(found.mean, means.min())


def test_a_forbidden_cell_may_hold_anything():
    values = np.ones((4, 4))
    values[0, 0], values[3, 3] = np.inf, np.nan
    found = best_window(values, np.isfinite(values), (2, 2))
    assert found.mean == 1.0
    assert best_window(values, np.zeros((4, 4), bool), (2, 2)).mean == np.inf


@pytest.mark.parametrize("degrees", [20.0, 35.0])
def test_cells_keep_the_bend_at_all_their_corners(pegasus, degrees):
    x, h, size = np.linspace(-0.5, 0.5, 21), np.linspace(0.2, 0.6, 17), 0.02
    kept = workspace.keeps_bend(pegasus, x, h, size, np.deg2rad(degrees))
    corners = [(x + dx * size / 2, h + dz * size / 2) for dx in (-1, 1) for dz in (-1, 1)]
    maps = [torque_map(pegasus, a, b, LEG_LOAD) for a, b in corners]
    bend = np.min([np.asarray(torque.bend) for torque in maps], axis=0)
    assert np.array_equal(kept, (bend >= np.deg2rad(degrees)) & (h - size / 2 >= 0.26))


def levers(x, h):
    """Torques by their levers: the foot ahead of the hip, and ahead of a knee found where the links' circles meet."""
    distance = np.hypot(x, h)
    along = (0.26**2 - 0.34**2 + distance**2) / (2.0 * distance)
    aside = np.sqrt(0.26**2 - along**2)
    knee = (along * x - aside * h) / distance  # of the two points the one further back
    return abs(x) * LEG_LOAD, abs(x - knee) * LEG_LOAD


@pytest.mark.parametrize("power", [1, 2])
def test_mean_is_the_integral(pegasus, power):
    ours = mean_cost(pegasus, PAPER, LEG_LOAD, (64, 16))[power - 1]
    point = lambda h, x: sum(torque**power for torque in levers(x, h))  # noqa: E731
    integral = dblquad(point, -0.2, 0.0, 0.48, 0.52, epsabs=1e-5)[0]
    assert_allclose(ours, integral / (0.2 * 0.04), rtol=1e-3)


def test_the_papers_workspace_is_near_the_best_of_its_heights(pegasus):
    size = 0.005
    x, h = centres(-0.3, 0.2, 100), centres(0.48, 0.52, 8)
    values = workspace.cost(torque_map(pegasus, x, h, LEG_LOAD))
    allowed = workspace.keeps_bend(pegasus, x, h, size, np.deg2rad(35.0))
    for ours, value in zip(mean_cost(pegasus, PAPER, LEG_LOAD, (40, 8)), values):
        best = jax.device_get(best_window(value, allowed, (40, 8)))
        assert 1.0 < float(ours) / best.mean < 1.05
        assert -0.3 + size * float(best.x) == pytest.approx(-0.175, abs=0.006)


def test_costs_scale_with_the_force(pegasus):
    full, half = (jax.device_get(mean_cost(pegasus, PAPER, load, (20, 4))) for load in (LEG_LOAD, LEG_LOAD / 2))
    assert_allclose(full.total, 2.0 * half.total)
    assert_allclose(full.square, 4.0 * half.square)


def test_the_forward_knee_mirrors_the_map(pegasus):
    x, h = np.linspace(-0.55, 0.55, 45), np.linspace(0.05, 0.59, 28)
    ours, other = (jax.device_get(torque_map(robot, x, h, LEG_LOAD)) for robot in (pegasus, forward(pegasus)))
    seen = ours.reachable
    assert np.array_equal(seen, other.reachable[::-1])
    assert_allclose(np.abs(other.thigh)[::-1][seen], np.abs(ours.thigh)[seen], atol=1e-9)
    assert_allclose(np.abs(other.knee)[::-1][seen], np.abs(ours.knee)[seen], atol=1e-9)


def test_out_of_reach_is_never_cheap(pegasus):
    assert mean_cost(pegasus, Workspace(0.3, 0.5, 0.48, 0.52), LEG_LOAD, (20, 4)).total == np.inf


@pytest.mark.slow  # long to compile
def test_mean_has_a_gradient(pegasus):
    """Sliding the paper's workspace: reverse mode against central differences."""
    mean = lambda dx: workspace.mean_cost(pegasus, Workspace(dx - 0.2, dx, 0.48, 0.52), LEG_LOAD, (20, 4)).square  # noqa: E731
    run = jax.jit(jax.value_and_grad(mean))
    slope = (run(1e-5)[0] - run(-1e-5)[0]) / 2e-5
    assert_allclose(run(0.0)[1], slope, rtol=1e-6)
