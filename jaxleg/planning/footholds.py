"""Foothold choice: feasible score (8), (9) and the cascaded rectangle search of paper A, IV.B.

The four feet of a cycle move from their nominal footholds by one common offset, so that they still form the nominal
stance (Fig. 7). Offsets lie on a lattice of the map's cells round the nominal foothold, in the frame turned to the heading.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.plan import FootholdStatus
from jaxleg.terrain.heightmap import HeightMap


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SearchRectangle:
    """The search rectangle and its score; lengths in metres, every field a leaf. Paper A, (8) and (9)."""

    length: Float[Array, "*batch"]  # L_Search, along the heading
    width: Float[Array, "*batch"]  # W_Search
    longer: Float[Array, "*batch"]  # added to the length in the second run of the cascade
    nominal_weight: Float[Array, "*batch"]  # w1 in [0, 1], of the Manhattan distance; w2 = 1 - w1
    heading: Float[Array, "*batch"]  # direction of travel in W [rad]


class Footholds(NamedTuple):
    """Chosen offsets from the nominal footholds (x, y in W) [m] and a `FootholdStatus` a leg."""

    offset: Float[Array, "leg 2"]
    status: Int[Array, "leg"]


def lattice(cells_ahead: int, cells_aside: int) -> np.ndarray:
    """Candidate offsets in cells (ahead, left), the preferred one of a tie first: forward, nearest the centre line, left."""
    ahead, left = np.arange(-cells_ahead, cells_ahead + 1), np.arange(-cells_aside, cells_aside + 1)
    cells = np.stack(np.meshgrid(ahead, left, indexing="ij"), axis=-1).reshape(-1, 2)
    return cells[np.lexsort((-cells[:, 1], np.abs(cells[:, 1]), -cells[:, 0]))]


def feasible_score(offset: Float[Array, "2"], rectangle: SearchRectangle, length: Float[ArrayLike, ""]) -> Float[Array, ""]:
    """Score f in [0, 1] of an offset (ahead, left) [m] inside a rectangle of this length. Paper A, (8) and (9).

    d1 is the Manhattan distance to the nominal foothold, d2 the distance to the long centre line; D1 = (L + W)/2, D2 = W/2.
    """
    ahead, aside = jnp.abs(offset[0]), jnp.abs(offset[1])
    first = (ahead + aside) / (0.5 * (length + rectangle.width))
    second = aside / (0.5 * rectangle.width)
    return 1.0 - rectangle.nominal_weight * first - (1.0 - rectangle.nominal_weight) * second


def choose(
    nominal: Float[Array, "leg 2"],
    valid: Bool[Array, "nx ny"],
    terrain: HeightMap,
    rectangle: SearchRectangle,
    cells: tuple[int, int],
) -> Footholds:
    """The cascade in its exact form: common offset, then the same in the lengthened rectangle, then per leg the nearest.

    `nominal` (x, y) in W [m]; `valid` from `terrain.validity`; `cells` are the static half extents of the lattice, which
    must cover the lengthened rectangle. Piecewise constant: it has no gradient, see `soft_offset`.
    """
    offsets, in_short, in_long = _candidates(terrain, rectangle, cells)
    usable = _usable(nominal, valid, terrain, rectangle, offsets)
    common = jnp.all(usable, axis=0)
    scores = [_scores(offsets, rectangle, extra) for extra in (0.0, rectangle.longer)]
    found_short, found_long = jnp.any(common & in_short), jnp.any(common & in_long)
    short = _best(scores[0], common & in_short)
    long = _best(scores[1], common & in_long)
    nearest, found_each = _nearest(offsets, usable, in_long)
    index = jnp.where(found_short, short, jnp.where(found_long, long, nearest))
    missing = jnp.where(found_each, FootholdStatus.NEAREST, FootholdStatus.NONE)
    status = jnp.where(found_short, FootholdStatus.NOMINAL, jnp.where(found_long, FootholdStatus.WIDENED, missing))
    return Footholds(_turn(offsets, rectangle.heading)[index], status.astype(jnp.int32))


def soft_offset(
    nominal: Float[Array, "leg 2"],
    valid: Bool[Array, "nx ny"],
    terrain: HeightMap,
    rectangle: SearchRectangle,
    cells: tuple[int, int],
    temperature: Float[ArrayLike, ""],
) -> Float[Array, "2"]:
    """Soft form of the first run of the cascade: the softmax mean of the common offsets, for gradients.

    Tends to `choose`'s offset as the temperature tends to 0 (where that run finds one and has no tie); differentiable in the
    rectangle's parameters. With no common candidate it is zero.
    """
    offsets, inside, _ = _candidates(terrain, rectangle, cells)
    common = jnp.all(_usable(nominal, valid, terrain, rectangle, offsets), axis=0) & inside
    logits = jnp.where(common, _scores(offsets, rectangle, 0.0) / temperature, -jnp.inf)
    weight = jax.nn.softmax(jnp.where(jnp.any(common), logits, 0.0))
    mean = jnp.sum(weight[:, None] * _turn(offsets, rectangle.heading), axis=0)
    return jnp.where(jnp.any(common), mean, 0.0)


def _candidates(terrain, rectangle, cells):
    """Offsets (ahead, left) [m], and which lie in the rectangle and in the lengthened one (a cell's centre counts)."""
    offsets = jnp.asarray(lattice(*cells), terrain.elevation.dtype) * terrain.resolution
    slack = 1e-3 * terrain.resolution
    ahead, aside = jnp.abs(offsets[:, 0]), jnp.abs(offsets[:, 1]) <= 0.5 * rectangle.width + slack
    short = (ahead <= 0.5 * rectangle.length + slack) & aside
    return offsets, short, (ahead <= 0.5 * (rectangle.length + rectangle.longer) + slack) & aside


def _turn(offsets, heading):
    c, s = jnp.cos(heading), jnp.sin(heading)
    ahead, left = offsets[..., 0], offsets[..., 1]
    return jnp.stack([c * ahead - s * left, s * ahead + c * left], axis=-1)


def _usable(nominal, valid, terrain, rectangle, offsets):
    """Whether each candidate of each leg falls on a valid cell of the map (leg, candidate)."""
    points = nominal[:, None] + _turn(offsets, rectangle.heading)
    index = jnp.round((points - terrain.origin) / terrain.resolution).astype(jnp.int32)
    size = jnp.array(valid.shape, jnp.int32)
    inside = jnp.all((index >= 0) & (index < size), axis=-1)
    index = jnp.clip(index, 0, size - 1)
    return valid[index[..., 0], index[..., 1]] & inside


def _scores(offsets, rectangle, extra):
    return jax.vmap(feasible_score, in_axes=(0, None, None))(offsets, rectangle, rectangle.length + extra)


def _best(score, allowed):
    """First of the best: the lattice stands in the order of preference. Scores are compared on a grid of 1e-5, so that
    a tie stays one whatever the rounding of the sum."""
    return jnp.argmax(jnp.where(allowed, jnp.round(score * 1e5), -jnp.inf))


def _nearest(offsets, usable, in_long):
    distance = jnp.round(jnp.sum(offsets**2, axis=-1) * 1e7)
    allowed = usable & in_long
    return jnp.argmin(jnp.where(allowed, distance, jnp.inf), axis=-1), jnp.any(allowed, axis=-1)
