"""How long each phase of a walk takes: by a speed of travel (paper A), or by what trunk and feet may do (ours, for paper C).

A filling is a pytree with `durations(gait, load_share, moves, legs, used, way)`: the seconds of every phase, from what moves in
it, the leg that swings in it (or `SHIFT`; static), whether it is a phase of the walk, and the way of the whole walk [m].
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.conventions import GRAVITY
from jaxleg.gait.order import SHIFT
from jaxleg.gait.params import GaitParams
from jaxleg.gait.phases import Moves
from jaxleg.gait.support import stability_margin
from jaxleg.numerics import norm_safe, sqrt_safe
from jaxleg.pytree import pytree

PEAK = 5.7735  # greatest acceleration of a minimum-jerk move of length 1 in time 1


@pytree
class BySpeed:
    """All half cycles take the same time; a body shift, the hind and the front swing their shares of it. Paper A, II.A."""

    speed: Float[Array, "*batch"]  # mean speed over the walk [m/s]

    def durations(self, gait: GaitParams, load_share, moves: Moves, legs: tuple[int, ...], used, way) -> Float[Array, "phase"]:
        """The way at the speed, in equal half cycles."""
        del load_share, moves
        swings = sum(leg != SHIFT for leg in legs)
        shifts = round(2 * (len(legs) - swings) / swings)  # of a half cycle: two swings each
        swing = 1.0 - gait.shift_share
        share = {SHIFT: gait.shift_share / shifts, 0: swing * (1.0 - gait.hind_share), 1: swing * gait.hind_share}
        each = jnp.stack([share[leg if leg == SHIFT else int(leg >= 2)] for leg in legs])
        halves = jnp.maximum(jnp.sum(jnp.where(used, each, 0.0)), jnp.min(each))  # of no phase the way is 0
        return each * (way / halves / self.speed)


@pytree
class ByAcceleration:
    """Shifts as fast as the trunk may accelerate and balance allows, swings as fast as the foot may; paper C gives no times."""

    acceleration: Float[Array, "*batch"]  # most of the trunk in a shift [m/s^2]
    least_shift: Float[Array, "*batch"]  # [s]
    reserve: Float[Array, "*batch"]  # of the zero moment point to the edge of the feet's hull in a shift [m]
    foot_speed: Float[Array, "*batch"]  # most of a swinging foot [m/s]
    least_swing: Float[Array, "*batch"]  # [s]

    def durations(self, gait: GaitParams, load_share, moves: Moves, legs: tuple[int, ...], used, way) -> Float[Array, "phase"]:
        """Phase by phase."""
        del gait, used, way
        leg = np.array(legs)
        shift, swing = np.flatnonzero(leg == SHIFT), np.flatnonzero(leg != SHIFT)
        time = jnp.zeros(len(legs), moves.trunk_from.dtype)
        shifts, swings = (jax.tree.map(lambda x, at=at: x[at], moves) for at in (shift, swing))
        return time.at[shift].set(self._shift(shifts)).at[swing].set(self._swing(swings, leg[swing], load_share))

    def _shift(self, moves: Moves) -> Float[Array, "phase"]:
        """`shift_time` at the allowed acceleration, or less: the zero moment point, h a / g from under the centre, shall
        stay inside the hull of the feet by the reserve."""
        inside, all_four = jax.vmap(stability_margin, in_axes=(0, 0, None)), jnp.ones(4, bool)
        start, end, feet = moves.trunk_from, moves.trunk_to, moves.feet_from
        margin = jnp.minimum(*(inside(pose[:, :2], feet[..., :2], all_four) for pose in (start, end)))
        height = jnp.maximum(end[:, 2] - jnp.mean(feet[..., 2], axis=1), 0.1)
        steady = GRAVITY / height * (margin - self.reserve)
        acceleration = jnp.clip(steady, 0.15 * self.acceleration, self.acceleration)
        return jnp.maximum(jax.vmap(shift_time)(start, end, acceleration), self.least_shift)

    def _swing(self, moves: Moves, leg: np.ndarray, load_share) -> Float[Array, "phase"]:
        """Long enough for the foot's peak speed; a cycloid's is twice its mean, up, along and down are added up."""
        row = np.arange(len(leg))
        start, end = moves.feet_from[row, leg], moves.feet_to[row, leg]
        top = jnp.maximum(start[:, 2], end[:, 2]) + jnp.sum(moves.swings, axis=1) * moves.flight.apex
        way = norm_safe((end - start)[:, :2]) + 2.0 * top - start[:, 2] - end[:, 2]
        moving = 2.0 * way / self.foot_speed
        return jnp.maximum(moving, self.least_swing) / (1.0 - 2.0 * load_share)


def shift_time(start: Float[Array, "6"], end: Float[Array, "6"], acceleration: Float[Array, ""]) -> Float[Array, ""]:
    """Time [s] of a minimum-jerk shift in which neither the trunk's centre nor a point 0.4 m off accelerates more [m/s^2]."""
    way = norm_safe(end[:3] - start[:3]) + 0.4 * norm_safe(end[3:] - start[3:])
    return sqrt_safe(PEAK * way / acceleration)
