"""Trunk and legs together: joint angles and centre of mass at a trunk pose (x, y, z, pitch, roll, yaw)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.leg.dynamics import all_folds, centre_of_mass
from jaxleg.leg.kinematics import leg_angles
from jaxleg.numerics import matvec
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_rotation, trunk_rows


def feet_in_trunk(pose: Float[Array, "6"], feet: Float[Array, "leg 3"]) -> Float[Array, "leg 3"]:
    """Feet [m] relative to B's origin, in B."""
    return matvec(jnp.swapaxes(trunk_rotation(pose[3:]), 0, 1), feet - pose[None, :3])


def joint_angles(
    robot: Robot, pose: Float[Array, "6"], feet: Float[Array, "leg 3"]
) -> tuple[Float[Array, "leg joint"], jax.Array]:
    """Inverse kinematics of the four legs at a trunk pose, with a `Reach` status a leg."""
    inverse = jax.vmap(leg_angles, in_axes=(0, 0, None, 0))
    relative = feet_in_trunk(pose, feet) - robot.hip_position
    return inverse(robot.joint_axis, robot.link_offset, robot.knee_sign, relative)


def com_offset(robot: Robot, pose: Float[Array, "6"], feet: Float[Array, "leg 3"]) -> Float[Array, "3"]:
    """Centre of mass, legs included, relative to B's origin, axes of W [m]."""
    angles, _ = joint_angles(robot, pose, feet)
    return trunk_rows(pose[3:]).times(centre_of_mass(robot, all_folds(robot, angles))).array()


def com_position(robot: Robot, pose: Float[Array, "6"], angles: Float[Array, "leg joint"]) -> Float[Array, "3"]:
    """Centre of mass in W [m], legs included."""
    return pose[:3] + trunk_rows(pose[3:]).times(centre_of_mass(robot, all_folds(robot, angles))).array()
