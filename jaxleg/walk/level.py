"""Can the robot stand as a gait asks? The stance of paper C's planner on level ground, before any map is looked at."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxleg.conventions import LEG_END, LEG_SIDE
from jaxleg.leg.kinematics import Reach, knee_bend, range_slack
from jaxleg.planner import Planner
from jaxleg.posture.body import joint_angles
from jaxleg.robot import Robot
from jaxleg.series.candidates import outwards
from jaxleg.walk.feasible import held_still


class LevelStance(NamedTuple):
    """Standing on level ground at each candidate height, the default first."""

    height: Float[Array, "height"]  # of the hips over the feet's plane [m]
    reach: Bool[Array, "height"]  # whether all feet are within reach
    bend: Float[Array, "height"]  # least knee bend [rad]
    room: Float[Array, "height"]  # least distance of a joint to the end of its range [rad]; negative: beyond it
    torque: Float[Array, "height"]  # greatest holding torque over its limit


def level_stance(robot: Robot, planner: Planner) -> LevelStance:
    """The gait's stance, all four feet loaded, at rest."""
    gait = planner.gait
    x, y = (jnp.asarray(side, gait.stance_length.dtype) for side in (LEG_END, LEG_SIDE))
    feet = jnp.stack([0.5 * x * gait.stance_length, 0.5 * y * gait.stance_width, jnp.zeros_like(x)], axis=1)
    zero = jnp.zeros((), feet.dtype)

    def at(above: Float[Array, ""]) -> LevelStance:
        """The stance with the hips so far above their default height [m]."""
        pose = planner.posture.stand(robot, gait, feet, zero).at[2].add(above)
        angles, status = joint_angles(robot, pose, feet)
        torque, _ = held_still(robot, feet, pose, jnp.ones_like(x))
        return LevelStance(
            height=above + gait.workspace.high,
            reach=jnp.all(status == Reach.OK),
            bend=jnp.min(jax.vmap(knee_bend)(robot.joint_axis, robot.link_offset, angles)),
            room=jnp.min(range_slack(robot.joint_range, angles)),
            torque=jnp.max(jnp.abs(torque) / robot.torque_limit),
        )

    adjust = planner.tree.adjustments.height
    return jax.vmap(at)(adjust * jnp.asarray(outwards(planner.tree.counts.heights), adjust.dtype))
