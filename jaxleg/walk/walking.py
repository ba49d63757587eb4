"""From a series of states to timed phases: each step is a shift of the trunk and a swing. Paper C, 3.2; B, (2).

The walk ends with a shift that takes the trunk over the middle of the feet. Phases beyond it keep everything where it is.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import GRAVITY
from jaxleg.gait.order import SHIFT, STEP_LEGS
from jaxleg.gait.support import stability_margin
from jaxleg.numerics import norm_safe
from jaxleg.posture.collision import Obstacles
from jaxleg.posture.plane import shift_time, stand_pose
from jaxleg.robot import Robot
from jaxleg.walk.data import Phases
from jaxleg.walk.gaits import GaitPlan, State, swing_apex


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Timing:
    """How fast trunk and feet move; every field a leaf."""

    acceleration: Float[Array, "*batch"]  # most of the trunk in a shift [m/s^2]
    least_shift: Float[Array, "*batch"]  # [s]
    reserve: Float[Array, "*batch"]  # of the zero moment point to the edge of the feet's hull in a shift [m]
    foot_speed: Float[Array, "*batch"]  # most of a swinging foot [m/s]
    least_swing: Float[Array, "*batch"]  # [s]
    load_share: Float[Array, "*batch"]  # part of a swing at either end in which the load is transferred


def phase_legs(steps: int) -> tuple[int, ...]:
    """The swinging leg (or `SHIFT`) of each of the 2 (steps + 1) phases of `walk_phases`."""
    return tuple(leg for k in range(steps + 1) for leg in (SHIFT, STEP_LEGS[k % 4]))


def walk_phases(
    robot: Robot, plan: GaitPlan, timing: Timing, ground: Obstacles, states: State, count: Int[Array, ""]
) -> tuple[Phases, Bool[Array, "phase"]]:
    """Phases of the first `count` steps of a series (`states` has a leading axis: before each step, and at its end), and
    which of them take part."""
    steps = states.feet.shape[0] - 1
    step = jnp.arange(steps + 1, dtype=count.dtype)
    walked = step < count
    feet = jax.tree.map(lambda x: x[jnp.minimum(step, count)], states.feet)
    after = jnp.where(walked[:, None, None], states.feet[jnp.minimum(step + 1, steps)], feet)
    level = jnp.stack([plan.adjustments.height, *jnp.zeros(2, feet.dtype)])
    end = stand_pose(robot, plan.pose, states.feet[count], level, states.pose[count, 5])
    pose = jnp.where((step <= count)[:, None], states.pose[jnp.minimum(step, count)], end)
    target = jnp.where(walked[:, None], states.pose[jnp.minimum(step + 1, steps)], end)
    leg = jnp.array(STEP_LEGS)[step % 4]
    start, stop = feet[step, leg], after[step, leg]
    apex = jnp.where(walked, jax.vmap(swing_apex, in_axes=(None, None, 0, 0))(plan, ground, start, stop), 0.0)
    swings = jnp.where(walked[:, None], jax.nn.one_hot(leg, 4, dtype=feet.dtype), 0.0)
    duration = _pairs(_shift_time(timing, pose, target, feet), _swing_time(timing, start, stop, apex))
    phases = Phases(
        start=jnp.cumsum(duration) - duration,
        duration=duration,
        trunk_from=_pairs(pose, target),
        trunk_to=_pairs(target, target),
        feet_from=_pairs(feet, feet),
        feet_to=_pairs(feet, after),
        apex=_pairs(jnp.zeros_like(swings), apex[:, None] * swings),
        swings=_pairs(jnp.zeros_like(swings), swings),
    )
    return phases, _pairs(step <= count, walked)


def _shift_time(timing: Timing, start, end, feet):
    """`shift_time` [s] at the allowed acceleration, or less: the zero moment point, h a / g from under the centre, shall stay
    inside the hull of the feet by the reserve."""
    inside = jax.vmap(stability_margin, in_axes=(0, 0, None))
    everyone = jnp.ones(4, bool)
    margin = jnp.minimum(*(inside(pose[:, :2], feet[..., :2], everyone) for pose in (start, end)))
    height = jnp.maximum(end[:, 2] - jnp.mean(feet[..., 2], axis=1), 0.1)
    steady = GRAVITY / height * (margin - timing.reserve)
    acceleration = jnp.clip(steady, 0.15 * timing.acceleration, timing.acceleration)
    return jnp.maximum(jax.vmap(shift_time)(start, end, acceleration), timing.least_shift)


def _swing_time(timing: Timing, start, end, apex):
    """Long enough for the foot's peak speed; a cycloid's is twice its mean, up, along and down are added up [s]."""
    top = jnp.maximum(start[:, 2], end[:, 2]) + apex
    way = norm_safe((end - start)[:, :2]) + 2.0 * top - start[:, 2] - end[:, 2]
    moving = 2.0 * way / timing.foot_speed
    return jnp.maximum(moving, timing.least_swing) / (1.0 - 2.0 * timing.load_share)


def _pairs(shift, swing):
    """Interleave the shifts' and the swings' rows."""
    return jnp.stack([shift, swing], axis=1).reshape(-1, *shift.shape[1:])
