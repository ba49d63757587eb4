"""Features of a foothold on each cell: curvature, slope, concavity and uphill angle, each at two radii. Paper C, (11).

Normal and curvature are those of the seen points inside a sphere about the foothold (principal component analysis). A cell
without features (unseen, fewer than three seen points in the sphere, or all of them in a row seen from above) has NaN.
"""

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.numerics import cross, dot, norm_safe
from jaxleg.settings import setting
from jaxleg.terrain.features import disc
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.principal import normal_and_variation
from jaxleg.terrain.window import fold

AROUND = 8  # points about a foothold
BORDER = 1e-4  # [cells]: a point this far beyond the sphere is still inside; rounding decides nothing on level ground


@dataclasses.dataclass(frozen=True)
class FootholdSettings:
    """Radii of the sphere and of the circle of points; static. The defaults have 9 and 29 cells of 0.04 m on level ground."""

    radii: tuple[float, float] = setting((0.06, 0.12), above=0.0, max=2.0, unit="m", help="small and large")


class FootholdFeatures(NamedTuple):
    """Features of a foothold on each cell, at the small and the large radius."""

    curvature: Float[Array, "radius nx ny"]  # l0 / (l0 + l1 + l2) of the points' covariance, l0 the least: in [0, 1/3]
    slope: Float[Array, "radius nx ny"]  # between normal and vertical [rad]
    concavity: Float[Array, "radius nx ny"]  # mean angle between the normal and the ways to points around [rad]
    normal: Float[Array, "radius nx ny 3"]  # upward unit normal, in W


def foothold_features(terrain: HeightMap, resolution: float, settings: FootholdSettings) -> FootholdFeatures:
    """Features of a foothold on each cell but the uphill angle, which `uphill` makes of the normal and a heading.

    Concavity is below pi/2 where the ground is hollow. `resolution` is the map's [m per cell], static: it sets the windows.
    """
    heights = jnp.where(jnp.isfinite(terrain.elevation), terrain.elevation, jnp.nan) / resolution  # in cells, as radii are
    radii = [radius / resolution for radius in settings.radii]
    spheres = [_covariance(heights, radius, disc(radius, 1.0)) for radius in radii]
    covariance, fits = (jnp.stack(parts) for parts in zip(*spheres))
    normal, curvature = jax.vmap(jax.vmap(jax.vmap(normal_and_variation)))(covariance)
    slope = jnp.arctan2(norm_safe(normal[..., :2]), normal[..., 2])
    concavity = jnp.stack([_concavity(heights, radius, n) for radius, n in zip(radii, normal)])
    known = [jnp.where(fits, value, jnp.nan) for value in (curvature, slope, concavity)]
    return FootholdFeatures(*known, normal=jnp.where(fits[..., None], normal, jnp.nan))


def uphill(normal: Float[Array, "*map 3"], heading: Float[ArrayLike, ""]) -> Float[Array, "*map"]:
    """Signed angle [rad] by which the ground rises along a heading [rad, from x to the left]; negative downhill.

    The rotation from the vertical to the normal, projected on the vertical plane of the heading. Paper C, 2.2.1 (iv).
    """
    return jnp.arctan2(-normal[..., 0] * jnp.cos(heading) - normal[..., 1] * jnp.sin(heading), normal[..., 2])


def _covariance(heights, radius: float, window):
    """Covariance [cells^2] of the points in the sphere about each cell, and whether they make a plane; heights in cells."""
    zeros = jnp.zeros_like(heights)

    def point(offset, shifted):
        """Place relative to the foothold, and 1 for a seen cell inside the sphere."""
        z = shifted - heights
        inside = jnp.sum(offset**2) + z * z <= (radius + BORDER) ** 2  # false for NaN
        return (*offset, jnp.where(inside, z, 0.0)), inside.astype(heights.dtype)

    def first(total, offset, shifted):
        place, one = point(offset, shifted)
        return tuple(t + one * term for t, term in zip(total, (1.0, *place)))

    count, *sums = fold(heights, window, first, (zeros,) * 4)
    count = jnp.maximum(count, 1.0)
    mean = [total / count for total in sums]

    def second(total, offset, shifted):  # about the mean: squares cancel
        place, one = point(offset, shifted)
        x, y, z = (one * (a - m) for a, m in zip(place, mean))
        return tuple(t + term for t, term in zip(total, (x * x, x * y, x * z, y * y, y * z, z * z)))

    xx, xy, xz, yy, yz, zz = fold(heights, window, second, (zeros,) * 6)
    fits = (count >= 3) & (xx * yy - xy * xy > 1e-3)  # in cells: below that they lie in a row
    rows = (jnp.stack(row, axis=-1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return jnp.stack(list(rows), axis=-2), fits


def _concavity(heights, radius: float, normal):
    """Mean angle [rad] between the normal and the ways to the seen ones of 8 points on the surface, on a circle [cells]."""
    turns = 2.0 * math.pi / AROUND * np.arange(AROUND)
    ways = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    rise = jnp.stack([_sampled(heights, *way) for way in ways], axis=-1) - heights[..., None]
    seen = ~jnp.isnan(rise)
    rise = jnp.where(seen, rise, 0.0)[..., None]
    ways = jnp.concatenate([jnp.broadcast_to(jnp.asarray(ways, rise.dtype), (*rise.shape[:-1], 2)), rise], axis=-1)
    normal = normal[..., None, :]
    angle = jnp.arctan2(norm_safe(cross(normal, ways)), dot(normal, ways))  # not acos: it has no slope at its ends
    count = jnp.sum(seen, axis=-1)
    return jnp.where(count > 0, jnp.sum(jnp.where(seen, angle, 0.0), axis=-1) / jnp.maximum(count, 1), jnp.nan)


def _sampled(heights, ahead: float, aside: float):
    """Heights so far from each cell, linear between the cells round the place; NaN if one of them is unseen. In cells."""
    i, j = (math.floor(round(x, 9)) for x in (ahead, aside))
    u, v = round(ahead - i, 9), round(aside - j, 9)
    reach = max(abs(i), abs(j)) + 1
    padded = jnp.pad(heights, reach, constant_values=jnp.nan)
    corners = (((i, j), (1 - u) * (1 - v)), ((i + 1, j), u * (1 - v)), ((i, j + 1), (1 - u) * v), ((i + 1, j + 1), u * v))
    size = heights.shape
    cut = (w * padded[reach + a : reach + a + size[0], reach + b : reach + b + size[1]] for (a, b), w in corners if w > 0)
    return sum(cut)
