"""Features under the body against NumPy from their definitions, cell by cell, on random and on real maps with unseen cells."""

import functools
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.terrain import HeightMap
from jaxleg.terrain import body_cost as module
from jaxleg.terrain.body_cost import BodyFeatures, BodySettings, BodyWeights, body_features
from tests.motions import QUICK

SHAPE = (22, 17)
PAPER = BodySettings(radius=0.18, critical_count=5)
PUBLISHED = BodySettings(radius=0.18, critical_count=5, roughness="residual", step="count", critical_step=0.06)
CRITICAL = (0.6, 0.15, 0.20)  # s_max [rad], r_max, h_max [m]
WEIGHTS = BodyWeights(np.array([2, 2, 1]) / 3, np.array(CRITICAL), 0.12, 0.5)
DATA = Path(__file__).parents[2] / ".." / "shared" / "data"


body_cost = jax.jit(module.body_cost, static_argnums=2)


def features_of(elevation, resolution, settings, softness=None):
    terrain = HeightMap(elevation, jnp.zeros(2, elevation.dtype), jnp.array(resolution, elevation.dtype))
    return body_features(terrain, resolution, settings, softness)


compute = jax.jit(features_of, static_argnums=(1, 2), compiler_options=QUICK)


def around(values, i, j, radius, resolution):
    """Offsets [cells] and values of the seen cells of a disc; and how many cells it has on and beyond the map."""
    reach = int(radius / resolution + 1e-6)
    a, b = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    inside = np.hypot(a, b) * resolution <= radius + 1e-8
    a, b = a[inside], b[inside]
    there = (a + i >= 0) & (a + i < values.shape[0]) & (b + j >= 0) & (b + j < values.shape[1])
    found = values[(a + i)[there], (b + j)[there]]
    rows = np.column_stack([a[there], b[there], found])
    return rows[np.isfinite(found)], len(a)


def differences(elevation, resolution, settings):
    """Of each seen cell: its height difference, and whether it is a step."""
    difference, step = np.full(elevation.shape, np.nan), np.full(elevation.shape, np.nan)
    for i, j in np.argwhere(np.isfinite(elevation)):
        near, _ = around(elevation, i, j, settings.step_radius, resolution)
        if settings.step == "count":
            difference[i, j] = np.ptp(near[:, 2])
            step[i, j] = difference[i, j] > settings.critical_step
            continue
        near = near[np.hypot(near[:, 0], near[:, 1]) > 0]
        high = np.abs(near[:, 2] - elevation[i, j])
        difference[i, j] = high.max(initial=0.0)
        own = near[high >= difference[i, j] - 1e-6]  # equal to a micrometre: the nearest of them
        away = resolution * np.hypot(own[:, 0], own[:, 1]).min(initial=math.inf)
        step[i, j] = math.atan2(difference[i, j], away) > settings.critical_slope
    return difference, step


def plain(elevation, resolution, settings, cells):
    """Slope, roughness, step height, seen share (feature, cell) by lstsq and loops."""
    rows = []
    difference, step = differences(elevation, resolution, settings)
    for i, j in cells:
        near, size = around(elevation, i, j, settings.radius, resolution)
        plane = np.column_stack([resolution * near[:, :2], np.ones(len(near))])
        solution, _, rank, _ = np.linalg.lstsq(plane, near[:, 2], rcond=1e-9) if len(near) else (None, None, 0, None)
        if rank < 3:
            rows.append((math.nan, math.nan, math.nan, len(near) / size))
            continue
        normal = np.array([-solution[0], -solution[1], 1.0])
        rest = math.sqrt(((near[:, 2] - plane @ solution) ** 2).sum() / (len(near) - 1))
        highest = around(difference, i, j, settings.radius, resolution)[0][:, 2].max()
        steps = around(step, i, j, settings.radius, resolution)[0][:, 2].sum()
        rows.append(
            (
                math.atan2(np.linalg.norm(normal[:2]), normal[2]),
                np.std(near[:, 2]) if settings.roughness == "deviation" else rest,
                min(highest, steps / settings.critical_count * highest),
                len(near) / size,
            )
        )
    return np.array(rows).T


def ground(seed):
    rng = np.random.default_rng(seed)
    elevation = 3.0 * rng.normal() + np.cumsum(0.03 * rng.normal(size=SHAPE), axis=seed % 2)
    elevation[rng.random(SHAPE) < (0.0, 0.1, 0.6, 0.97)[seed % 4]] = (np.nan, np.inf)[seed // 2 % 2]
    return elevation


def cuboids(seed):
    """Boxes of equal heights: many neighbours differ by the same."""
    rng = np.random.default_rng(seed)
    return np.repeat(np.repeat(rng.integers(0, 4, (8, 6)) * 0.07, 3, axis=0), 3, axis=1)[: SHAPE[0], : SHAPE[1]]


def agree(ours, elevation, resolution, settings, cells):
    """Within 1e-5 of the value and of the critical value, in single precision, or tightly."""
    exact = plain(np.asarray(elevation, float), resolution, settings, cells)
    tight = elevation.dtype == np.float64
    for name, ours_, expected, critical in zip(BodyFeatures._fields, ours, exact, (*CRITICAL, 1.0)):
        found = np.asarray(ours_, float)[tuple(np.transpose(cells))]
        rtol, atol = (1e-9, 1e-11) if tight else (1e-5, 1e-5 * critical)
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=atol, err_msg=name)


@pytest.mark.parametrize(
    ("settings", "dtype"),
    [
        (PAPER, "float64"),
        (PUBLISHED, "float64"),
        (PAPER, "float32"),
        pytest.param(PUBLISHED, "float32", marks=pytest.mark.slow),
    ],
    ids=["paper", "published", "paper-single", "published-single"],
)
def test_features_are_their_definitions(settings, dtype):
    cells = list(np.ndindex(*SHAPE))
    for elevation in [ground(0), ground(1), ground(2), ground(3), cuboids(0)]:
        elevation = elevation.astype(dtype)
        agree(compute(elevation, 0.04, settings), elevation, 0.04, settings, cells)


def real(name):
    if not (DATA / f"{name}.npz").exists():
        pytest.skip("the real maps are not here")
    with np.load(DATA / f"{name}.npz") as file:
        return file["elevation"], float(file["resolution"])


@pytest.mark.slow  # no default test needs what a fresh clone has not
@pytest.mark.parametrize("name", ["cpd_real_stairs", "cpd_terrain_nanholes"])
def test_features_of_pieces_of_real_maps(name):
    elevation, resolution = real(name)
    elevation = elevation * np.float32(0.04 / resolution)  # what is compiled already is for cells of 0.04 m
    for corner in np.random.default_rng(0).integers(0, np.array(elevation.shape) - SHAPE, (40, 2)):
        piece = elevation[corner[0] : corner[0] + SHAPE[0], corner[1] : corner[1] + SHAPE[1]]
        cells = np.random.default_rng(corner).integers(0, SHAPE, (8, 2))
        agree(compute(piece, 0.04, PAPER), piece, 0.04, PAPER, cells)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cpd_real_stairs", "cpd_terrain_nanholes"])
def test_features_of_whole_real_maps(name):
    elevation, resolution = real(name)
    elevation = elevation[-250:, -250:]
    cells = np.random.default_rng(0).integers(0, elevation.shape, (1000, 2))
    assert np.isnan(elevation).any()
    agree(compute(elevation, resolution, BodySettings()), elevation, resolution, BodySettings(), cells)


def test_an_unseen_map_has_no_features_and_no_way():
    features = jax.device_get(compute(np.full(SHAPE, np.nan), 0.04, PAPER))
    assert np.all(np.isnan(features[:3]))
    assert np.all(features.seen == 0.0)
    assert np.all(np.isinf(np.asarray(body_cost(features, WEIGHTS))))


@pytest.mark.parametrize("combine", ["norm", "linear"])
def test_cost_is_its_formula(combine):
    features = jax.device_get(compute(0.2 * ground(1), 0.04, PAPER))
    cost = np.asarray(body_cost(features, WEIGHTS, combine))
    x = np.clip(np.stack(features[:3]) / np.array(CRITICAL)[:, None, None], 0, 1)
    w = WEIGHTS.weight[:, None, None]
    expected = np.sqrt(((w * x) ** 2).sum(axis=0)) if combine == "norm" else (w**2 * x).sum(axis=0)
    barred = ~(features.step_height <= 0.12) | (features.seen < 0.5)
    assert 0 < barred.sum() < barred.size
    np.testing.assert_allclose(cost, np.where(barred, np.inf, expected), rtol=1e-12)
    assert np.all((cost >= 0) & ((cost <= 1) | barred))


def test_worst_ground_costs_one():
    worst = BodyFeatures(*(np.full((4, 4), 9.0),) * 2, np.full((4, 4), 0.25), np.ones((4, 4)))
    for combine in ("norm", "linear"):
        np.testing.assert_allclose(body_cost(worst, WEIGHTS._replace(threshold=0.3), combine), 1.0, rtol=1e-12)


@pytest.mark.parametrize("settings", [PAPER, pytest.param(PUBLISHED, marks=pytest.mark.slow)], ids=["paper", "published"])
def test_smooth_features_tend_to_the_exact_ones(settings):
    exact = np.stack(compute(ground(1), 0.04, settings))
    gaps = [np.nanmax(np.abs(np.stack(compute(ground(1), 0.04, settings, t)) - exact)) for t in (1e-2, 1e-3, 1e-5)]
    assert gaps[2] < 1e-4 < gaps[1] < gaps[0] < 0.2


@functools.partial(jax.jit, static_argnums=0)
def derivatives(settings, elevation, direction, softness=None):
    """Along a direction: forward and reverse mode; and the gradient."""

    def total(z):
        return sum(jnp.nansum(x) for x in features_of(z, 0.04, settings, softness)[:3])

    gradient = jax.grad(total)(elevation)
    value, forward = jax.jvp(total, (elevation,), (direction,))
    return forward, jnp.nansum(gradient * direction), gradient, value


@pytest.mark.slow  # long to compile
@pytest.mark.parametrize("softness", [None, 0.01], ids=["exact", "smooth"])
@pytest.mark.parametrize("settings", [PAPER, PUBLISHED], ids=["paper", "published"])
def test_derivatives(settings, softness):
    elevation = ground(1)
    direction = np.where(np.isfinite(elevation), np.random.default_rng(5).normal(size=SHAPE), 0.0)
    forward, reverse, gradient, _ = derivatives(settings, elevation, direction, softness)
    assert np.all(np.isfinite(gradient))
    step = 1e-7  # no cell's own neighbour changes within it
    ends = [derivatives(settings, elevation + s * direction, direction, softness)[3] for s in (step, -step)]
    np.testing.assert_allclose(reverse, forward, rtol=1e-10)
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), forward, rtol=1e-6)
    assert np.all(np.isfinite(derivatives(settings, np.zeros(SHAPE), direction, softness)[2]))  # level ground
