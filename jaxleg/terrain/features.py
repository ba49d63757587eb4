"""Terrain features of an elevation map with unseen cells: slope, roughness, step height; and the traversability of A9.

Read as in Wermelinger 2016 and its published filters: slope and roughness from a least-squares plane over a disc, step height
from two windows, each feature scored by max(0, 1 - feature / critical value), traversability the mean of the scores. Windows
use the seen cells in them; beyond the map's border there are none. An unseen (not finite) cell has no features: NaN.
"""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.relief import plane, spread, step_height
from jaxleg.terrain.window import disc


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
    first, second = (disc(radius, resolution) for radius in (settings.first_radius, settings.second_radius))
    fit = plane(elevation, resolution, disc(settings.plane_radius, resolution), "residual")
    step = step_height(elevation, spread(elevation, first, settings.critical_step), second, settings.critical_count)
    return Features(*(jnp.where(jnp.isnan(elevation), jnp.nan, value) for value in (fit.slope, fit.roughness, step)))
