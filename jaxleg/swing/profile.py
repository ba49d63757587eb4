"""A terrain profile in the vertical plane of a step: a piecewise cubic on equally spaced knots. Paper B, III.A and IV.A."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float


class Profile(NamedTuple):
    """Terrain height T(x): in piece k, a + b u + c u^2 + d u^3 with u = (x - x_k) / spacing in [0, 1]; constant outside.

    Its slope must be continuous: the search for contacts is certified by bounds on its second derivative.
    """

    coefficients: Float[Array, "*batch piece 4"]
    start: Float[Array, "*batch"]  # x of the first knot
    spacing: Float[Array, "*batch"]


def natural_spline(
    heights: Float[Array, "knot"], start: Float[ArrayLike, ""] = 0.0, spacing: Float[ArrayLike, ""] = 1.0
) -> Profile:
    """The natural cubic spline through heights at equally spaced knots (B, IV.A: the terrain of its tables)."""
    n = heights.shape[0]
    inner = 4.0 * np.eye(n - 2) + np.eye(n - 2, k=1) + np.eye(n - 2, k=-1)
    bend = 6.0 * (heights[2:] - 2.0 * heights[1:-1] + heights[:-2])
    second = jnp.pad(jnp.asarray(np.linalg.inv(inner), heights.dtype) @ bend, 1)  # second differences, 0 at the ends
    low, high = second[:-1], second[1:]
    slope = heights[1:] - heights[:-1] - (2.0 * low + high) / 6.0
    coefficients = jnp.stack([heights[:-1], slope, 0.5 * low, (high - low) / 6.0], axis=-1)
    return Profile(coefficients, *(jnp.asarray(x, heights.dtype) for x in (start, spacing)))


def hermite(
    heights: Float[Array, "knot"], slopes: Float[Array, "knot"], start: Float[ArrayLike, ""], spacing: Float[ArrayLike, ""]
) -> Profile:
    """The profile with given heights and slopes dT/dx at equally spaced knots."""
    rise, before, after = jnp.diff(heights), slopes[:-1] * spacing, slopes[1:] * spacing
    coefficients = jnp.stack([heights[:-1], before, 3.0 * rise - 2.0 * before - after, before + after - 2.0 * rise], axis=-1)
    return Profile(coefficients, *(jnp.asarray(x, heights.dtype) for x in (start, spacing)))


def height(profile: Profile, x: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """Terrain height T(x)."""
    a, b, c, d, u = _piece(profile, jnp.asarray(x))
    return a + u * (b + u * (c + u * d))


def slope(profile: Profile, x: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """Terrain slope dT/dx; 0 outside the knots."""
    x = jnp.asarray(x)
    _, b, c, d, u = _piece(profile, x)
    inside = (x >= profile.start) & (x <= profile.start + profile.spacing * profile.coefficients.shape[0])
    return jnp.where(inside, (b + u * (2.0 * c + u * 3.0 * d)) / profile.spacing, 0.0)


def bounds_between(
    profile: Profile, start: Float[Array, "*n"], end: Float[Array, "*n"]
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Bounds on |dT/dx| and |d2T/dx2| between two places: those of the pieces there, or of all if there are more than two."""
    steep, bent = _steepest(profile), _most_bent(profile)
    first, last = _index(profile, start)[0], _index(profile, end)[0]
    near = jnp.abs(last - first) <= 1

    def greatest(values):
        return jnp.where(near, jnp.maximum(values[first], values[last]), jnp.max(values))

    return greatest(steep), greatest(bent)


def _steepest(profile: Profile):
    """Greatest |dT/dx| of each piece: at its knots or where its slope turns."""
    b, c, d = (profile.coefficients[None, :, k] for k in (1, 2, 3))
    turn = jnp.clip(-c / jnp.where(d == 0.0, 1.0, 3.0 * d), 0.0, 1.0)
    places = jnp.concatenate([jnp.zeros_like(turn), turn, jnp.ones_like(turn)])
    return jnp.max(jnp.abs(b + places * (2.0 * c + places * 3.0 * d)), axis=0) / profile.spacing


def _most_bent(profile: Profile):
    """Greatest |d2T/dx2| of each piece: it is linear there, so greatest at a knot."""
    c, d = profile.coefficients[:, 2], profile.coefficients[:, 3]
    return jnp.maximum(jnp.abs(2.0 * c), jnp.abs(2.0 * c + 6.0 * d)) / profile.spacing**2


def _index(profile, x):
    """Piece at x, and the place there in pieces from the start."""
    count = profile.coefficients.shape[0]
    place = jnp.clip((x - profile.start) / profile.spacing, 0.0, count)
    return jnp.minimum(place.astype(jnp.int32), count - 1), place


def _piece(profile: Profile, x):
    index, place = _index(profile, x)
    a, b, c, d = jnp.moveaxis(profile.coefficients[index], -1, 0)
    return a, b, c, d, place - index.astype(place.dtype)
