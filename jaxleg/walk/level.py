"""Can the robot stand as a gait asks? The stance of paper C's planner on level ground, before any map is looked at."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxleg.conventions import GRAVITY, LEG_END, LEG_SIDE
from jaxleg.leg.dynamics import Motion, all_leg_frames, torques_on_ground
from jaxleg.leg.kinematics import Reach, knee_bend, range_slack
from jaxleg.posture.body import joint_angles
from jaxleg.posture.plane import stand_pose
from jaxleg.robot import Robot
from jaxleg.walk.candidates import outwards
from jaxleg.walk.gaits import GaitPlan


class LevelStance(NamedTuple):
    """Standing on level ground at each candidate height, the default first."""

    height: Float[Array, "height"]  # of the hips over the feet's plane [m]
    reach: Bool[Array, "height"]  # whether all feet are within reach
    bend: Float[Array, "height"]  # least knee bend [rad]
    room: Float[Array, "height"]  # least distance of a joint to the end of its range [rad]; negative: beyond it
    torque: Float[Array, "height"]  # greatest holding torque over its limit


def level_stance(robot: Robot, plan: GaitPlan) -> LevelStance:
    """The gait's stance, all four feet loaded, at rest."""
    x, y = (jnp.asarray(side, plan.stance_length.dtype) for side in (LEG_END, LEG_SIDE))
    feet = jnp.stack([0.5 * x * plan.stance_length, 0.5 * y * plan.stance_width, jnp.zeros_like(x)], axis=1)

    def at(height: Float[Array, ""]) -> LevelStance:
        """The stance with the hips at one height [m]."""
        zero = jnp.zeros_like(height)
        angles, status = joint_angles(robot, stand_pose(robot, plan.pose, feet, jnp.stack([height, zero, zero]), zero), feet)
        up, still = jnp.stack([zero, zero, zero + 1.0]), jnp.zeros_like(angles)
        motion = Motion(still, still, jnp.zeros_like(up), jnp.zeros_like(up), GRAVITY * up)
        torque, _ = torques_on_ground(robot, all_leg_frames(robot, angles), motion, jnp.ones_like(x), up)
        return LevelStance(
            height=height,
            reach=jnp.all(status == Reach.OK),
            bend=jnp.min(jax.vmap(knee_bend)(robot.joint_axis, robot.link_offset, angles)),
            room=jnp.min(range_slack(robot.joint_range, angles)),
            torque=jnp.max(jnp.abs(torque) / robot.torque_limit),
        )

    adjust = plan.adjustments
    return jax.vmap(at)(adjust.height + adjust.height_step * jnp.asarray(outwards(plan.counts.heights), adjust.height.dtype))
