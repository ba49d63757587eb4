"""HeightMap: elevation on a regular grid, sampled as a smooth surface that neither rings nor overshoots."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class HeightMap:
    """Elevation over world x (axis 0) and y (axis 1); NaN marks cells nobody has seen."""

    elevation: Float[Array, "*batch nx ny"]  # [m]
    origin: Float[Array, "*batch 2"]  # world xy of the centre of cell [0, 0] [m]
    resolution: Float[Array, "*batch"]  # [m per cell]


def height(terrain: HeightMap, xy: Float[Array, "2"]) -> Float[Array, ""]:
    """Height of the ground at xy in W [m]; see `height_and_gradient`."""
    return height_and_gradient(terrain, xy)[0]


def normal(terrain: HeightMap, xy: Float[Array, "2"]) -> Float[Array, "3"]:
    """Upward unit normal of the ground at xy."""
    _, slope = height_and_gradient(terrain, xy)
    up = jnp.concatenate([-slope, jnp.ones(1, slope.dtype)])
    return up * jax.lax.rsqrt(jnp.sum(up * up))


def height_and_gradient(terrain: HeightMap, xy: Float[Array, "2"]) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """Height [m] and its gradient at xy in W: bicubic Hermite interpolation of the cells' centres, once differentiable.

    The slopes at the centres are harmonic means of the neighbouring differences (zero at an extremum), so flat treads stay
    flat and nothing overshoots along the grid lines. The outermost ring of cells only lends its slope: beyond the ring inside
    it the ground goes on level. NaN next to unseen cells. The map must be at least 4 x 4 cells.
    """
    size = jnp.array(terrain.elevation.shape)
    place = (xy - terrain.origin) / terrain.resolution
    inside = (place >= 1) & (place <= size - 2)
    place = jnp.clip(place, 1.0, (size - 2).astype(place.dtype))
    cell = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)).astype(jnp.int32), 1, size - 3)
    patch = jax.lax.dynamic_slice(terrain.elevation, cell - 1, (4, 4))
    share = place - cell
    (value_x, slope_x), (rate_x, bend_x) = _basis(share[0])
    (value_y, slope_y), (rate_y, bend_y) = _basis(share[1])
    node, along_x, along_y = patch[1:3, 1:3], _node_slopes(patch[:, 1:3]), _node_slopes(patch[1:3].T).T

    def surface(value_x, slope_x, value_y, slope_y):
        return jnp.sum(value_x[:, None] * (node * value_y + along_y * slope_y) + slope_x[:, None] * (along_x * value_y))

    gradient = [surface(rate_x, bend_x, value_y, slope_y), surface(value_x, slope_x, rate_y, bend_y)]
    gradient = jnp.where(inside, jnp.stack(gradient) / terrain.resolution, 0.0)
    return surface(value_x, slope_x, value_y, slope_y), gradient


def _basis(u):
    """Hermite basis on a cell: weights of the two values and the two slopes, and their derivatives."""
    blend, rate = u * u * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u)
    slopes = jnp.stack([u * (1.0 - u) ** 2, u * u * (u - 1.0)])
    slope_rates = jnp.stack([(1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)])
    return (jnp.stack([1.0 - blend, blend]), slopes), (jnp.stack([-rate, rate]), slope_rates)


def _node_slopes(patch: Float[Array, "4 2"]) -> Float[Array, "2 2"]:
    """Slopes per cell at the two inner rows: harmonic mean of the differences on either side, 0 at an extremum."""
    difference = patch[1:] - patch[:-1]
    before, after = difference[:-1], difference[1:]
    product = before * after
    monotone = product > 0
    total = jnp.where(monotone, before + after, 1.0)
    return jnp.where(monotone, 2.0 * product / total, 0.0 * product)


def nearest_height(terrain: HeightMap, xy: Float[Array, "2"]) -> Float[Array, ""]:
    """Elevation [m] of the cell whose centre is nearest to xy: a coarse, cheap look without a gradient."""
    size = jnp.array(terrain.elevation.shape)
    cell = jnp.round((xy - terrain.origin) / terrain.resolution).astype(jnp.int32)
    cell = jnp.clip(cell, 0, size - 1)
    return terrain.elevation[cell[0], cell[1]]
