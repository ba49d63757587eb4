"""Terrain features of an elevation map with unseen cells: slope, roughness, step height; and the traversability of A9.

Read as in Wermelinger 2016 and its published filters: slope and roughness from a least-squares plane over a disc, step height
from two windows, each feature scored by max(0, 1 - feature / critical value), traversability the mean of the scores. Windows
use the seen cells in them; beyond the map's border there are none. An unseen (not finite) cell has no features: NaN.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from jaxleg.numerics import sqrt_safe
from jaxleg.terrain.heightmap import HeightMap

Disc = tuple[tuple[int, int], ...]


class Features(NamedTuple):
    """Features of each cell."""

    slope: Float[Array, "nx ny"]  # between the plane's normal and the vertical [rad]
    roughness: Float[Array, "nx ny"]  # standard deviation about the plane, over n - 1 [m]
    step_height: Float[Array, "nx ny"]  # [m]


@dataclasses.dataclass(frozen=True)
class FeatureSettings:
    """Windows and critical values; static. The defaults are those of the published filters."""

    plane_radius: float = 0.05  # [m]
    first_radius: float = 0.04  # of the window in which heights differ [m]
    second_radius: float = 0.04  # of the window in which such differences are counted [m]
    critical_slope: float = 1.0  # [rad]
    critical_roughness: float = 0.05  # [m]
    critical_step: float = 0.12  # [m]
    critical_count: int = 4  # n_cr: cells with a critical difference that make a full step


def disc(radius: float, resolution: float) -> Disc:
    """Offsets of the cells whose centres lie within `radius` [m]; static."""
    reach = int(radius / resolution + 1e-6)
    cells = np.arange(-reach, reach + 1)
    limit = (radius / resolution + 1e-6) ** 2
    return tuple((int(i), int(j)) for i in cells for j in cells if i * i + j * j <= limit)


def over_disc(values: Shaped[Array, "nx ny"], start: Any, reduce: Callable, window: Disc) -> Shaped[Array, "nx ny"]:
    """An idempotent reduction (or, max) of each cell's disc, which begins with `start` and so ends at the map's border.

    The disc is a union of a few rectangles, each of them two passes, along x and along y.
    """
    parts = []
    for i, j in _corners(window):
        along = jax.lax.reduce_window(values, start, reduce, (2 * i + 1, 1), (1, 1), "SAME")
        parts.append(jax.lax.reduce_window(along, start, reduce, (1, 2 * j + 1), (1, 1), "SAME"))
    return functools.reduce(reduce, parts)


def _corners(window: Disc) -> list[tuple[int, int]]:
    """Corners (i, j >= 0) of the largest rectangles within a disc."""
    widest = {i: max(j for k, j in window if k == i) for i, _ in window if i >= 0}
    return [(i, j) for i, j in widest.items() if j > widest.get(i + 1, -1)]


def traversability(terrain: HeightMap, resolution: float, settings: FeatureSettings) -> Float[Array, "nx ny"]:
    """Traversability in [0, 1] of each cell, 1 = easy, NaN where unseen. Paper A, IV.B.1.

    `resolution` is the map's [m per cell], static here: it sets the windows.
    """
    seen = features(terrain, resolution, settings)
    critical = (settings.critical_slope, settings.critical_roughness, settings.critical_step)
    scores = [jnp.maximum(0.0, 1.0 - value / limit) for value, limit in zip(seen, critical)]
    return jnp.mean(jnp.stack(scores), axis=0)


def features(terrain: HeightMap, resolution: float, settings: FeatureSettings) -> Features:
    """Slope, roughness and step height of each cell; `resolution` [m per cell] is static, as in `traversability`."""
    elevation = jnp.where(jnp.isfinite(terrain.elevation), terrain.elevation, jnp.nan)
    slope, roughness = slope_and_roughness(elevation, resolution, disc(settings.plane_radius, resolution))
    step = step_height(elevation, resolution, settings)
    unseen = jnp.isnan(elevation)
    return Features(*(jnp.where(unseen, jnp.nan, value) for value in (slope, roughness, step)))


def slope_and_roughness(
    elevation: Float[Array, "nx ny"], resolution: float, window: Disc
) -> tuple[Float[Array, "nx ny"], Float[Array, "nx ny"]]:
    """Slope [rad] of the least-squares plane through the seen cells of a window, and the residuals' deviation over n - 1 [m].

    NaN with fewer than three seen cells or with all of them in a row. Both have gradient 0 on level ground.
    """
    middle = jnp.where(jnp.isnan(elevation), 0.0, elevation)
    shifted = list(_shifted(elevation, window, jnp.nan))
    seen = [~jnp.isnan(height) for height in shifted]
    heights = [jnp.where(here, height, middle) - middle for here, height in zip(seen, shifted)]
    count, mean_i, mean_j, mean_z, ii, ij, jj, iz, jz = _moments(heights, seen, window)
    determinant = ii * jj - ij * ij
    fits = (count >= 3) & (determinant > 1e-3)  # in cells: below that they lie in a row
    determinant = jnp.where(fits, determinant, 1.0)
    ahead, aside = (jj * iz - ij * jz) / determinant, (ii * jz - ij * iz) / determinant
    level = mean_z - ahead * mean_i - aside * mean_j
    squares = [(z - level - ahead * i - aside * j) ** 2 for (i, j), z in zip(window, heights)]  # not zz - ...: it cancels
    residual = sum(jnp.where(here, square, 0.0) for here, square in zip(seen, squares))
    roughness = sqrt_safe(residual / jnp.maximum(count - 1.0, 1.0))
    slope = jnp.arctan(sqrt_safe(ahead**2 + aside**2) / resolution)
    return jnp.where(fits, slope, jnp.nan), jnp.where(fits, roughness, jnp.nan)


def step_height(elevation: Float[Array, "nx ny"], resolution: float, settings: FeatureSettings) -> Float[Array, "nx ny"]:
    """Step height [m]: min(h, n_st / n_cr h), h the largest of the height differences in the window (paper C, (9)).

    A height difference is the highest less the lowest seen cell of the first window; n_st counts those in the second window
    that exceed the critical step.
    """
    first, second = disc(settings.first_radius, resolution), disc(settings.second_radius, resolution)
    difference = _highest(elevation, first) + _highest(-elevation, first)
    difference = jnp.where(jnp.isnan(elevation), jnp.nan, difference)
    highest = _highest(difference, second)
    critical = (difference > settings.critical_step).astype(elevation.dtype)
    count = sum(_shifted(critical, second, 0.0))
    return jnp.minimum(highest, count / settings.critical_count * highest)


def _moments(heights, seen, window):
    """Number of seen cells, means of i, j, z and their centred sums ii, ij, jj, iz, jz; i and j in cells."""
    sums = [jnp.zeros_like(heights[0])] * 9
    for (i, j), z, present in zip(window, heights, seen):
        here = present.astype(z.dtype)
        terms = (here, i * here, j * here, z, i * i * here, i * j * here, j * j * here, i * z, j * z)
        sums = [total + term for total, term in zip(sums, terms)]
    count, of_i, of_j, of_z, ii, ij, jj, iz, jz = sums
    mean_i, mean_j, mean_z = (s / jnp.maximum(count, 1.0) for s in (of_i, of_j, of_z))
    centred = (ii - of_i * mean_i, ij - of_i * mean_j, jj - of_j * mean_j, iz - of_i * mean_z, jz - of_j * mean_z)
    return count, mean_i, mean_j, mean_z, *centred


def _highest(values, window):
    """Greatest of the seen values in a window; minus infinity where there is none."""
    return over_disc(jnp.where(jnp.isnan(values), -jnp.inf, values), -jnp.inf, jax.lax.max, window)


def _shifted(values, window, beyond):
    """The map moved by each offset of a window, so that cell [i, j] holds what lies there from it."""
    reach = max(max(abs(i), abs(j)) for i, j in window)
    padded = jnp.pad(values, reach, constant_values=beyond)
    nx, ny = values.shape
    for i, j in window:
        yield padded[reach + i : reach + i + nx, reach + j : reach + j + ny]
