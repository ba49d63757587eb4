"""The search rectangle of paper A's foothold planner: its cells, their feasible score (8), (9) and the order of preference.

Candidates are cells of the map, as offsets from the nominal foothold; a cell belongs to the rectangle if its centre lies
within it, turned to the heading (reading A10). All of this depends on the rectangle alone: for a batch of terrains with one
rectangle it is worked out once.
"""

from typing import NamedTuple

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


class Order(NamedTuple):
    """An order of preference over n candidates; those that take no part rank n."""

    rank: Int[Array, "i j"]
    candidate: Int[Array, "n"]  # flat index of the candidate of each rank


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


def best_first(value: Float[Array, "i j"], seen: Candidates, allowed: Bool[Array, "i j"]) -> Order:
    """Order by falling value; ties go forward, then to the centre line, then left (A10).

    Values are compared on a grid of 1e-5 and lengths on one of 1e-6 m, so that a tie stays one whatever the rounding.
    """
    ahead, left = (jnp.round(seen.along[..., k] * 1e6).reshape(-1) for k in (0, 1))
    worth = jnp.round(value * 1e5).reshape(-1)
    order = jnp.lexsort((-left, jnp.abs(left), -ahead, -worth, ~allowed.reshape(-1))).astype(jnp.int32)
    rank = jnp.zeros_like(order).at[order].set(jnp.arange(order.size, dtype=jnp.int32))
    return Order(jnp.where(allowed, rank.reshape(allowed.shape), order.size), order)


def nearest_first(seen: Candidates, allowed: Bool[Array, "i j"]) -> Order:
    """Order by Euclidean distance to the nominal foothold, squared distances compared on a grid of 1e-7 m^2."""
    return best_first(-100.0 * jnp.sum(seen.along**2, axis=-1), seen, allowed)
