"""Nominal stance and gait constraints. Paper A, IV.A, equations (4)-(7)."""

from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.conventions import LEG_END, LEG_SIDE
from jaxleg.numerics import sqrt_safe
from jaxleg.plan import GaitParams
from jaxleg.robot import Robot


class GaitConstraints(NamedTuple):
    """Slack [m] of paper A's constraints; negative = violated."""

    search_behind: Float[Array, ""]  # (5) 2 L_Step - L_Search: a foot never lands behind where it stood
    step_reach: Float[Array, ""]  # (6) sqrt(L_Leg^2 - H^2) - L_Step: the hind leg during the body shift
    search_reach: Float[Array, ""]  # (7) 2 sqrt(L_Leg^2 - H^2) - L_Step/2 - L_Search: the flying foot
    knee_clear: Float[Array, ""]  # H - L2: the knee stays off the ground


def leg_length(robot: Robot) -> Float[Array, ""]:
    """L_Leg [m]: thigh plus shank of the first leg, stretched straight."""
    return jnp.sum(jnp.sqrt(jnp.sum(robot.link_offset[0, 1:, ::2] ** 2, axis=-1)))


def gait_constraints(
    robot: Robot, hip_height: Float[ArrayLike, ""], step: Float[ArrayLike, ""], search_length: Float[ArrayLike, ""]
) -> GaitConstraints:
    """Paper A, equations (5), (6), (7) and H_COG > L2, as slacks [m]."""
    hip_height, step, search_length = (jnp.asarray(x) for x in (hip_height, step, search_length))
    half = sqrt_safe(leg_length(robot) ** 2 - hip_height**2)
    return GaitConstraints(
        search_behind=2.0 * step - search_length,
        step_reach=half - step,
        search_reach=2.0 * half - 0.5 * step - search_length,
        knee_clear=hip_height + robot.link_offset[0, 1, 2],
    )


def half_step_skew(step: Float[ArrayLike, ""]) -> Float[Array, ""]:
    """L_Skew that makes a cycle's two stances mirror images. Paper A, equation (4)."""
    return 0.5 * jnp.asarray(step)


def nominal_stances(params: GaitParams, first: int, count: int) -> Float[Array, "stance leg 2"]:
    """Nominal footholds (x, y) [m] of stances first, first+1, ... before the right legs swing; stance 0 is round x = 0.

    Paper A, Fig. 6a: a parallelogram of L_Stance x W_Stance, left feet ahead of right ones by L_Skew, moving on by L_Step a
    cycle. Before the left legs swing the offset is L_Skew - L_Step.
    """
    end, side = jnp.asarray(LEG_END), jnp.asarray(LEG_SIDE)
    x = 0.5 * (end * params.stance_length + side * params.skew)
    y = 0.5 * side * params.stance_width
    advance = (first + jnp.arange(count))[:, None] * params.step_length
    return jnp.stack([x + advance, jnp.broadcast_to(y, advance.shape[:1] + y.shape)], axis=-1).astype(params.step_length.dtype)
