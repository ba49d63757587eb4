"""Whether a step can be made: the one check that every step of every planner passes. Paper C, 3.2; A, IV."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import GRAVITY
from jaxleg.gait.order import STEP_LEGS
from jaxleg.gait.support import stability_margin
from jaxleg.leg.dynamics import Motion, all_folds, torques_on_ground
from jaxleg.leg.energy import motor_power
from jaxleg.leg.kinematics import Reach, knee_bend, range_slack
from jaxleg.leg.moving import Moving
from jaxleg.planner import Limits, Planner
from jaxleg.posture.body import com_position, joint_angles
from jaxleg.posture.collision import leg_clearance, trunk_clearance
from jaxleg.posture.workspace import inside, room, stood
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_rows
from jaxleg.series.tree import CAUSES
from jaxleg.status import Status
from jaxleg.terrain.obstacles import Obstacles
from jaxleg.terrain.site import Site
from jaxleg.vectors import vector
from jaxleg.walk.data import Walk

SHIFT_SHARES = (0.2, 0.4, 0.6, 0.8)  # Table 2: five equal parts of the shift, the last of them the swing's start
BOX = ((0.0, 0.0), (0.0, 1.0), (0.5, 1.0), (1.0, 1.0), (1.0, 0.0))  # Table 1: (part of the way, part of the height)


class Standing(NamedTuple):
    """Where the feet stand, and the trunk pose in which the last one swung."""

    feet: Float[Array, "leg 3"]  # centres in W [m]
    pose: Float[Array, "6"]


class KeyPose(NamedTuple):
    """What one key pose shows."""

    reach: Bool[Array, ""]
    margin: Float[Array, ""]
    legs: Float[Array, "leg"]  # clearance [m]
    trunk: Float[Array, ""]


def key_pose(robot: Robot, limits: Limits, ground: Obstacles, pose, feet, loaded) -> KeyPose:
    """Reach, balance and clearance in a pose, its `loaded` feet on the ground."""
    angles, status = joint_angles(robot, pose, feet)
    bend = jax.vmap(knee_bend)(robot.joint_axis, robot.link_offset, angles)
    bent = (bend >= limits.knee_bend) & (status == Reach.OK)
    within = (range_slack(robot.joint_range, angles) >= 0.0) & bent[:, None]
    com = com_position(robot, pose, angles)
    margin = stability_margin(com[:2], feet[:, :2], loaded)
    return KeyPose(jnp.all(within), margin, leg_clearance(robot, ground, pose, angles), trunk_clearance(robot, ground, pose))


def feasible(
    robot: Robot, planner: Planner, ground: Obstacles, stance: Standing, leg: Int[Array, ""], target: Float[Array, "3"], pose
) -> Int[Array, ""]:
    """Why a step from a stance cannot be made (`Status`, OK if it can): key poses of the shift to `pose`, key points of the
    swing to `target` in it, and what the motors must hold with the leg in the air. Paper C, 3.2."""
    start = stance.feet[leg]
    top = jnp.maximum(start[2], target[2]) + planner.swing.flight(robot, planner.gait, ground, start, target).apex
    shares = jnp.asarray(SHIFT_SHARES, pose.dtype)[:, None]
    poses = jnp.concatenate([stance.pose[None] + shares * (pose - stance.pose)[None], jnp.broadcast_to(pose, (len(BOX), 6))])
    way, lift = jnp.asarray(BOX, pose.dtype).T[:, :, None]
    base = jnp.where(way < 0.5, start, target)[:, 2:]
    foot = jnp.concatenate([start[None, :2] + way * (target - start)[None, :2], base + lift * (top - base)], axis=1)
    swinging = (jnp.arange(4) == leg)[None]
    held = jnp.broadcast_to(stance.feet, (len(SHIFT_SHARES), 4, 3))
    feet = jnp.concatenate([held, jnp.where(swinging[..., None], foot[:, None], stance.feet[None])])
    in_swing = (jnp.arange(poses.shape[0]) >= len(SHIFT_SHARES))[:, None]
    seen = jax.vmap(lambda *x: key_pose(robot, planner.limits, ground, *x))(poses, feet, ~(swinging & in_swing))
    touched = jnp.any(seen.legs < 0.0, axis=0)
    finite = jnp.isfinite(jnp.sum(pose) + jnp.sum(target) + top)
    torque, load = held_still(robot, feet[-3], pose, (~swinging[0]).astype(pose.dtype))
    under = stood(robot, planner.gait, pose, stance.feet, stance.feet.at[leg].set(target), leg)
    causes = [
        (~finite, Status.NOT_FINITE),
        (~jnp.all(seen.reach), Status.KINEMATICS),
        (jnp.min(seen.margin) < planner.limits.margin, Status.STABILITY),
        (touched[2] | touched[3], Status.HIND_LEG),
        (touched[0], Status.LEFT_LEG),
        (touched[1] | (jnp.min(seen.trunk) < 0.0), Status.COLLISION),
        (jnp.any(jnp.abs(torque) > robot.torque_limit), Status.TORQUE),
        (jnp.any((load < 0.0) & ~swinging[0]), Status.LOAD),
        (~jnp.all(inside(room(planner.gait, under))), Status.WORKSPACE),
    ]
    return jnp.select([bad for bad, _ in causes], [cause for _, cause in causes], Status.OK).astype(jnp.int32)


def held_still(
    robot: Robot, feet: Float[Array, "leg 3"], pose: Float[Array, "6"], weight: Float[Array, "leg"]
) -> tuple[Float[Array, "leg joint"], Float[Array, "leg"]]:
    """Torques [N m] of holding a pose, its feet loaded by `weight` (1 standing, 0 in the air), and the vertical forces on the
    feet [N]. Paper A, (1)."""
    angles, _ = joint_angles(robot, pose, feet)
    to_world, still, none = trunk_rows(pose[3:]), jnp.zeros_like(angles), vector(jnp.zeros_like(pose[:3]))
    motion = Motion(still, still, Moving(none, none, to_world.z * jnp.asarray(GRAVITY, pose.dtype)))
    torque, force = torques_on_ground(robot, all_folds(robot, angles), motion, weight, to_world)
    return torque, force.z


def holding_power(
    robot: Robot, feet: Float[Array, "leg 3"], pose: Float[Array, "6"], weight: Float[Array, "leg"]
) -> Float[Array, ""]:
    """Joule power [W] of holding a pose, its feet loaded by `weight` (1 standing, 0 in the air). Paper A, (1) and (3)."""
    torque, _ = held_still(robot, feet, pose, weight)
    return jnp.sum(motor_power(robot, torque, jnp.zeros_like(torque)).joule)


def check_steps(planner: Planner, robot: Robot, ground: Obstacles, walk: Walk) -> Int[Array, "step"]:
    """`feasible` of every step of a walk, whoever planned it; OK beyond its last."""
    step = np.arange(walk.steps)
    leg = jnp.asarray([STEP_LEGS[s % 4] for s in step])
    each = jax.vmap(
        lambda feet, pose, leg, after, to: feasible(robot, planner, ground, Standing(feet, pose), leg, after[leg], to)
    )
    seen = each(walk.feet[step], walk.poses[step], leg, walk.feet[step + 1], walk.poses[step + 1])
    return jnp.where(jnp.asarray(step, jnp.int32) < walk.count, seen, Status.OK).astype(jnp.int32)


def count_causes(planner: Planner, robot: Robot, site: Site, walk: Walk) -> Int[Array, "cause"]:
    """How many steps of a walk cannot be made, by `Status`."""
    seen = check_steps(planner, robot, site.obstacles, walk)
    return jnp.zeros(CAUSES, jnp.int32).at[seen].add((seen != Status.OK).astype(jnp.int32))
