"""Where a foot may be placed: slope, edges and unseen cells. (The traversability map of paper A, A9, comes on top.)"""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxleg.terrain.heightmap import HeightMap


def valid_cells(
    terrain: HeightMap,
    foot_radius: Float[ArrayLike, ""],
    window: int,
    slope_limit: Float[ArrayLike, ""] = 0.6,
    edge_height: Float[ArrayLike, ""] = 0.03,
) -> Bool[Array, "nx ny"]:
    """Whether a foot may stand with its centre on each cell.

    Valid: the slope there is at most `slope_limit` [rad], and no unseen cell and no edge lies within the foot's radius [m]. An
    edge is a pair of neighbouring cells more than `edge_height` [m] apart; it takes up both cells, so the radius is measured
    to the cells' borders (half a cell is added). `window` >= foot_radius / resolution + 0.5 is how many cells are looked at.
    Outside the map the ground goes on as at its border.
    """
    elevation = jnp.pad(terrain.elevation, 1, mode="edge")
    centre = elevation[1:-1, 1:-1]
    steps = [neighbour - centre for neighbour in _neighbours(elevation)]
    bad = jnp.isnan(centre)
    for step in steps:
        bad = bad | (jnp.abs(step) > edge_height)
    slope_x, slope_y = 0.5 * (steps[0] - steps[1]), 0.5 * (steps[2] - steps[3])
    steep = jnp.hypot(slope_x, slope_y) > jnp.tan(slope_limit) * terrain.resolution
    return ~(_spread(bad, foot_radius / terrain.resolution + 0.5, window) | steep)


def _neighbours(padded):
    return padded[2:, 1:-1], padded[:-2, 1:-1], padded[1:-1, 2:], padded[1:-1, :-2]


def _spread(bad, radius, window):
    """Cells with a bad one within `radius` cells."""
    padded = jnp.pad(bad, window, mode="edge")
    nx, ny = bad.shape
    near = jnp.zeros_like(bad)
    for i in range(-window, window + 1):
        for j in range(-window, window + 1):
            shifted = jax.lax.dynamic_slice(padded, (window + i, window + j), (nx, ny))
            near = near | (shifted & (i * i + j * j <= radius**2))
    return near
