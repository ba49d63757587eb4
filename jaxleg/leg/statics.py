"""Statics of a leg: joint torques that hold a foot force, and the torque maps of paper A, Section III (Fig. 4)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxleg.conventions import GRAVITY
from jaxleg.leg.dynamics import share_load
from jaxleg.leg.kinematics import Reach, foot_jacobian, knee_bend, leg_angles, leg_frames
from jaxleg.leg.moving import Wrench
from jaxleg.numerics import matvec, sqrt_safe
from jaxleg.robot import Robot
from jaxleg.vectors import Vector, vector


class LegTorque(NamedTuple):
    """Torques of a planar leg [N m], its knee bend [rad] and whether the foot is within reach."""

    thigh: Float[Array, "*n"]
    knee: Float[Array, "*n"]
    bend: Float[Array, "*n"]
    reachable: Bool[Array, "*n"]


def standing_load(
    robot: Robot, com: Float[Array, "3"], feet: Float[Array, "leg 3"], loaded: Bool[Array, "leg"]
) -> Float[Array, "leg 3"]:
    """Ground forces [N] on 3 or 4 standing feet by moment balance about the centre of mass (least norm for 4).

    `com`, `feet` in any upright frame [m]. Three feet on level ground leave no choice; a negative one says that
    the centre of mass lies outside the support triangle.
    """
    weight = vector(robot.mass * GRAVITY * jnp.array([0.0, 0.0, 1.0], feet.dtype))
    places = jax.vmap(vector)(feet - com[None])
    forces = share_load(places, loaded.astype(feet.dtype), Wrench(weight, weight.cross(weight)))
    return jax.vmap(Vector.array)(forces)


def holding_torque(
    axis: Float[Array, "joint 3"], offset: Float[Array, "joint 3"], angles: Float[Array, "joint"], force: Float[Array, "3"]
) -> Float[Array, "joint"]:
    """Torques of the motors [N m] that hold the ground's force on the foot [N, axes of B]: tau = -J^T f.

    Paper A's printed (3) is +J^T f, the load on the joints, with theta_2 measured from the horizontal.
    """
    jacobian = foot_jacobian(leg_frames(axis, offset, angles))
    return -matvec(jnp.swapaxes(jacobian, 0, 1), force)


def leg_torque(
    robot: Robot, foot_behind: Float[ArrayLike, ""], hip_height: Float[ArrayLike, ""], force: Float[ArrayLike, ""]
) -> LegTorque:
    """Thigh and knee torque of the first leg with the foot at (L_F2H, -H_COG) under a vertical force [N].

    Paper A, Fig. 4: f_x = 0, the lateral hip link is neglected (its offset is set to zero). `foot_behind` is L_F2H [m],
    forward positive. `vmap` it over a grid for a torque map.
    """
    axis, offset = robot.joint_axis[0], robot.link_offset[0].at[:, 1].set(0.0)
    foot = jnp.stack([jnp.asarray(foot_behind, offset.dtype), jnp.zeros((), offset.dtype), -jnp.asarray(hip_height)])
    angles, status = leg_angles(axis, offset, robot.knee_sign, foot)
    vertical = jnp.asarray(force, offset.dtype) * jnp.array([0.0, 0.0, 1.0], offset.dtype)
    torque = holding_torque(axis, offset, angles, vertical)
    return LegTorque(torque[1], torque[2], knee_bend(axis, offset, angles), status == Reach.OK)


@jax.jit
def torque_map(
    robot: Robot, foot_behind: Float[Array, "nx"], hip_height: Float[Array, "nz"], force: Float[ArrayLike, ""]
) -> LegTorque:
    """`leg_torque` on a grid of (L_F2H, H_COG) [m]; fields have shape (nx, nz). Paper A, Fig. 4."""
    column = jax.vmap(leg_torque, in_axes=(None, None, 0, None))
    return jax.vmap(column, in_axes=(None, 0, None, None))(robot, foot_behind, hip_height, force)


@jax.jit
def knee_zero_line(robot: Robot, hip_height: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """L_F2H [m] where the knee torque vanishes: x = -sqrt(L2^2 - (H - L3)^2), the foot under a backward knee (A5)."""
    thigh, shank = -robot.link_offset[0, 1, 2], -robot.link_offset[0, 2, 2]
    return -robot.knee_sign * sqrt_safe(thigh**2 - (jnp.asarray(hip_height) - shank) ** 2)
