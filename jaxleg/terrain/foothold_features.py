"""Features of a foothold on each cell: curvature, slope, concavity and uphill angle, each at two radii. Paper C, (11).

Normal and curvature are those of the seen points inside a sphere about the foothold (principal component analysis). NaN where
there are none: the cell is unseen, or the sphere has fewer than three seen points or only points in a row seen from above, as
on a spike or a wall. The steepest slope that is still told from a wall is acos(cell / radius).
"""

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxleg.numerics import cross, dot, norm_safe
from jaxleg.settings import setting
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.principal import normal_and_variation
from jaxleg.terrain.window import disc, fold

AROUND = 8  # points about a foothold
BORDER = 1e-4  # [cells]: a point this far beyond the sphere is still inside; rounding decides nothing on level ground


@dataclasses.dataclass(frozen=True)
class FootholdSettings:
    """Radii of the sphere and of the circle of points; static. The defaults have 13 and 49 cells of 0.04 m on level ground."""

    radii: tuple[float, float] = setting((0.08, 0.16), above=0.0, max=2.0, unit="m", help="small and large")


class FootholdFeatures(NamedTuple):
    """Features of a foothold on each cell, at the small and the large radius."""

    curvature: Float[Array, "radius nx ny"]  # l0 / (l0 + l1 + l2) of the points' covariance, l0 the least: in [0, 1/3]
    slope: Float[Array, "radius nx ny"]  # between normal and vertical [rad]
    concavity: Float[Array, "radius nx ny"]  # mean angle between the normal and the ways to points around [rad]
    normal: Float[Array, "radius nx ny 3"]  # upward unit normal, in W
    seen: Bool[Array, "nx ny"]


def foothold_features(terrain: HeightMap, resolution: float, settings: FootholdSettings) -> FootholdFeatures:
    """Features of a foothold on each cell but the uphill angle, which `uphill` makes of the normal and a heading.

    Concavity is below pi/2 where the ground is hollow. `resolution` is the map's [m per cell], static: it sets the windows.
    """
    elevation = jnp.where(jnp.isfinite(terrain.elevation), terrain.elevation, jnp.nan)
    covariance, fits = _covariance(elevation, resolution, settings.radii)
    normal, curvature = jax.vmap(jax.vmap(jax.vmap(normal_and_variation)))(covariance)
    slope = jnp.arctan2(norm_safe(normal[..., :2]), normal[..., 2])
    concavity = jnp.stack([_concavity(elevation, resolution, radius, n) for radius, n in zip(settings.radii, normal)])
    known = [jnp.where(fits, value, jnp.nan) for value in (curvature, slope, concavity)]
    return FootholdFeatures(*known, normal=jnp.where(fits[..., None], normal, jnp.nan), seen=~jnp.isnan(elevation))


def uphill(normal: Float[Array, "*map 3"], heading: Float[ArrayLike, ""]) -> Float[Array, "*map"]:
    """Signed angle [rad] by which the ground rises along a heading [rad, from x to the left]; negative downhill.

    The rotation from the vertical to the normal, projected on the vertical plane of the heading. Paper C, 2.2.1 (iv).
    """
    return jnp.arctan2(-normal[..., 0] * jnp.cos(heading) - normal[..., 1] * jnp.sin(heading), normal[..., 2])


def _covariance(elevation, resolution: float, radii: tuple[float, ...]):
    """Covariance [cells^2] of the points in the spheres about each cell, and whether they make a plane; radii lead."""
    window = disc(max(radii), resolution)
    limit = (jnp.array(radii, elevation.dtype) / resolution + BORDER)[:, None, None] ** 2
    zeros = jnp.zeros((len(radii), *elevation.shape), elevation.dtype)

    def point(offset, heights):
        """Place relative to the foothold [cells], and 1 for a seen cell inside the sphere."""
        z = (heights - elevation)[None] / resolution  # the difference first: heights may be great
        inside = jnp.sum(offset**2) + z * z <= limit  # false for NaN
        return (*offset, jnp.where(inside, z, 0.0)), inside.astype(elevation.dtype)

    def first(total, offset, heights):
        place, one = point(offset, heights)
        return tuple(t + one * term for t, term in zip(total, (1.0, *place)))

    count, *sums = fold(elevation, window, first, (zeros,) * 4)
    count = jnp.maximum(count, 1.0)
    mean = [total / count for total in sums]

    def second(total, offset, heights):  # about the mean: squares cancel
        place, one = point(offset, heights)
        x, y, z = (one * (a - m) for a, m in zip(place, mean))
        return tuple(t + term for t, term in zip(total, (x * x, x * y, x * z, y * y, y * z, z * z)))

    xx, xy, xz, yy, yz, zz = fold(elevation, window, second, (zeros,) * 6)
    fits = (count >= 3) & (xx * yy - xy * xy > 1e-3)  # in cells: below that they lie in a row
    rows = (jnp.stack(row, axis=-1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return jnp.stack(list(rows), axis=-2), fits


def _concavity(elevation, resolution: float, radius: float, normal):
    """Mean angle [rad] between the normal and the ways to the seen ones of 8 points on the surface, on a circle."""
    turns = 2.0 * math.pi / AROUND * np.arange(AROUND)
    ways = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    rise = jnp.stack([_rise(elevation, *(way / resolution).tolist()) for way in ways], axis=-1)
    seen = ~jnp.isnan(rise)
    rise = jnp.where(seen, rise, 0.0)[..., None]
    ways = jnp.concatenate([jnp.broadcast_to(jnp.asarray(ways, rise.dtype), (*rise.shape[:-1], 2)), rise], axis=-1)
    normal = jnp.broadcast_to(normal[..., None, :], ways.shape)
    angle = jnp.arctan2(norm_safe(cross(normal, ways)), dot(normal, ways))  # not acos: it has no slope at its ends
    count = jnp.sum(seen, axis=-1, dtype=angle.dtype)
    return jnp.where(count > 0.0, jnp.sum(jnp.where(seen, angle, 0.0), axis=-1) / jnp.maximum(count, 1.0), jnp.nan)


def _rise(elevation, ahead: float, aside: float):
    """Height so many cells from each cell, over it; linear between the cells round the place, NaN if one is unseen."""
    i, j = (math.floor(round(x, 9)) for x in (ahead, aside))
    u, v = round(ahead - i, 9), round(aside - j, 9)
    reach = max(abs(i), abs(j)) + 1
    padded = jnp.pad(elevation, reach, constant_values=jnp.nan)
    corners = (((i, j), (1 - u) * (1 - v)), ((i + 1, j), u * (1 - v)), ((i, j + 1), (1 - u) * v), ((i + 1, j + 1), u * v))
    nx, ny = elevation.shape
    cut = ((w, padded[reach + a : reach + a + nx, reach + b : reach + b + ny]) for (a, b), w in corners if w > 0)
    return sum(w * (heights - elevation) for w, heights in cut)
