"""HeightMap: elevation on a regular grid, sampled as a smooth surface that neither rings nor overshoots.

The surface is a bicubic Hermite patch on each square of four neighbouring cell centres. The slopes at the centres are
harmonic means of the differences on either side (Fritsch and Butland 1984; PCHIP on a uniform grid) and 0 at an extremum; the
cross derivatives are 0. So the surface goes through the centres, is once continuously differentiable, stays between its
neighbours along grid lines (flat treads stay flat), and its second derivative exists but on the grid lines.
"""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxleg.numerics import of_one_rank
from jaxleg.pytree import pytree


@pytree
class HeightMap:
    """Elevation over world x (axis 0) and y (axis 1), at least 4 x 4 cells; NaN marks cells nobody has seen.

    Beyond its border the ground goes on level, as high as the outermost cells.
    """

    elevation: Float[Array, "*batch nx ny"]  # [m]
    origin: Float[Array, "*batch 2"]  # world xy of the centre of cell [0, 0] [m]
    resolution: Float[Array, "*batch"]  # [m per cell]


def height(terrain: HeightMap, xy: Float[Array, "2"]) -> Float[Array, ""]:
    """Height of the ground at xy in W [m]; see `height_and_gradient`."""
    return height_and_gradient(terrain, xy)[0]


@jax.jit
def heights(terrain: HeightMap, xy: Float[ArrayLike, "*n 2"]) -> Float[Array, "*n"]:
    """`height` at many places, in the map's precision."""
    places = jnp.asarray(xy, terrain.elevation.dtype)
    return jax.vmap(height, in_axes=(None, 0))(terrain, places.reshape(-1, 2)).reshape(places.shape[:-1])


def normal(terrain: HeightMap, xy: Float[Array, "2"]) -> Float[Array, "3"]:
    """Upward unit normal of the ground at xy, in W."""
    _, slope = height_and_gradient(terrain, xy)
    up = jnp.concatenate([-slope, jnp.ones(1, slope.dtype)])
    return up * jax.lax.rsqrt(jnp.sum(up * up))


def height_and_gradient(terrain: HeightMap, xy: Float[Array, "2"]) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """Height [m] and its gradient (dz/dx, dz/dy) at xy in W; equal to what differentiating `height` gives.

    NaN, both, where one of the twelve cells that the patch depends on (four corners and their neighbours) is unseen.
    Raises TypeError for a map smaller than 4 x 4 cells.
    """
    last = jnp.array(terrain.elevation.shape, jnp.int32) - 1
    place = jnp.clip((xy - terrain.origin) / terrain.resolution, 0.0, last.astype(xy.dtype))
    cell = jnp.minimum(jax.lax.stop_gradient(place).astype(jnp.int32), last - 1)
    controls = _controls(_patch(terrain.elevation, cell, last))
    weight, rate = _basis(place - cell.astype(place.dtype))
    ahead = jnp.sum(jnp.stack([weight[:, 0], rate[:, 0]])[:, :, None] * controls[None], axis=1)
    gradient = jnp.stack([jnp.sum(ahead[1] * weight[:, 1]), jnp.sum(ahead[0] * rate[:, 1])])
    return jnp.sum(ahead[0] * weight[:, 1]), gradient / terrain.resolution


def _patch(elevation, cell, last) -> Float[Array, "4 4"]:
    """The cells cell - 1 to cell + 2; beyond the border those of the border once more."""
    start = jnp.clip(cell - 1, 0, last - 3)
    patch, lag = jax.lax.dynamic_slice(elevation, start, (4, 4)), cell - 1 - start
    return _continued(_continued(patch, lag[0]).T, lag[1]).T


def _continued(patch: Float[Array, "4 4"], lag: Int[Array, ""]) -> Float[Array, "4 4"]:
    """Rows moved by lag (-1, 0, 1), the outermost doubled. Selects, because gathers and concatenations are slower here."""
    row = jnp.clip(jnp.arange(4, dtype=lag.dtype) + lag, 0, 3)[:, None]
    last = jnp.where(row == 2, patch[2], patch[3])
    return jnp.where(row == 0, patch[0], jnp.where(row == 1, patch[1], last))


def _controls(patch: Float[Array, "4 4"]) -> Float[Array, "4 4"]:
    """Hermite controls: rows (value, value, slope, slope) along x times columns likewise along y; slopes per cell."""
    node, along_x, along_y = patch[1:3, 1:3], node_slopes(patch[:, 1:3]), node_slopes(patch[1:3].T).T
    values, slopes = jnp.concatenate([node, along_y], axis=1), jnp.concatenate([along_x, jnp.zeros_like(node)], axis=1)
    return jnp.concatenate([values, slopes])


def node_slopes(elevation: Float[Array, "n m"]) -> Float[Array, "n-2 m"]:
    """Slopes [m per cell] along axis 0 at the inner rows: harmonic mean of the differences on either side, 0 at an extremum."""
    difference = elevation[1:] - elevation[:-1]
    return mean_slope(difference[:-1], difference[1:])


def mean_slope(before: Float[Array, "*n"], after: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Harmonic mean of the differences on either side of a cell, 0 where their signs differ; NaN if one is."""
    product = before * after
    monotone = product > 0
    total = jnp.where(monotone, before + after, 1.0)
    return jnp.where(monotone, 2.0 * product / total, 0.0 * product)  # 0 * product keeps NaN


def _basis(u: Float[Array, "axis"]) -> tuple[Float[Array, "4 axis"], Float[Array, "4 axis"]]:
    """Hermite basis at u in [0, 1]: weights of the two values and the two slopes, and their derivatives."""
    v = 1.0 - u
    blend, rate = u * u * (3.0 - 2.0 * u), 6.0 * u * v
    weights = jnp.stack([1.0 - blend, blend, u * v * v, -u * u * v])
    return weights, jnp.stack([-rate, rate, v * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)])


def nearest_height(terrain: HeightMap, xy: Float[Array, "2"]) -> Float[Array, ""]:
    """Elevation [m] of the cell whose centre is nearest to xy in W: a coarse, cheap look without a gradient."""
    size = jnp.array(terrain.elevation.shape, jnp.int32)
    cell = jnp.round((xy - terrain.origin) / terrain.resolution).astype(jnp.int32)
    cell = jnp.clip(cell, 0, size - 1)
    return jnp.asarray(terrain.elevation)[cell[0], cell[1]]  # NumPy's, closed over, could not be indexed by a tracer


FAR = 2**20  # cells, beyond any map; sums of a few do not overflow


def nearest_cell(terrain: HeightMap, xy: Float[Array, "*n 2"]) -> Int[Array, "*n 2"]:
    """Index of the cell whose centre is nearest to xy in W [m]; beyond the map it goes on counting, up to `FAR`.

    A place that is not a number is `FAR` off the map.
    """
    xy, origin = of_one_rank(xy, terrain.origin)
    place = jnp.clip(jnp.round((xy - origin) / terrain.resolution), -FAR, FAR)
    return jnp.where(jnp.isnan(place), -FAR, place).astype(jnp.int32)
