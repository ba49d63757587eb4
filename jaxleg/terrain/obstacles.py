"""The ground as obstacles: columns, one a cell, widened for looks at single points of a leg or trunk. Paper C, 3.2 (C12)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.terrain.heightmap import HeightMap, nearest_height
from jaxleg.terrain.window import Disc, over_disc


class Obstacles(NamedTuple):
    """The ground as columns, widened for a look at one point of a leg or trunk; no obstacle (-inf) where unseen."""

    leg: HeightMap  # by whole cells
    rest: Float[Array, ""]  # what is left of a leg's radius beyond them [m]
    trunk: HeightMap  # by what the trunk's points leave between them


def obstacles(terrain: HeightMap, resolution: float, leg_radius: float, trunk_spacing: float) -> Obstacles:
    """Widen a map; lengths [m] and the map's `resolution` are static."""
    seen = jnp.where(jnp.isfinite(terrain.elevation), terrain.elevation, -jnp.inf)

    def widened(window: Disc) -> HeightMap:
        return HeightMap(over_disc(seen, -jnp.inf, jax.lax.max, window), terrain.origin, terrain.resolution)

    cells = max(int(np.ceil(leg_radius / resolution - 0.5 - 1e-6)), 0)
    square = tuple((i, j) for i in range(-cells, cells + 1) for j in range(-cells, cells + 1))
    rest = jnp.asarray(max(leg_radius - cells * resolution, 0.0), seen.dtype)
    return Obstacles(widened(square), rest, widened(columns_within(trunk_spacing / np.sqrt(2.0), resolution)))


def highest_near(ground: Obstacles, xy: Float[Array, "2"]) -> Float[Array, ""]:
    """Highest column [m] within a leg's radius of xy along x and y: the corners of that square, on the widened map."""
    corners = xy[None] + ground.rest * jnp.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]], xy.dtype)
    return jnp.max(jax.vmap(nearest_height, in_axes=(None, 0))(ground.leg, corners))


def columns_within(radius: float, resolution: float) -> Disc:
    """Offsets of the cells whose square columns come within a radius [m] of some point of the middle cell; static."""
    reach = int(np.ceil(radius / resolution)) + 1
    gap = np.maximum(np.abs(np.arange(-reach, reach + 1)) - 1, 0) * resolution
    near = np.hypot(gap[:, None], gap[None]) < radius
    return tuple((int(i), int(j)) for i, j in np.argwhere(near) - reach)
