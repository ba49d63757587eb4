"""Where a foot may be placed: traversability, slope, edges and unseen cells. The foot is a disc, not a point."""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxleg.terrain.heightmap import HeightMap, node_slopes


def valid_cells(
    terrain: HeightMap,
    foot_radius: Float[ArrayLike, ""],
    window: int,
    slope_limit: Float[ArrayLike, ""] = 0.6,
    edge_height: Float[ArrayLike, ""] = 0.03,
    easy: Bool[Array, "nx ny"] | None = None,
) -> Bool[Array, "nx ny"]:
    """Whether a foot may stand with its centre on each cell.

    Valid: the sampled surface is at most as steep as `slope_limit` [rad] there (it is not where a neighbour is unseen), and
    no unseen cell and no edge lies within `foot_radius` [m]. An edge is a pair of neighbouring cells more than `edge_height`
    [m] apart; it takes up both cells, so the radius is measured to the cells' borders (half a cell is added).
    `window` >= ceil(foot_radius / resolution + 0.5) is how many cells are looked at; a smaller one overlooks some.
    `easy` marks the cells whose traversability is high enough (A9); every cell within `foot_radius` must be. Outside the map
    the ground goes on as at its border. An infinite elevation counts as unseen.
    """
    elevation = jnp.where(jnp.isfinite(terrain.elevation), terrain.elevation, jnp.nan)
    elevation = jnp.pad(elevation, 1, mode="edge")
    centre = elevation[1:-1, 1:-1]
    bad = jnp.isnan(centre)
    for neighbour in _neighbours(elevation):
        bad = bad | (jnp.abs(neighbour - centre) > edge_height)
    slope = jnp.hypot(node_slopes(elevation[:, 1:-1]), node_slopes(elevation[1:-1].T).T)
    gentle = slope <= jnp.tan(slope_limit) * terrain.resolution  # false for NaN
    clear = gentle & ~_spread(bad, foot_radius / terrain.resolution + 0.5, window)
    return clear if easy is None else clear & ~_spread(~easy, foot_radius / terrain.resolution + 1e-3, window)


def _neighbours(padded):
    return padded[2:, 1:-1], padded[:-2, 1:-1], padded[1:-1, 2:], padded[1:-1, :-2]


def _spread(bad, radius, window):
    """Cells with a bad one within `radius` cells."""
    padded = jnp.pad(bad, window)  # beyond the border nothing is nearer than the border
    nx, ny = bad.shape
    near = jnp.zeros_like(bad)
    for i in range(-window, window + 1):
        for j in range(-window, window + 1):
            shifted = padded[window + i : window + i + nx, window + j : window + j + ny]
            near = near | (shifted & (i * i + j * j <= radius**2))
    return near
