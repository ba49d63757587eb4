"""How a foot flies in a planned swing: the contract of its law, and where the foot is on its way.

A law is a pytree (`clearance.Cycloid`, `taut.Taut`) with `load_share`, the part of a swing at either end in which the load is
transferred, and `flight(robot, gait, ground, start, end)`, the numbers of one flight between two places. `fly` turns them into
the foot's place: twice differentiable in time and in every number.
"""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.gait.phases import Flight
from jaxleg.numerics import norm_safe, smooth_ramp, smoothstep
from jaxleg.swing.cycloid import swing_foot


def fly(
    start: Float[Array, "3 *n"], end: Float[Array, "3 *n"], flight: Flight, share: Float[ArrayLike, "*n"]
) -> Float[Array, "3 *n"]:
    """Foot [m] at a share of its flight in W: along a route at minimum jerk, or a compound cycloid (`swing_foot`).

    Of one flight, or of many in a last axis.
    """
    if not flight.corner.shape[0]:
        return swing_foot(start, end, flight.apex, share, flight.lift)
    way = end[:2] - start[:2]
    length = norm_safe(way, axis=0)
    corner = flight.corner.at[0, 1].set(start[2]) * jnp.stack([length, jnp.ones_like(length)])[None]
    point = along(corner, flight.rounding, smoothstep(share))
    heading = way / jnp.maximum(length, 1e-6)[None]
    return jnp.concatenate([start[:2] + heading * point[:1], point[1:]])


def along(corner: Float[Array, "corner 2 *n"], rounding: Float[Array, "*n"], share: Float[Array, "*n"]) -> Float[Array, "2 *n"]:
    """Point at a share of the length of a polyline, each corner rounded by a curve of continuous curvature.

    Within `rounding` of a corner, or as far as the nearer end is, the path leaves the polyline to the inner side: by at most
    0.16 of that length times the change of direction (a vector of length 1.4 for a right angle).
    """
    way = jnp.diff(corner, axis=0)
    length = norm_safe(way, axis=1)
    direction = way / jnp.maximum(length, 1e-9)[:, None]
    at = jnp.cumsum(length, axis=0)
    here, turn = (share * at[-1])[None], jnp.diff(direction, axis=0)
    width = jnp.maximum(jnp.minimum(rounding[None], jnp.minimum(at[:-1], at[-1:] - at[:-1])), 1e-6)
    return corner[0] + direction[0] * here + jnp.sum(turn * smooth_ramp(here - at[:-1], width)[:, None], axis=0)
