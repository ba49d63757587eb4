"""The crawl: order of the legs, support and overlap triangles, in-centre, stability margin. Paper A, II.A and IV.C.

Points are horizontal (x, y) in W [m].
"""

from typing import Literal

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import RING
from jaxleg.numerics import norm_safe
from jaxleg.pytree import pytree, static

CogPoint = Literal["overlap", "median"]


def crossing(a: Float[Array, "2"], b: Float[Array, "2"], c: Float[Array, "2"], d: Float[Array, "2"]) -> Float[Array, "2"]:
    """Point where the line a-b meets the line c-d; not finite when they are parallel."""
    along, other, between = b - a, d - c, c - a
    share = _cross2(between, other) / _cross2(along, other)
    return a + share * along


def incentre(a: Float[Array, "2"], b: Float[Array, "2"], c: Float[Array, "2"]) -> Float[Array, "2"]:
    """Centre of the circle inscribed in a triangle; the mean of the corners when all three coincide."""
    sides = jnp.stack([norm_safe(b - c), norm_safe(c - a), norm_safe(a - b)]) + 1e-9
    return (sides[0] * a + sides[1] * b + sides[2] * c) / jnp.sum(sides)


def overlap_incentre(
    front: Float[Array, "2"], hind: Float[Array, "2"], swing_front: Float[Array, "2"], swing_hind: Float[Array, "2"]
) -> Float[Array, "2"]:
    """In-centre of the overlap of a side's two support triangles (paper A, IV.C; reading A12).

    `front`, `hind` stand; the other side's hind foot has swung to `swing_hind`, its front foot still is at `swing_front`.
    The overlap is the triangle of the standing feet and the crossing of the diagonals.
    """
    return incentre(front, hind, crossing(front, swing_hind, hind, swing_front))


def overlap_median(
    front: Float[Array, "2"],
    hind: Float[Array, "2"],
    swing_front: Float[Array, "2"],
    swing_hind: Float[Array, "2"],
    ratio: Float[ArrayLike, ""],
) -> Float[Array, "2"]:
    """Point on the median of the same overlap (arguments as in `overlap_incentre`). Paper C, equation (21).

    The median runs from the crossing of the diagonals (ratio 0) to the middle of the standing side (ratio 1): only that one
    is the same for both sides (reading; the text leaves the vertex open).
    """
    vertex = crossing(front, swing_hind, hind, swing_front)
    return vertex + ratio * (0.5 * (front + hind) - vertex)


@pytree
class CogRule:
    """Where the centre of gravity stands over the support triangles: the overlap's in-centre, or on its median."""

    ratio: Float[Array, "*batch"]  # place on the median: 0 the crossing of the diagonals, 1 the standing side
    rule: CogPoint = static("overlap")


def cog_point(
    cog: CogRule, before: Float[Array, "leg 3"], after: Float[Array, "leg 3"], leg: Int[Array, ""]
) -> Float[Array, "2"]:
    """Where the centre of gravity stands while `leg` swings from `before` to `after`. Paper A, IV.C (A12); C, (21).

    On the overlap of the two support triangles of its side's swings: the hind foot has reached its target in both, the front
    foot is still where it stood. So the point is the same for both swings of a side.
    """
    left, hind = leg % 2 == 0, leg >= 2
    front_leg, hind_leg = jnp.where(left, 0, 1), jnp.where(left, 2, 3)
    other_front, other_hind = jnp.where(left, 1, 0), jnp.where(left, 3, 2)
    landed = jnp.where(hind, after[hind_leg, :2], before[hind_leg, :2])
    corners = (before[other_front, :2], before[other_hind, :2], before[front_leg, :2], landed)
    return overlap_incentre(*corners) if cog.rule == "overlap" else overlap_median(*corners, cog.ratio)


def stability_margin(
    com: Float[Array, "2 *n"], feet: Float[Array, "leg 2 *n"], loaded: Bool[Array, "leg *n"]
) -> Float[Array, "*n"]:
    """Distance [m] of the centre of mass inside the hull of the loaded feet, negative outside: the least of `edge_margins`."""
    return jnp.min(edge_margins(com, feet, loaded), axis=0)


def edge_margins(
    com: Float[Array, "2 *n"], feet: Float[Array, "leg 2 *n"], loaded: Bool[Array, "leg *n"]
) -> Float[Array, "edge *n"]:
    """Distance [m] of the centre of mass to each edge of the hull of the loaded feet, negative outside; one edge for each foot
    round the body (`RING`), that begins at it: infinite where the foot is not loaded.

    The loaded feet keep their order round the body, so each edge joins a loaded foot to the next loaded one. Of two loaded
    feet the lesser distance is minus that to their line; of fewer all are -1. Many instants at once have axes of their own
    behind all others.
    """
    ring = np.array(RING)
    points, on = feet[ring], loaded[ring]
    passed, margins = jnp.zeros_like(on), []
    for step in (1, 2, 3):  # from each foot to the next, to the one after it, to the one before it
        ahead, there = jnp.roll(points, -step, axis=0), jnp.roll(on, -step, axis=0)
        edge, arm = ahead - points, com[None] - points
        inside = (edge[:, 1] * arm[:, 0] - edge[:, 0] * arm[:, 1]) / (norm_safe(edge, axis=1) + 1e-9)  # it runs clockwise
        margins.append(jnp.where(on & there & ~passed, inside, jnp.inf))
        passed = passed | there
    least = jnp.minimum(jnp.minimum(margins[0], margins[1]), margins[2])
    return jnp.where(jnp.sum(loaded, axis=0, keepdims=True) >= 2, least, -1.0)


def _cross2(a: Float[Array, "*n 2"], b: Float[Array, "*n 2"]) -> Float[Array, "*n"]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
