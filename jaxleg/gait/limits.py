"""Nominal stance and gait constraints. Paper A, IV.A, equations (4)-(7).

`gait_constraints` gives the slack of each constraint; `gait_region` says of a point (L_Step, L_Search, L_Skew) at a height
H_COG whether it is allowed and what stops it first; `step_limit`, `search_limit` and `skew_limits` give the borders.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.numerics import Code, sqrt_safe
from jaxleg.robot import Robot


class Binding(Code):
    """The constraint with the least slack; the last three say that no gait is possible whatever the lengths."""

    SEARCH_BEHIND = 0  # (5) the foot may land behind where it stood
    STEP_REACH = 1  # (6) the hind leg stretches straight during the body shift
    SEARCH_REACH = 2  # (7) the flying leg stretches straight
    SKEW = 3  # a stance's left-right offset reaches its length
    TOO_LOW = 4  # H_COG <= L2: the knee may touch the ground
    TOO_HIGH = 5  # H_COG >= L_Leg: the ground is out of reach
    INVALID = 6  # an input is not finite, or L_Search is negative


class GaitRegion(NamedTuple):
    """Whether a gait keeps all constraints, the `Binding` one and its slack [m] (negative or 0: refused)."""

    feasible: Bool[Array, "*n"]
    binding: Int[Array, "*n"]
    slack: Float[Array, "*n"]


class Limit(NamedTuple):
    """A length [m] that must stay below `length`, and the `Binding` that says so; 0 where no length is possible."""

    length: Float[Array, "*n"]
    binding: Int[Array, "*n"]


class GaitConstraints(NamedTuple):
    """Slack [m] of paper A's constraints; negative = violated."""

    search_behind: Float[Array, ""]  # (5) 2 L_Step - L_Search: a foot never lands behind where it stood
    step_reach: Float[Array, ""]  # (6) sqrt(L_Leg^2 - H^2) - L_Step: the hind leg during the body shift
    search_reach: Float[Array, ""]  # (7) 2 sqrt(L_Leg^2 - H^2) - L_Step/2 - L_Search: the flying foot
    knee_clear: Float[Array, ""]  # H - L2: the knee stays off the ground


@jax.jit
def leg_length(robot: Robot) -> Float[Array, "*batch"]:
    """L_Leg [m]: thigh plus shank of the first leg, stretched straight."""
    return jnp.sum(jnp.sqrt(jnp.sum(robot.link_offset[..., 0, 1:, ::2] ** 2, axis=-1)), axis=-1)


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
        knee_clear=hip_height + robot.link_offset[..., 0, 1, 2],
    )


def half_step_skew(step: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """L_Skew that makes a cycle's two stances mirror images. Paper A, equation (4)."""
    return 0.5 * jnp.asarray(step)


def skew_limits(
    step: Float[ArrayLike, "*a"], stance_length: Float[ArrayLike, "*b"]
) -> tuple[Float[Array, "*c"], Float[Array, "*c"]]:
    """Least and greatest free L_Skew [m], both excluded: L_Step - L_Stance and L_Stance; (4) lies midway.

    The left-right offsets of a cycle's two stances, L_Skew and L_Skew - L_Step, must be smaller than the stance is long:
    otherwise a front foot stands no further ahead than the other side's hind foot. None is left where L_Step >= 2 L_Stance.
    """
    step, stance_length = jnp.broadcast_arrays(jnp.asarray(step), jnp.asarray(stance_length))
    return step - stance_length, stance_length


@jax.jit
def gait_region(
    robot: Robot,
    hip_height: Float[ArrayLike, "*a"],
    step: Float[ArrayLike, "*b"],
    search_length: Float[ArrayLike, "*c"],
    skew: Float[ArrayLike, "*d"] | None = None,
    stance_length: Float[ArrayLike, "*e"] = jnp.inf,
) -> GaitRegion:
    """Feasible region of (L_Step, L_Search, L_Skew) [m] at H_COG [m]: paper A, (5)-(7), and H_COG > L2. Inputs broadcast.

    `skew` is a free one, within `skew_limits`; None is (4), half a step. `stance_length` is L_Stance (unbounded without it).
    The binding constraint is the one of (5), (6), (7) and the skew with the least slack, unless the height or an input rules
    out any gait. A slack of exactly 0 is refused: the paper's signs are strict.
    """
    lengths = (hip_height, step, search_length, half_step_skew(step) if skew is None else skew, stance_length)
    lengths = jnp.broadcast_arrays(*(jnp.asarray(x, robot.link_offset.dtype) for x in lengths))
    return GaitRegion(*jnp.vectorize(functools.partial(_region_at, robot))(*lengths))


def _region_at(robot, height, step, search, skew, stance):
    slack = gait_constraints(robot, height, step, search)
    offset = stance - jnp.maximum(jnp.abs(skew), jnp.abs(skew - step))
    lengths = jnp.stack([slack.search_behind, slack.step_reach, slack.search_reach, offset])
    stretch = leg_length(robot) - height
    valid = jnp.isfinite(height + step + search + skew) & (search >= 0.0) & (stance > 0.0)
    hopeless = [~valid, slack.knee_clear <= 0.0, stretch <= 0.0]
    binding = jnp.select(hopeless, [Binding.INVALID, Binding.TOO_LOW, Binding.TOO_HIGH], jnp.argmin(lengths))
    least = jnp.select(hopeless, [jnp.full_like(height, -jnp.inf), slack.knee_clear, stretch], jnp.min(lengths))
    return least > 0.0, binding.astype(jnp.int32), least


@jax.jit
def search_limit(robot: Robot, hip_height: Float[ArrayLike, "*a"], step: Float[ArrayLike, "*b"]) -> Limit:
    """Greatest L_Search [m] at H_COG and L_Step [m], and whether (5) or (7) sets it; 0 and why where the step is refused."""
    hip_height, step = jnp.broadcast_arrays(jnp.asarray(hip_height), jnp.asarray(step))
    alone = gait_region(robot, hip_height, step, 0.0)
    half = sqrt_safe(leg_length(robot) ** 2 - hip_height**2)
    behind, reach = 2.0 * step, 2.0 * half - 0.5 * step
    binding = jnp.where(behind <= reach, Binding.SEARCH_BEHIND, Binding.SEARCH_REACH)
    length = jnp.where(alone.feasible, jnp.minimum(behind, reach), 0.0)
    return Limit(length, jnp.where(alone.feasible, binding, alone.binding).astype(jnp.int32))


@jax.jit
def step_limit(robot: Robot, hip_height: Float[ArrayLike, "*n"]) -> Limit:
    """Greatest L_Step [m] at H_COG [m], by (6); 0 and why where the height is refused."""
    half = sqrt_safe(leg_length(robot) ** 2 - jnp.asarray(hip_height) ** 2)
    possible = gait_region(robot, hip_height, 0.5 * half, 0.0)
    binding = jnp.where(possible.feasible, Binding.STEP_REACH, possible.binding)
    return Limit(jnp.where(possible.feasible, half, 0.0), binding.astype(jnp.int32))
