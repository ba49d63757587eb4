"""The sampled surface: through the centres, smooth, true to its gradient, without overshoot; PCHIP along grid lines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import PchipInterpolator

from jaxleg.terrain.heightmap import HeightMap, height, height_and_gradient, nearest_height, normal

RESOLUTION, ORIGIN, SHAPE = 0.05, np.array([-0.2, 0.3]), (9, 7)
ELEVATION = np.random.default_rng(0).normal(scale=0.05, size=SHAPE)
sampled = jax.jit(jax.vmap(height_and_gradient, in_axes=(None, 0)))
HEIGHT = jax.jit(height)
COUNT = 400


def SAMPLE(terrain, points):
    """Of at most `COUNT` points, by one program for all."""
    values = sampled(terrain, np.resize(points, (COUNT, 2)))
    return tuple(np.asarray(x)[: len(points)] for x in values)


def make(elevation, dtype=float):
    return HeightMap(np.array(elevation, dtype), np.array(ORIGIN, dtype), np.array(RESOLUTION, dtype))


def world(cells):
    return ORIGIN + RESOLUTION * np.asarray(cells, float)


def random_cells(count, margin=0.0, seed=1):
    return np.random.default_rng(seed).uniform(-margin, np.array(SHAPE) - 1 + margin, (count, 2))


def test_goes_through_the_cells_and_on_level_beyond_the_border():
    cells = np.stack(np.meshgrid(*(np.arange(-2, n + 2) for n in SHAPE), indexing="ij"), -1).reshape(-1, 2)
    inside = np.clip(cells, 0, np.array(SHAPE) - 1)
    values, gradient = SAMPLE(make(ELEVATION), world(cells))
    assert_allclose(values, ELEVATION[*inside.T], atol=1e-12)
    assert_allclose(np.where((cells != inside), gradient, 0.0), 0.0, atol=1e-12)
    nearest = jax.jit(jax.vmap(nearest_height, in_axes=(None, 0)))(make(ELEVATION), world(cells + 0.4))
    assert_allclose(nearest, ELEVATION[*inside.T])


def test_value_and_gradient_have_no_jumps_across_cells_and_border():
    lines, along = np.random.default_rng(2).permuted(np.tile(np.arange(7), 20)), random_cells(140, 1.0)
    for axis in (0, 1):
        cells = along.copy()
        cells[:, axis] = lines
        step = 1e-7 * np.eye(2)[axis]
        before, after = (SAMPLE(make(ELEVATION), world(cells + side * step)) for side in (-1, 1))
        assert_allclose(before[0], after[0], atol=1e-7)
        assert_allclose(before[1], after[1], atol=2e-5)


def test_gradient_is_autodiff_and_central_difference():
    terrain, points, step = make(ELEVATION), world(random_cells(60, 1.0)), 1e-6
    _, gradient = SAMPLE(terrain, points)
    for differentiate in (jax.jacrev, jax.jacfwd):
        automatic = jax.jit(jax.vmap(differentiate(height, argnums=1), in_axes=(None, 0)))(terrain, points)
        assert_allclose(automatic, gradient, atol=1e-10)
    ends = [SAMPLE(terrain, points + side * step * np.eye(2)[None, axis])[0] for axis in (0, 1) for side in (-1, 1)]
    central = np.stack([ends[1] - ends[0], ends[3] - ends[2]], -1) / (2 * step)
    assert_allclose(gradient, central, atol=1e-5)


def test_normal_is_perpendicular_to_the_tangents():
    terrain, points = make(ELEVATION), world(random_cells(20))
    up = np.asarray(jax.jit(jax.vmap(normal, in_axes=(None, 0)))(terrain, points))
    slope = np.asarray(SAMPLE(terrain, points)[1])
    expected = np.column_stack([-slope, np.ones(20)])
    assert_allclose(up, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1])
def test_is_pchip_along_inner_grid_lines(axis):
    count = SHAPE[axis]
    inner = np.linspace(1, count - 2, 60)  # scipy ends its outermost intervals otherwise
    for line in range(SHAPE[1 - axis]):
        oracle = PchipInterpolator(np.arange(count), np.take(ELEVATION, line, axis=1 - axis))
        cells = np.stack([inner, np.full(60, line)][:: 1 if axis == 0 else -1], -1)
        values, gradient = SAMPLE(make(ELEVATION), world(cells))
        assert_allclose(values, oracle(inner), atol=1e-12)
        assert_allclose(gradient[:, axis] * RESOLUTION, oracle(inner, 1), atol=1e-10)


def test_stairs_keep_flat_treads_and_do_not_overshoot():
    steps = 0.08 * np.repeat([0.0, 1.0, 2.0], 3)[:, None] * np.ones(SHAPE)
    x = np.linspace(0, 8, 400)
    values, gradient = SAMPLE(make(steps), world(np.column_stack([x, np.full(400, 2.7)])))
    tread = (x % 3) <= 2
    assert_allclose(values[tread], 0.08 * np.floor(x[tread] / 3), atol=1e-12)
    assert_allclose(gradient[tread], 0.0, atol=1e-12)
    assert np.all(np.diff(values) >= -1e-12)


def steepness(terrain, point):
    value, slope = height_and_gradient(terrain, point)
    return value + jnp.sum(slope * slope) + jnp.sum(normal(terrain, point))


bends = jax.jit(jax.vmap(jax.grad(steepness, argnums=(0, 1)), in_axes=(None, 0)))


@pytest.mark.parametrize("rough", [0.0, 1e-20, 1e-12, 1e-4])
def test_second_derivatives_are_finite_on_flat_ground_at_centres_and_beyond(rough):
    terrain = make(rough * ELEVATION, jnp.float32)
    points = world([[0, 0], [3, 3], [3.5, 2], [8, 6], [-1, 3], [20, 20]]).astype(jnp.float32)
    for leaf in jax.tree.leaves(jax.device_get(bends(terrain, points))):
        assert leaf.dtype == jnp.float32
        assert np.all(np.isfinite(leaf))


def test_unseen_cells_reach_just_the_patches_that_depend_on_them():
    elevation = ELEVATION.copy()
    elevation[4, 3] = np.nan
    cells = random_cells(300)
    values, gradient = SAMPLE(make(elevation), world(cells))
    to = np.floor(cells).astype(int) - (4, 3)
    depends = np.all((to >= -2) & (to <= 1), axis=1) & ~np.all((to == -2) | (to == 1), axis=1)
    assert np.array_equal(np.isnan(values), depends)
    assert np.array_equal(np.isnan(gradient).any(axis=1), depends)


def test_batch_is_stack_and_tree_map_may_put_anything_in_the_leaves():
    maps = [make(scale * ELEVATION) for scale in (1.0, -2.0)]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *maps)
    point = world([2.3, 4.1])
    axes = jax.tree.map(lambda _: 0, batch)
    stacked = np.stack([HEIGHT(terrain, point) for terrain in maps])
    assert_allclose(jax.jit(jax.vmap(height, in_axes=(axes, None)))(batch, point), stacked, rtol=1e-12)
    assert_allclose(HEIGHT(jax.tree.map(lambda leaf: leaf[1], batch), point), stacked[1], rtol=1e-12)
    assert jax.tree.leaves(jax.tree.map(lambda _: None, batch)) == []
