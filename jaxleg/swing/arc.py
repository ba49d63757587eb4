"""Pieces of a compound cycloid as paths, and where they first touch a terrain profile. Paper B, (2).

The search for a contact is certified: with a bound M on |g''| of the gap g between path and terrain, the gap stays above
g + g' h - M h^2 / 2, so a step h to that parabola's root never jumps over a contact. Near one it converges as Newton's method.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.swing.cycloid import cycloid_advance, cycloid_lift
from jaxleg.swing.profile import Profile, height, most_bent, slope, steepest

STEPS = 20_000  # of one search; a path that creeps along the terrain longer than this comes back as `lost`
QUADRATURE = 64  # intervals of the arc length, by Simpson's rule


class Arc(NamedTuple):
    """The piece of a compound cycloid between two shares of its period; it begins at `start`."""

    start: Float[Array, "*batch 2"]  # x, z
    stride: Float[Array, "*batch"]  # S of the whole cycloid
    rise: Float[Array, "*batch"]  # H
    begin: Float[Array, "*batch"]  # 0, or 1/2 for a second half
    end: Float[Array, "*batch"]


class Touch(NamedTuple):
    """Where a foot stopped along an arc."""

    share: Float[Array, ""]  # of the period
    point: Float[Array, "2"]
    hit: Bool[Array, ""]  # by contact; otherwise at the arc's end
    lost: Bool[Array, ""]  # the search was given up
    slope: Float[Array, ""]  # of the terrain there
    steps: Int[Array, ""]


def skin(dtype: jnp.dtype) -> float:
    """How far above the terrain a foot that has touched it sets off again; a tenth of it counts as contact."""
    return max(1e-9, 320.0 * float(jnp.finfo(dtype).eps))


def point_at(arc: Arc, share: Float[Array, "*n"]) -> Float[Array, "*n 2"]:
    """Point (x, z) of an arc at a share of the period between its begin and end."""
    x = arc.start[0] + arc.stride * (cycloid_advance(share) - cycloid_advance(arc.begin))
    z = arc.start[1] + arc.rise * (cycloid_lift(share) - cycloid_lift(arc.begin))
    return jnp.stack([x, z], axis=-1)


def length_to(arc: Arc, share: Float[Array, ""]) -> Float[Array, ""]:
    """Length of the arc's path from its begin to a share of the period."""
    at = arc.begin + (share - arc.begin) * jnp.linspace(0.0, 1.0, QUADRATURE + 1, dtype=arc.start.dtype)
    x_rate, z_rate = _rates(arc, at)
    squared = x_rate**2 + z_rate**2
    speed = jnp.where(squared > 0.0, jnp.sqrt(jnp.where(squared > 0.0, squared, 1.0)), 0.0)
    weight = jnp.array([1.0] + [4.0, 2.0] * (QUADRATURE // 2 - 1) + [4.0, 1.0], arc.start.dtype) / (3.0 * QUADRATURE)
    return (share - arc.begin) * jnp.sum(weight * speed)


def first_touch(arc: Arc, profile: Profile) -> Touch:
    """The first contact along an arc that begins above the terrain, or the arc's end. See the module for why none is missed."""
    bend = _bend_bound(arc, profile)
    near = 0.1 * skin(arc.start.dtype)

    def gap_and_rate(share):
        point = point_at(arc, share)
        x_rate, z_rate = _rates(arc, share)
        return point[1] - height(profile, point[0]), z_rate - slope(profile, point[0]) * x_rate

    def going(state):
        share, hit, steps = state
        return ~hit & (share < arc.end) & (steps < STEPS)

    def advance(state):
        share, _, steps = state
        gap, rate = gap_and_rate(share)
        ahead = (rate + jnp.sqrt(rate**2 + 2.0 * bend * jnp.maximum(gap, 0.0))) / bend
        hit = gap <= near
        return jnp.where(hit, share, jnp.minimum(share + ahead, arc.end)), hit, steps + 1

    zero = jnp.zeros((), jnp.int32)
    share, hit, steps = jax.lax.while_loop(going, advance, (arc.begin, jnp.array(False), zero))
    hit = hit | ((share >= arc.end) & (gap_and_rate(share)[0] <= 20.0 * near))  # a level swing ends where it began
    point = point_at(arc, share)
    return Touch(share, point, hit, ~hit & (share < arc.end), slope(profile, point[0]), steps)


def _rates(arc: Arc, share):
    """dx and dz by the share of the period."""
    turn = 2.0 * jnp.pi * share
    return arc.stride * (1.0 - jnp.cos(turn)), arc.rise * jnp.pi * jnp.sin(turn)


def _bend_bound(arc: Arc, profile: Profile):
    """Bound on |g''| over the whole period: z'' - T'' x'^2 - T' x''."""
    stride, rise = jnp.abs(arc.stride), jnp.abs(arc.rise)
    along = 2.0 * stride
    bound = 2.0 * jnp.pi**2 * rise + most_bent(profile) * along**2 + 2.0 * jnp.pi * stride * steepest(profile)
    return jnp.maximum(bound, 1e-6)
