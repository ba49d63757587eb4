"""Stairs obey rise, run, offset and heading; rough ground its statistics; a terrain depends on its key and number only."""

import jax
import numpy as np
import pytest
import scipy.special
from numpy.testing import assert_allclose

from jaxleg.conventions import InputError
from jaxleg.terrain.generators import (
    KINDS,
    Grid,
    TerrainSettings,
    cuboids,
    flat,
    fractal,
    rough,
    stairs,
    terrain,
    terrain_batch,
    terrain_keys,
)

GRID = Grid(24, 15, 0.04, (-0.3, -0.2))
SETTINGS = TerrainSettings()
make = jax.jit(terrain, static_argnums=(0, 1))
make_batch = jax.jit(terrain_batch, static_argnums=(0, 1, 3))


def centres(grid):
    """World xy of every cell's centre."""
    return np.asarray(jax.jit(Grid.points, static_argnums=0)(grid))


def test_grid_places_its_map():
    points, ground = centres(GRID), flat(GRID)
    assert points.shape == (24, 15, 2)
    assert_allclose(points[[0, -1], [0, -1]], [[-0.3, -0.2], [-0.3 + 23 * 0.04, -0.2 + 14 * 0.04]])
    assert_allclose(ground.origin, points[0, 0])
    assert_allclose(ground.resolution, 0.04)
    assert_allclose(ground.elevation, np.zeros((24, 15)))
    assert hash(GRID) == hash(Grid(24, 15, 0.04, (-0.3, -0.2)))


@pytest.mark.parametrize("heading", [0.0, np.pi / 2, 0.7, -2.0])
def test_stairs_rise_by_rise_every_run_along_the_heading(heading):
    rise, run, offset = 0.07, 0.23, 0.11
    elevation = np.asarray(jax.jit(stairs, static_argnums=0)(GRID, rise, run, offset, heading).elevation)
    along = centres(GRID) @ [np.cos(heading), np.sin(heading)]
    tread = np.round(elevation / rise)
    assert_allclose(elevation, rise * tread, atol=1e-12)
    assert len(np.unique(tread)) >= 3
    assert np.all(along >= offset + tread * run - 1e-9)  # between this riser
    assert np.all(along <= offset + (tread + 1) * run + 1e-9)  # and the next


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_same_key_same_ground_on_a_finer_grid(kind):
    fine = Grid(2 * 24 - 1, 2 * 15 - 1, 0.02, GRID.origin)
    key = jax.random.key(3)
    coarse, finer, other = (
        np.asarray(make(kind, grid, k, 1.0, SETTINGS).elevation)
        for grid, k in ((GRID, key), (fine, key), (GRID, jax.random.key(4)))
    )
    assert_allclose(finer[::2, ::2], coarse, atol=1e-12)
    assert np.array_equal(coarse, other) == (kind == "flat")


def test_rough_has_the_stated_spread_and_correlation():
    amplitude, length = 0.06, 0.2
    grid = Grid(2, 4, length / 2, (0.1, 0.7))
    keys = jax.random.split(jax.random.key(0), 8000)
    grounds = np.asarray(jax.jit(jax.vmap(lambda k: rough(grid, k, amplitude, length).elevation))(keys))
    assert_allclose(grounds.mean(axis=0), 0.0, atol=5 * 0.5 * amplitude / np.sqrt(8000))
    assert_allclose(grounds.std(axis=0), 0.5 * amplitude, rtol=0.04)
    correlation = [np.corrcoef(grounds[:, 0, 0], grounds[:, 0, k])[0, 1] for k in range(4)]
    assert_allclose(correlation, np.exp(-0.5 * (np.arange(4) / 2) ** 2), atol=0.06)


def test_cuboids_are_level_squares_of_uniform_height():
    grid = Grid(120, 90, 0.02, (0.0, 0.0))
    key = jax.random.key(2)
    ground = np.asarray(jax.jit(cuboids, static_argnums=0)(grid, key, 0.3, 0.1).elevation)
    place = np.asarray(jax.jit(lambda k: jax.random.uniform(jax.random.split(k)[0], (2,), float))(key))
    square = np.floor(centres(grid) / 0.3 + place).astype(int)
    tops = {tuple(c): ground[np.all(square == c, axis=-1)] for c in np.unique(square.reshape(-1, 2), axis=0)}
    assert all(np.ptp(top) == 0.0 for top in tops.values())
    heights = np.array([top[0] for top in tops.values()])
    assert len(np.unique(heights)) == len(tops) > 50
    assert np.abs(heights).max() <= 0.1
    assert_allclose(np.std(heights), 0.1 / np.sqrt(3.0), rtol=0.25)


def test_fractal_ground_has_the_stated_spread_and_structure():
    """Mean square of height differences over a distance d: 2 s^2 sum_o share_o (1 - J0(2 pi d / wavelength)), waves of any
    direction; an octave's share of the variance goes with its wavelength to the power 2 H."""
    grid = Grid(9, 4, 0.2, (0.3, -0.4))
    keys = jax.random.split(jax.random.key(0), 4000)
    grounds = np.asarray(jax.jit(jax.vmap(lambda k: fractal(grid, k, 0.1, 4.0).elevation))(keys))
    assert_allclose(grounds.std(axis=0), 0.1, rtol=0.05)
    octave, within = np.arange(5.0)[:, None], (np.arange(200) + 0.5) / 200
    share = 4.0 ** (-0.8 * octave) / np.sum(4.0 ** (-0.8 * octave))
    for k in (1, 2, 4, 8):
        square = np.mean((grounds[:, k] - grounds[:, 0]) ** 2)
        waves = 1.0 - scipy.special.j0(2.0 * np.pi * 0.2 * k / (4.0 * 2.0 ** -(octave + within)))
        assert_allclose(square, 2.0 * 0.1**2 * np.sum(share * waves.mean(axis=1, keepdims=True)), rtol=0.06)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_difficulty_scales_the_heights(kind):
    none, half, whole = (
        np.asarray(make(kind, GRID, jax.random.key(1), share, SETTINGS).elevation) for share in (0.0, 0.5, 1.0)
    )
    assert_allclose(none, 0.0, atol=1e-15)
    assert_allclose(half, 0.5 * whole, atol=1e-12)


def test_stairs_of_many_keys_begin_anywhere_on_a_tread():
    line = Grid(300, 1, 0.001, (0.0, 0.0))
    grounds = np.asarray(make_batch("stairs", line, jax.random.key(0), 0, np.ones(200), SETTINGS).elevation)
    riser = np.argmax(np.diff(grounds[:, :, 0], axis=1) > 0, axis=1) * 0.001
    assert_allclose(np.quantile(riser, [0.05, 0.5, 0.95]), np.array([0.05, 0.5, 0.95]) * 0.30, atol=0.04)


@pytest.mark.parametrize("kind", ["rough", "stairs"])
def test_a_terrain_does_not_depend_on_how_its_batch_is_cut(kind):
    key, difficulties = jax.random.key(7), np.linspace(0.2, 1.0, 5)
    whole = np.asarray(make_batch(kind, GRID, key, 10, difficulties, SETTINGS).elevation)
    part = make_batch(kind, GRID, key, 12, difficulties[2:4], SETTINGS).elevation
    assert_allclose(whole[2:4], part, atol=1e-12)
    number_13 = jax.jit(lambda key: terrain_keys(key, 13, 1)[0])(key)
    one = make(kind, GRID, number_13, difficulties[3], SETTINGS).elevation
    assert_allclose(whole[3], one, atol=1e-12)


def test_settings_are_leaves_to_batch_over():
    batch = TerrainSettings(rise=np.array([0.02, 0.09]))
    axes = TerrainSettings(0, *[None] * 8)
    rise = jax.vmap(lambda settings: terrain("stairs", GRID, jax.random.key(0), 1.0, settings).elevation, in_axes=(axes,))
    low, high = np.asarray(jax.jit(rise)(batch))
    assert_allclose(high, 4.5 * low, atol=1e-12)


def test_an_unknown_kind_is_an_input_error():
    with pytest.raises(InputError, match="'lava' is unknown; there are cuboids, flat, fractal, rough, stairs"):
        terrain("lava", GRID, jax.random.key(0), 1.0, SETTINGS)
