"""The search rectangle of paper A's foothold planner: its cells, their feasible score (8), (9) and the order of preference.

Candidates are cells of the map, as offsets from the nominal foothold; a cell belongs to the rectangle if its centre lies
within it, turned to the heading (reading A10). All of this depends on the rectangle alone: for a batch of terrains with one
rectangle it is worked out once.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.pytree import pytree
from jaxleg.rotations import to_heading


@pytree
class SearchRectangle:
    """The search rectangle and its score; lengths in metres, every field a leaf. Paper A, (8) and (9)."""

    length: Float[Array, "*batch"]  # L_Search, along the heading
    width: Float[Array, "*batch"]  # W_Search
    longer: Float[Array, "*batch"]  # added to the length in the second run of the cascade
    nominal_weight: Float[Array, "*batch"]  # w1 in [0, 1], of the Manhattan distance; w2 = 1 - w1
    heading: Float[Array, "*batch"]  # direction of travel in W [rad]


class Extent(NamedTuple):
    """How many cells are looked at either way of a nominal foothold; static."""

    cells: tuple[int, int]  # along x and y: covers the lengthened rectangle, as it is turned
    resort: int  # both ways, in the last resort: covers one step length


class Candidates(NamedTuple):
    """Cells round a nominal foothold, i along x and j along y of the map."""

    offset: Float[Array, "i j 2"]  # in W [m]
    along: Float[Array, "i j 2"]  # ahead and to the left of the heading [m]
    short: Bool[Array, "i j"]  # within the rectangle
    long: Bool[Array, "i j"]  # within the lengthened one


def extent_of(length: float, width: float, resort: float, resolution: float, heading: float | None = 0.0) -> Extent:
    """The extent for a lengthened rectangle and a step length (`resort`) [m], at a heading [rad] or (None) at any."""
    size = np.full(2, np.hypot(length, width)) if heading is None else bounding_sides(length, width, heading)
    i, j = (int(n) for n in np.floor(0.5 * size / resolution + 1e-3))
    return Extent((i, j), int(np.floor(resort / resolution + 1e-3)))


def bounding_sides(length: float, width: float, heading: float) -> np.ndarray:
    """Sides along x and y [m] of the box round a rectangle [m] turned to a heading [rad]."""
    c, s = abs(np.cos(heading)), abs(np.sin(heading))
    return np.array([c * length + s * width, s * length + c * width])


def cells_around(extent: tuple[int, int]) -> np.ndarray:
    """Offsets in cells (i, j, 2) from -extent to extent."""
    return np.stack(np.meshgrid(*(np.arange(-n, n + 1) for n in extent), indexing="ij"), axis=-1)


def candidates(rectangle: SearchRectangle, resolution: Float[ArrayLike, ""], cells: tuple[int, int]) -> Candidates:
    """The cells round a nominal foothold, and which lie in the rectangle and in the lengthened one."""
    offset = jnp.asarray(cells_around(cells), rectangle.length.dtype) * resolution
    along = to_heading(offset, rectangle.heading)
    slack = 1e-3 * jnp.asarray(resolution)
    ahead, aside = jnp.abs(along[..., 0]), jnp.abs(along[..., 1]) <= 0.5 * rectangle.width + slack
    short = (ahead <= 0.5 * rectangle.length + slack) & aside
    return Candidates(offset, along, short, (ahead <= 0.5 * (rectangle.length + rectangle.longer) + slack) & aside)


def feasible_score(
    along: Float[Array, "*n 2"], rectangle: SearchRectangle, longer: Float[ArrayLike, ""] = 0.0
) -> Float[Array, "*n"]:
    """Score f in [0, 1] of offsets (ahead, left) [m] inside a rectangle lengthened by so much [m]. Paper A, (8) and (9).

    d1 is the Manhattan distance to the nominal foothold, d2 the distance to the long centre line; D1 = (L + W)/2, D2 = W/2.
    """
    ahead, aside = jnp.abs(along[..., 0]), jnp.abs(along[..., 1])
    first = (ahead + aside) / (0.5 * (rectangle.length + longer + rectangle.width))
    second = aside / (0.5 * rectangle.width)
    return 1.0 - rectangle.nominal_weight * first - (1.0 - rectangle.nominal_weight) * second


def preference(along: Float[Array, "*n 2"], value: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], ...]:
    """What candidates (ahead, left) [m] are compared by, the first that differs decides, the greater is preferred: their value,
    forward, to the centre line, left (A10).

    Values are compared on a grid of 1e-5 and lengths on one of 1e-6 m, so that a tie stays one whatever the rounding.
    """
    ahead, left = (jnp.round(along[..., k] * 1e6) for k in (0, 1))
    return jnp.round(value * 1e5), ahead, -jnp.abs(left), left


def nearness(along: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
    """A value that falls with the Euclidean distance to the nominal foothold, its square compared on a grid of 1e-7 m^2."""
    return -100.0 * jnp.sum(along**2, axis=-1)


def preferred(
    keys: tuple[Float[Array, "*n"], ...], allowed: Bool[Array, "*leg n"]
) -> tuple[Int[Array, "*leg"], Bool[Array, "*leg"]]:
    """Index of the candidate that `preference` prefers among the allowed ones, along the last axis, and whether there is one.

    Not by sorting: that costs twenty times as much as to look for the best.
    """
    left = allowed
    for key in keys:
        key = jax.lax.broadcast_to_rank(key, allowed.ndim)
        left = left & (key == jnp.max(jnp.where(left, key, -jnp.inf), axis=-1, keepdims=True))
    last = allowed.shape[-1] - 1
    place = jax.lax.broadcast_to_rank(jnp.arange(last + 1, dtype=jnp.int32), allowed.ndim)
    return jnp.min(jnp.where(left, place, last), axis=-1), jnp.any(allowed, axis=-1)


def rings(extent: int, block: int) -> np.ndarray:
    """Offsets in cells (i, j) up to `extent` either way, the nearest first, in blocks (block, cell, 2) of at most so many.

    Cells that are equally far stand in one block, which the last of its cells fills up.
    """
    cells = cells_around((extent, extent)).reshape(-1, 2)
    cells = cells[np.argsort(np.sum(cells**2, axis=1), kind="stable")]
    further = np.flatnonzero(np.diff(np.sum(cells**2, axis=1))) + 1
    rows: list[list[int]] = [[]]
    for ring in np.split(np.arange(len(cells)), further):
        if len(rows[-1]) + len(ring) > block:
            rows.append([])
        rows[-1].extend(ring)
    return np.stack([cells[np.pad(row, (0, block - len(row)), mode="edge")] for row in rows])
