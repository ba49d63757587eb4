"""Cost of the ground under the robot's body: slope, roughness and step height over a disc round each cell. Paper C, 2.1.

A disc uses the seen cells in it, its middle need not be one; beyond the map's border nothing is seen. Exact by default. With
a `softness` [m], a value that may be traced, every feature has a useful gradient: a maximum becomes a mean weighted by
exp(value / softness), a count a sum of sigmoids. As it goes to 0 these tend to the exact forms, but for a cell with several
equally different neighbours: the exact form takes the nearest of them, the smooth one their mean.
"""

import dataclasses
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxleg.numerics import sqrt_safe
from jaxleg.settings import setting
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.relief import own_neighbour, plane, spread, step_height
from jaxleg.terrain.window import disc


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
    fit, near = plane(elevation, resolution, window, settings.roughness), disc(settings.step_radius, resolution)
    if settings.step == "own_neighbour":
        steps = own_neighbour(elevation, near, float(np.tan(settings.critical_slope)) * resolution, softness)
    else:
        steps = spread(elevation, near, settings.critical_step, softness)
    step = step_height(elevation, steps, window, settings.critical_count, softness)
    step = jnp.where(jnp.isnan(fit.slope), jnp.nan, step)
    return BodyFeatures(fit.slope, fit.roughness, step, seen=fit.count / len(window))
