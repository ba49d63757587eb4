"""Cost of the ground under the robot's body: slope, roughness and step height over a disc round each cell. Paper C, 2.1.

A disc uses the seen cells in it, its middle need not be one; beyond the map's border nothing is seen. Exact by default. With
a `softness` [m], a value that may be traced, every feature has a useful gradient: a maximum becomes a mean weighted by
exp(value / softness), a count a sum of sigmoids. As it goes to 0 these tend to the exact forms, but for a cell with several
equally different neighbours: the exact form takes the nearest of them, the smooth one their mean.
"""

import dataclasses
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxleg.numerics import sqrt_safe
from jaxleg.settings import setting
from jaxleg.terrain.features import Disc, disc, over_disc
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.window import fold

SAME = 1e-6  # height differences [m] so close are the same: rounding shall not decide which neighbour is a cell's own


@dataclasses.dataclass(frozen=True)
class BodySettings:
    """Windows and readings; static. The defaults suit a robot of 1.0 x 0.4 m that walks 0.5 m high on cells of 0.04 m."""

    radius: float = setting(0.45, above=0.0, max=10.0, unit="m", help="r_body: of the disc, which covers the robot")
    step_radius: float = setting(0.10, above=0.0, max=10.0, unit="m", help="of the sliding window of the step height")
    critical_slope: float = setting(1.0, above=0.0, below=1.57, unit="rad", help="a steeper line to a neighbour is a step")
    critical_step: float = setting(0.12, above=0.0, max=10.0, unit="m", help="a greater difference is a step (step = count)")
    critical_count: int = setting(10, min=1, max=10**6, help="n_cr: cells with a step that make a full step")
    roughness: Literal["deviation", "residual"] = setting("deviation", help="of elevation (C), or from the plane, over n - 1")
    step: Literal["own_neighbour", "count"] = setting("own_neighbour", help="as in paper C, or as in the published filters")


class BodyFeatures(NamedTuple):
    """Features of the disc round each cell; NaN where fewer than three cells are seen or all lie in a row."""

    slope: Float[Array, "nx ny"]  # between the normal of the least-squares plane and the vertical [rad]. (1)-(7)
    roughness: Float[Array, "nx ny"]  # standard deviation of elevation [m]. (8)
    step_height: Float[Array, "nx ny"]  # [m]. (9)
    seen: Float[Array, "nx ny"]  # share of the disc's cells that are on the map and seen


class BodyWeights(NamedTuple):
    """Values of (10); all may be traced."""

    weight: Float[ArrayLike, "3"]  # w of slope, roughness, step height; their squares sum to 1
    limit: Float[ArrayLike, "3"]  # s_max [rad], r_max, h_max [m]: greatest values, features beyond are clipped
    threshold: Float[ArrayLike, ""]  # step height that cannot be traversed [m]
    least_seen: Float[ArrayLike, ""]  # share of a disc


def body_cost(
    features: BodyFeatures, weights: BodyWeights, combine: Literal["norm", "linear"] = "norm"
) -> Float[Array, "nx ny"]:
    """Cost of the body's centre on each cell: in [0, 1], or infinite where it cannot go. Paper C, (10).

    sqrt(sum (w x / x_max)^2), or sum w^2 x / x_max when `linear`, which fits the paper's words as well. Infinite where the
    step height exceeds its threshold, too little of the disc is seen, or a feature is NaN.
    """
    possible = traversable(features, weights)
    values = jnp.where(possible, jnp.stack(features[:3]), 0.0)
    limit, weight = (jnp.asarray(x)[:, None, None] for x in (weights.limit, weights.weight))
    share = jnp.clip(values / limit, 0.0, 1.0)
    cost = jnp.sum(weight**2 * share, axis=0) if combine == "linear" else sqrt_safe(jnp.sum((weight * share) ** 2, axis=0))
    return jnp.where(possible, jnp.minimum(cost, 1.0), jnp.inf)  # rounding may leave a norm of 1 + 1e-7


def traversable(features: BodyFeatures, weights: BodyWeights) -> Bool[Array, "nx ny"]:
    """Where the body's centre may be: the cells of finite `body_cost`. Paper C, 2.1.4 (i)."""
    known = ~jnp.any(jnp.isnan(jnp.stack(features[:3])), axis=0) & (features.seen >= weights.least_seen)
    return known & (features.step_height <= weights.threshold)


def body_features(
    terrain: HeightMap, resolution: float, settings: BodySettings, softness: Float[ArrayLike, ""] | None = None
) -> BodyFeatures:
    """Slope, roughness and step height of the disc round each cell, exact or smooth (above). Paper C, (1)-(9).

    `resolution` is the map's [m per cell] and static: it sets the windows.
    """
    elevation = jnp.where(jnp.isfinite(terrain.elevation), terrain.elevation, jnp.nan)
    window = disc(settings.radius, resolution)
    fits, count, slope, roughness = _plane(elevation, resolution, window, settings.roughness)
    step = _step_height(elevation, resolution, window, settings, softness)
    known = (jnp.where(fits, value, jnp.nan) for value in (slope, roughness, step))
    return BodyFeatures(*known, seen=count / len(window))


def _plane(elevation, resolution: float, window: Disc, roughness: str):
    """Whether a plane fits, the number of seen cells, the plane's slope [rad], and the roughness [m]."""
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
    plane = ((jj * iz - ij * jz) / determinant, (ii * jz - ij * iz) / determinant)  # rise per cell along x, y
    slope = jnp.arctan2(sqrt_safe(plane[0] ** 2 + plane[1] ** 2), resolution)
    least = jnp.maximum(count, 1.0)
    if roughness == "residual":
        rest = _residual(elevation, window, plane, (mean_i, mean_j, mean + z / least))
        return fits, count, slope, sqrt_safe(rest / jnp.maximum(count - 1.0, 1.0))
    return fits, count, slope, sqrt_safe(zz / least - (z / least) ** 2)


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


def _residual(elevation, window: Disc, plane, middle):
    """Sum of squared distances [m^2] in height from a plane through `middle` (i, j [cells], height [m])."""

    def visit(total, offset, heights):
        z = heights - middle[2] - plane[0] * (offset[0] - middle[0]) - plane[1] * (offset[1] - middle[1])
        return total + jnp.where(jnp.isnan(heights), 0.0, z) ** 2

    return fold(elevation, window, visit, jnp.zeros_like(elevation))


def _step_height(elevation, resolution: float, window: Disc, settings: BodySettings, softness):
    """min(h, n_st / n_cr h), h the greatest height difference of the disc's cells, n_st those of them with a step. (9)"""
    differ = _own_neighbour if settings.step == "own_neighbour" else _range
    difference, excess = differ(elevation, resolution, settings, softness)
    difference = jnp.where(jnp.isnan(elevation), -jnp.inf, difference)
    greatest = over_disc(difference, -jnp.inf, jax.lax.max, window)
    if softness is None:
        highest, is_step = greatest, (excess > 0.0).astype(elevation.dtype)
    else:
        highest = _soft_maximum(difference, jax.lax.stop_gradient(greatest), window, softness)
        is_step = jax.nn.sigmoid(excess / softness)
    is_step = jnp.where(jnp.isnan(elevation), 0.0, is_step)
    count = fold(is_step, window, lambda total, _, steps: total + jnp.nan_to_num(steps), jnp.zeros_like(elevation))
    return highest * jnp.minimum(1.0, count / settings.critical_count)


def _range(elevation, resolution: float, settings: BodySettings, softness):
    """Highest less lowest seen cell of each sliding window [m], and by how much it exceeds the critical step [m]."""
    window = disc(settings.step_radius, resolution)
    unseen, highest = jnp.isnan(elevation), 0.0
    for sign in (1.0, -1.0):
        heights = jnp.where(unseen, -jnp.inf, sign * elevation)
        top = over_disc(heights, -jnp.inf, jax.lax.max, window)
        if softness is not None:
            top = _soft_maximum(heights, jax.lax.stop_gradient(top), window, softness)
        highest += jnp.where(unseen, 0.0, top)
    return highest, highest - settings.critical_step


def _own_neighbour(elevation, resolution: float, settings: BodySettings, softness):
    """Greatest difference [m] of each cell to a seen neighbour in the sliding window, 0 without one; and its excess.

    That is how far [m] the neighbour lies beyond a line of the critical slope: positive for a steeper line.
    """
    neighbours = tuple(place for place in disc(settings.step_radius, resolution) if place != (0, 0))
    steepest = float(np.tan(settings.critical_slope)) * resolution

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
        return greatest, fold(elevation, neighbours, excess, zeros - jnp.inf)
    weight, difference, beyond = fold(elevation, neighbours, weighed, (zeros,) * 3)
    alone = weight == 0.0
    weight = jnp.where(alone, 1.0, weight)
    return difference / weight, jnp.where(alone, -jnp.inf, beyond / weight)


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
