"""Features against NumPy from their definitions, cell by cell, on random maps with unseen cells."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.terrain import Grid, HeightMap, stairs
from jaxleg.terrain.features import FeatureSettings, features, traversability
from jaxleg.terrain.window import disc, median

SIZE, SHAPE = 0.02, (14, 11)
SETTINGS = FeatureSettings(critical_step=0.03)


def make(elevation):
    return HeightMap(elevation, np.zeros(2, elevation.dtype), np.array(SIZE, elevation.dtype))


score = jax.jit(traversability, static_argnums=(1, 2))
compute = jax.jit(lambda t: (*features(t, SIZE, SETTINGS), traversability(t, SIZE, SETTINGS)))


def around(elevation, i, j, radius):
    """Offsets [m] and heights of the seen cells of a window."""
    rows = [
        (SIZE * (a - i), SIZE * (b - j), elevation[a, b])
        for a, b in np.ndindex(*SHAPE)
        if SIZE * math.hypot(a - i, b - j) <= radius + 1e-9 and np.isfinite(elevation[a, b])
    ]
    return np.array(rows).reshape(-1, 3)


def plain(elevation):
    """Slope, roughness, step height, traversability by lstsq and loops."""
    out = np.full((4, *SHAPE), np.nan)
    difference = np.full(SHAPE, np.nan)
    for i, j in np.ndindex(*SHAPE):
        if np.isfinite(elevation[i, j]):
            difference[i, j] = np.ptp(around(elevation, i, j, 0.04)[:, 2])
    for i, j in np.ndindex(*SHAPE):
        if not np.isfinite(elevation[i, j]):
            continue
        near = around(elevation, i, j, 0.05)
        plane = np.column_stack([near[:, :2], np.ones(len(near))])
        solution, _, rank, _ = np.linalg.lstsq(plane, near[:, 2], rcond=1e-9)
        if rank == 3:
            out[0, i, j] = math.atan(math.hypot(*solution[:2]))
            out[1, i, j] = math.sqrt(((near[:, 2] - plane @ solution) ** 2).sum() / (len(near) - 1))
        jumps = around(difference, i, j, 0.04)[:, 2]
        out[2, i, j] = min(jumps.max(), (jumps > 0.03).sum() / 4 * jumps.max())
    scores = [np.maximum(0, 1 - x / limit) for x, limit in zip(out, (1.0, 0.05, 0.03))]
    out[3] = np.mean(scores, axis=0)
    return out


def ground(seed):
    rng = np.random.default_rng(seed)
    elevation = 0.3 * rng.normal() + np.cumsum(0.02 * rng.normal(size=SHAPE), axis=seed % 2)
    elevation[rng.random(SHAPE) < (0.0, 0.1, 0.6, 0.9)[seed % 4]] = (np.nan, np.inf)[seed // 4 % 2]
    return elevation


@pytest.mark.parametrize("seed", range(8))
def test_features_are_their_definitions(seed):
    ours = np.stack(jax.device_get(compute(make(ground(seed)))))
    np.testing.assert_allclose(ours, plain(ground(seed)), rtol=1e-9, atol=1e-12)


def test_the_median_is_of_the_seen_cells():
    elevation = ground(1)
    wanted = [np.median(around(elevation, i, j, 0.04)[:, 2]) for i, j in zip(*np.nonzero(np.isfinite(elevation)))]
    ours = np.asarray(median(jnp.asarray(elevation), disc(0.04, SIZE)))
    np.testing.assert_allclose(ours[np.isfinite(elevation)], wanted, rtol=1e-12)
    assert np.all(np.isnan(ours[np.isnan(elevation)]))


def test_single_precision_keeps_five_digits_of_the_critical_values():
    steep = 0.9 * SIZE * np.arange(SHAPE[0])[:, None] + 1e-4 * np.random.default_rng(0).normal(size=SHAPE) + 3.0
    steep = np.float32(steep)
    ours, exact = compute(make(steep)), plain(steep.astype(float))
    for value, expected, critical in zip(map(np.asarray, ours[:3]), exact, (1.0, 0.05, 0.12)):
        assert np.max(np.abs(value - expected) - 1e-5 * np.abs(expected)) <= 1e-5 * critical


def test_gradients_are_finite_on_level_ground():
    total = jax.grad(lambda z: sum(jnp.sum(x) for x in features(make(z), SIZE, SETTINGS)))
    assert np.all(np.isfinite(jax.jit(total)(np.zeros(SHAPE))))


def test_level_ground_is_easy_and_a_riser_is_not():
    assert np.all(np.asarray(score(make(np.zeros((45, 12))), SIZE, FeatureSettings())) == 1.0)
    terrain = jax.jit(stairs, static_argnums=0)(Grid(45, 12, SIZE, (0.0, 0.0)), 0.08, 0.30, 0.45)
    along = np.asarray(score(terrain, SIZE, FeatureSettings()))[:, 6]
    distance = np.abs(SIZE * np.arange(45) - 0.45)
    assert np.all(along[distance < 0.04] < 0.7)
    assert np.all(along[(distance > 0.07) & (distance < 0.2)] == 1.0)


def test_disc_counts_cells_by_their_centres():
    assert len(disc(0.05, 0.02)) == 21
    assert len(disc(0.04, 0.02)) == 13
    assert disc(0.01, 0.02) == ((0, 0),)
