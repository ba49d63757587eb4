"""The ground's relief: slope, roughness and step height over windows of cells. Papers A, IV.B.1 (A9) and C, 2.1.

Windows use the seen cells in them; beyond the map's border there are none. Unseen cells of an `elevation` are NaN. A `softness`
[m], which may be traced, makes a maximum a mean weighted by exp(value / softness), and a count a sum of sigmoids.
"""

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.numerics import sqrt_safe
from jaxleg.terrain.window import Disc, fold, over_disc

SAME = 1e-6  # height differences [m] so close are the same: rounding shall not decide which neighbour is a cell's own


class Plane(NamedTuple):
    """The least-squares plane of each cell's window; NaN where fewer than three cells are seen or all lie in a row."""

    count: Float[Array, "nx ny"]  # of seen cells, never NaN
    slope: Float[Array, "nx ny"]  # between the plane's normal and the vertical [rad]
    roughness: Float[Array, "nx ny"]  # [m]


class Steps(NamedTuple):
    """Differences of height about each cell."""

    difference: Float[Array, "nx ny"]  # [m]
    excess: Float[Array, "nx ny"]  # by how much it is more than no step [m]


def plane(
    elevation: Float[Array, "nx ny"], resolution: float, window: Disc, roughness: Literal["deviation", "residual"]
) -> Plane:
    """Planes through the seen cells of windows. C, (1)-(8).

    Roughness is the standard deviation of elevation, or that of the residuals over n - 1. Both features have gradient 0 on
    level ground.
    """
    count, mean, (mean_i, mean_j, ii, ij, jj) = _places(elevation, window)
    zeros = jnp.zeros_like(elevation)

    def visit(total, offset, heights):
        z = jnp.where(jnp.isnan(heights), 0.0, heights - mean)  # about a mean: squares of heights cancel
        terms = (z, (offset[0] - mean_i) * z, (offset[1] - mean_j) * z, z * z)
        return tuple(t + term for t, term in zip(total, terms))

    z, iz, jz, zz = fold(elevation, window, visit, (zeros,) * 4)
    determinant = ii * jj - ij * ij
    fits = (count >= 3) & (determinant > 1e-3)  # in cells: below that they lie in a row
    determinant = jnp.where(fits, determinant, 1.0)
    rise = ((jj * iz - ij * jz) / determinant, (ii * jz - ij * iz) / determinant)  # rise per cell along x, y
    slope = jnp.arctan2(sqrt_safe(rise[0] ** 2 + rise[1] ** 2), resolution)
    least = jnp.maximum(count, 1.0)
    if roughness == "residual":
        rest = _residual(elevation, window, rise, (mean_i, mean_j, mean + z / least))
        variance = rest / jnp.maximum(count - 1.0, 1.0)
    else:
        variance = zz / least - (z / least) ** 2
    return Plane(count, *(jnp.where(fits, value, jnp.nan) for value in (slope, sqrt_safe(variance))))


def _places(elevation, window: Disc):
    """Of the seen cells: number, mean height, and where they lie [cells]: means and centred sums of squares."""
    base = jnp.nan_to_num(jnp.nanmean(jax.lax.stop_gradient(elevation)))
    zeros = jnp.zeros_like(elevation)

    def visit(total, offset, heights):
        here = ~jnp.isnan(heights)
        one, (i, j) = here.astype(elevation.dtype), offset
        terms = (one, i * one, j * one, i * i * one, i * j * one, j * j * one, jnp.where(here, heights - base, 0.0))
        return tuple(t + term for t, term in zip(total, terms))

    count, i, j, ii, ij, jj, z = fold(elevation, window, visit, (zeros,) * 7)
    least = jnp.maximum(count, 1.0)
    centred = (ii - i * i / least, ij - i * j / least, jj - j * j / least)
    mean = jax.lax.stop_gradient(base + z / least)  # near the true mean is all that it must be
    return count, mean, (i / least, j / least, *centred)


def _residual(elevation, window: Disc, rise, middle):
    """Sum of squared distances [m^2] in height from a plane through `middle` (i, j [cells], height [m])."""

    def visit(total, offset, heights):
        z = heights - middle[2] - rise[0] * (offset[0] - middle[0]) - rise[1] * (offset[1] - middle[1])
        return total + jnp.where(jnp.isnan(heights), 0.0, z) ** 2

    return fold(elevation, window, visit, jnp.zeros_like(elevation))


def step_height(
    elevation: Float[Array, "nx ny"],
    steps: Steps,
    window: Disc,
    critical_count: int,
    softness: Float[ArrayLike, ""] | None = None,
) -> Float[Array, "nx ny"]:
    """Step height [m]: min(h, n_st / n_cr h), h the greatest of a window's differences, n_st those that are a step. C, (9)."""
    difference, excess = steps
    difference = jnp.where(jnp.isnan(elevation), -jnp.inf, difference)
    greatest = over_disc(difference, -jnp.inf, jax.lax.max, window)
    if softness is None:
        highest, is_step = greatest, (excess > 0.0).astype(elevation.dtype)
    else:
        highest = _soft_maximum(difference, jax.lax.stop_gradient(greatest), window, softness)
        is_step = jax.nn.sigmoid(excess / softness)
    is_step = jnp.where(jnp.isnan(elevation), 0.0, is_step)
    count = fold(is_step, window, lambda total, _, steps: total + jnp.nan_to_num(steps), jnp.zeros_like(elevation))
    return highest * jnp.minimum(1.0, count / critical_count)


def spread(
    elevation: Float[Array, "nx ny"], window: Disc, critical_step: float, softness: Float[ArrayLike, ""] | None = None
) -> Steps:
    """Highest less lowest seen cell of each window; a step is more than `critical_step` [m]."""
    unseen, highest = jnp.isnan(elevation), 0.0
    for sign in (1.0, -1.0):
        heights = jnp.where(unseen, -jnp.inf, sign * elevation)
        top = over_disc(heights, -jnp.inf, jax.lax.max, window)
        if softness is not None:
            top = _soft_maximum(heights, jax.lax.stop_gradient(top), window, softness)
        highest += jnp.where(unseen, 0.0, top)
    return Steps(highest, highest - critical_step)


def own_neighbour(
    elevation: Float[Array, "nx ny"], window: Disc, steepest: float, softness: Float[ArrayLike, ""] | None = None
) -> Steps:
    """Greatest difference of each cell to a seen neighbour in the window, 0 without one.

    A step lies beyond a line that rises by `steepest` [m] a cell.
    """
    neighbours = tuple(place for place in window if place != (0, 0))

    def apart(offset, heights):
        """Difference [m], seen or 0; the difference of a line of the critical slope [m]; whether both cells are seen."""
        difference = heights - elevation
        both = ~jnp.isnan(difference)
        return jnp.abs(jnp.where(both, difference, 0.0)), steepest * jnp.sqrt(jnp.sum(offset**2)), both

    def higher(total, offset, heights):
        return jnp.maximum(total, apart(offset, heights)[0])

    def excess(total, offset, heights):
        difference, line, both = apart(offset, heights)
        return jnp.where(both & (difference >= greatest - SAME), jnp.maximum(total, difference - line), total)

    def weighed(total, offset, heights):
        difference, line, both = apart(offset, heights)
        weight = jnp.where(both, jnp.exp((difference - jax.lax.stop_gradient(greatest)) / softness), 0.0)
        return tuple(t + weight * term for t, term in zip(total, (1.0, difference, difference - line)))

    zeros = jnp.zeros_like(elevation)
    greatest = fold(elevation, neighbours, higher, zeros)
    if softness is None:
        return Steps(greatest, fold(elevation, neighbours, excess, zeros - jnp.inf))
    weight, difference, beyond = fold(elevation, neighbours, weighed, (zeros,) * 3)
    alone = weight == 0.0
    weight = jnp.where(alone, 1.0, weight)
    return Steps(difference / weight, jnp.where(alone, -jnp.inf, beyond / weight))


def _soft_maximum(values, top, window: Disc, softness):
    """Mean of a window's values weighted by exp(value / softness); `top`, their maximum, keeps the weights from overflow."""
    top = jnp.where(jnp.isfinite(top), top, 0.0)

    def visit(total, offset, values):
        del offset
        here = values > -jnp.inf
        value = jnp.where(here, values, 0.0)
        weight = jnp.where(here, jnp.exp((value - top) / softness), 0.0)
        return total[0] + weight, total[1] + weight * value

    weight, total = fold(values, window, visit, (jnp.zeros_like(values),) * 2)
    return total / jnp.where(weight > 0.0, weight, 1.0)
