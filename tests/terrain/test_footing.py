"""Valid footholds: the definition, cell by cell in NumPy, on random ground with edges and unseen cells."""

import math

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.terrain.footing import valid_cells
from jaxleg.terrain.heightmap import HeightMap, height, height_and_gradient

RESOLUTION, SHAPE = 0.02, (13, 11)
valid = jax.jit(valid_cells, static_argnums=(1, 2))


def make(elevation):
    return HeightMap(elevation, np.zeros(2), np.array(RESOLUTION))


def random_ground(seed):
    """Smooth ground with a steep part, a step and two unseen cells, one in the corner."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(*(RESOLUTION * np.arange(n) for n in SHAPE), indexing="ij")
    elevation = rng.uniform(-0.8, 0.8) * x + rng.uniform(2.0, 8.0) * y**2 + 0.002 * rng.normal(size=SHAPE)
    elevation[rng.integers(2, 11) :] += 0.05 * (seed % 3)
    elevation[rng.integers(13), rng.integers(11)] = np.nan
    elevation[-1, -1] = np.nan
    return elevation


def harmonic(before, after):
    return 2 * before * after / (before + after) if before * after > 0 else 0.0 * before * after


def brute_force(elevation, foot_radius, slope_limit, edge_height):
    beside, reach = ((1, 0), (-1, 0), (0, 1), (0, -1)), range(-4, 5)

    def at(i, j):
        return elevation[min(max(i, 0), SHAPE[0] - 1), min(max(j, 0), SHAPE[1] - 1)]

    def bad(i, j):
        i, j = min(max(i, 0), SHAPE[0] - 1), min(max(j, 0), SHAPE[1] - 1)
        return np.isnan(at(i, j)) or any(abs(at(i + a, j + b) - at(i, j)) > edge_height for a, b in beside)

    def gentle(i, j):
        slope_x = harmonic(at(i, j) - at(i - 1, j), at(i + 1, j) - at(i, j))
        slope_y = harmonic(at(i, j) - at(i, j - 1), at(i, j + 1) - at(i, j))
        return math.atan(math.hypot(slope_x, slope_y) / RESOLUTION) <= slope_limit

    def clear(i, j):
        disc = [(a, b) for a in reach for b in reach if RESOLUTION * (math.hypot(a, b) - 0.5) <= foot_radius]
        return not any(bad(i + a, j + b) for a, b in disc)

    def known(i, j):
        around = [(i + a, j + b) for a in range(-2, 3) for b in range(-2, 3) if (abs(a), abs(b)) != (2, 2)]
        return not any(np.isnan(elevation[a, b]) for a, b in around if 0 <= a < SHAPE[0] and 0 <= b < SHAPE[1])

    return np.array([gentle(i, j) and clear(i, j) and known(i, j) for i, j in np.ndindex(*SHAPE)]).reshape(SHAPE)


@pytest.mark.parametrize("foot_radius", [0.004, 0.021])
def test_a_foot_a_little_off_a_valid_cell_still_has_ground(foot_radius):
    """And right beyond those cells there is some that has none: the ring of unseen cells that spoil it is no wider."""
    look, off = jax.jit(jax.vmap(height, in_axes=(None, 0))), 1e-3 * RESOLUTION
    around = off * np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    for seed in range(4):
        elevation = np.zeros(SHAPE)
        elevation[tuple(np.random.default_rng(seed).integers(3, 8, 2))] = np.nan
        known = np.stack(
            [np.isfinite(look(make(elevation), RESOLUTION * np.array(cell) + around)).all() for cell in np.ndindex(SHAPE)]
        )
        ours = valid(make(elevation), RESOLUTION, foot_radius)
        assert np.all(known.reshape(SHAPE)[ours])
        if foot_radius < 0.01:
            np.testing.assert_array_equal(ours, known.reshape(SHAPE))


@pytest.mark.parametrize("foot_radius", [0.004, 0.021, 0.037])
def test_is_the_definition(foot_radius):
    check = jax.jit(jax.vmap(lambda z: valid_cells(make(z), RESOLUTION, foot_radius, 0.5, 0.03)))
    grounds = np.stack([random_ground(seed) for seed in range(6)])
    ours = np.asarray(check(grounds))
    expected = np.stack([brute_force(ground, foot_radius, 0.5, 0.03) for ground in grounds])
    assert np.array_equal(ours, expected)
    assert 0.05 < expected.mean() < 0.95


def test_slope_is_that_of_the_sampled_surface():
    ground = make(np.random.default_rng(5).normal(scale=0.01, size=SHAPE))
    points = np.array([[RESOLUTION * i, RESOLUTION * j] for i, j in np.ndindex(*SHAPE)])
    _, gradient = jax.jit(jax.vmap(height_and_gradient, in_axes=(None, 0)))(ground, points)
    steepness = np.arctan(np.linalg.norm(np.asarray(gradient), axis=1)).reshape(SHAPE)
    limit = float(np.median(steepness)) + 1e-9
    assert_allclose(valid(ground, RESOLUTION, 0.01, limit, 1.0), steepness <= limit)


def test_level_ground_is_valid_to_its_border():
    assert np.all(np.asarray(valid(make(np.zeros(SHAPE)), RESOLUTION, 0.05)))


def test_every_cell_under_the_foot_must_be_easy():
    easy = np.ones(SHAPE, bool)
    easy[6, 5] = False
    hard = ~np.asarray(valid(make(np.zeros(SHAPE)), RESOLUTION, 0.02, easy=easy))
    assert {tuple(c) for c in np.argwhere(hard)} == {(6, 5), (5, 5), (7, 5), (6, 4), (6, 6)}


@pytest.mark.parametrize("infinity", [np.inf, -np.inf])
def test_no_foot_stands_beside_an_infinite_height(infinity):
    ground = np.zeros(SHAPE)
    ground[5:7, 5] = infinity
    stands = np.asarray(valid(make(ground), RESOLUTION, 0.02))
    assert not stands[4:8, 4:7].any()
    assert stands[:2].all()
