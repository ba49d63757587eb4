"""Inverse dynamics of a trunk with four legs: Newton-Euler down and up each leg, contact forces by weighted least norm.

All vectors are in the trunk's frame B, moments about B's origin. Written for one instant; `vmap` over time and lanes.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.leg.kinematics import LegFrames, accelerated, carried_sum, foot_jacobian, leg_frames, link_motion
from jaxleg.numerics import cross, cross_matrix, dot, matmul, matvec, solve_spd6
from jaxleg.robot import Robot

TANGENTIAL = 0.05  # how readily a plan uses force across the vertical, see `share_load`


class Motion(NamedTuple):
    """Motion of the whole robot at one instant; the trunk's vectors in B, its acceleration less that of gravity."""

    velocity: Float[Array, "leg joint"]
    acceleration: Float[Array, "leg joint"]
    trunk_spin: Float[Array, "3"]  # angular velocity [rad/s]
    trunk_spin_rate: Float[Array, "3"]  # [rad/s^2]
    trunk_acceleration: Float[Array, "3"]  # of B's origin minus gravity: at rest (0, 0, +g) when level [m/s^2]


class Wrench(NamedTuple):
    """Force [N] and moment [N m] about B's origin, in B."""

    force: Float[Array, "3"]
    moment: Float[Array, "3"]


def all_leg_frames(robot: Robot, angles: Float[Array, "leg joint"]) -> LegFrames:
    """`leg_frames` of the four legs, with a leading leg axis; positions relative to each hip joint."""
    return jax.vmap(leg_frames)(robot.joint_axis, robot.link_offset, angles)


def centre_of_mass(robot: Robot, frames: LegFrames) -> Float[Array, "3"]:
    """Centre of mass of the whole robot in B [m]."""
    links = robot.hip_position[:, None] + frames.origin + matvec(frames.rotation, robot.link_com)
    moment = robot.trunk_mass * robot.trunk_com + jnp.sum(robot.link_mass[..., None] * links, axis=(0, 1))
    return moment / robot.mass


def _newton_euler(mass, inertia, rotation, spin, spin_rate, acceleration):
    """Force and moment about the centre of mass that move one body so; `inertia` are moments in its own axes."""
    to_body = jnp.swapaxes(rotation, -1, -2)
    local, local_rate = matvec(to_body, spin), matvec(to_body, spin_rate)
    moment = inertia * local_rate + cross(local, inertia * local)
    return mass * acceleration, matvec(rotation, moment)


def _leg_inverse_dynamics(frames, hip, com, mass, inertia, velocity, acceleration, trunk):
    """Joint torques of one leg without contact or losses, and the wrench the trunk gives to it."""
    spin, spin_rate, linear = trunk
    move = link_motion(frames, velocity, acceleration, spin, spin_rate, accelerated(spin, spin_rate, linear, hip))
    arm = matvec(frames.rotation, com)
    at_com = accelerated(move.spin, move.spin_rate, move.origin, arm)
    force, moment = _newton_euler(mass[:, None], inertia, frames.rotation, move.spin, move.spin_rate, at_com)
    moment = moment + cross(frames.origin + arm, force)  # about the hip joint
    force, moment = carried_sum(force), carried_sum(moment)
    torque = dot(frames.axis, moment - cross(frames.origin, force))
    return torque, Wrench(force[0], moment[0] + cross(hip, force[0]))


def inverse_dynamics(robot: Robot, frames: LegFrames, motion: Motion) -> tuple[Float[Array, "leg joint"], Wrench]:
    """Joint torques [N m] and trunk wrench that produce a motion without contact.

    The torques include the reflected rotor inertia and the joint's viscous loss; the wrench is what the ground must give.
    """
    torque, wrench = newton_euler(robot, frames, motion)
    return torque + robot.rotor_inertia * motion.acceleration + robot.joint_damping * motion.velocity, wrench


def newton_euler(robot: Robot, frames: LegFrames, motion: Motion) -> tuple[Float[Array, "leg joint"], Wrench]:
    """Joint torques [N m] and trunk wrench of the bodies alone, without rotors and losses (recursive Newton-Euler)."""
    spin, spin_rate, linear = trunk = motion.trunk_spin, motion.trunk_spin_rate, motion.trunk_acceleration
    legs = jax.vmap(_leg_inverse_dynamics, in_axes=(0, 0, 0, 0, 0, 0, 0, None))
    torque, wrench = legs(
        *(frames, robot.hip_position, robot.link_com, robot.link_mass, robot.link_inertia),
        *(motion.velocity, motion.acceleration, trunk),
    )
    identity = jnp.eye(3, dtype=spin.dtype)
    at_com = accelerated(spin, spin_rate, linear, robot.trunk_com)
    force, moment = _newton_euler(robot.trunk_mass, robot.trunk_inertia, identity, spin, spin_rate, at_com)
    moment = moment + cross(robot.trunk_com, force)
    return torque, Wrench(force + jnp.sum(wrench.force, axis=0), moment + jnp.sum(wrench.moment, axis=0))


def share_load(
    feet: Float[Array, "leg 3"],
    weight: Float[Array, "leg"],
    wrench: Wrench,
    up: Float[Array, "3"] | None = None,
    tangential: float = 1.0,
) -> Float[Array, "leg 3"]:
    """Contact forces that add up to a wrench, with the least sum of |f_i|^2 / weight_i.

    `feet` [m] relative to the point the moment is about; weight 0 is a foot in the air, at least three feet must have a
    positive one. `tangential` < 1 makes force across the unit vector `up` (default: z) that much dearer: feet at different
    heights then do not push against each other, as in paper A's f_x = 0.
    """
    up = jnp.array([0.0, 0.0, 1.0], feet.dtype) if up is None else up
    along = tangential * jnp.eye(3, dtype=feet.dtype) + (1.0 - tangential) * up[:, None] * up[None, :]
    arm = feet - (jnp.sum(weight[:, None] * feet, axis=0) / jnp.sum(weight))[None]  # about the centroid: well conditioned
    turn = cross_matrix(arm)
    grasp = jnp.concatenate([jnp.broadcast_to(jnp.eye(3, dtype=feet.dtype), turn.shape), turn], axis=1)
    response = weight[:, None, None] * matmul(grasp, jnp.broadcast_to(along, turn.shape))  # leg, wrench, force
    normal = jnp.sum(matmul(response, jnp.swapaxes(grasp, -1, -2)), axis=0)
    moment = wrench.moment - cross(feet[0] - arm[0], wrench.force)
    return jnp.sum(response * solve_spd6(normal, jnp.concatenate([wrench.force, moment]))[None, :, None], axis=1)


def torques_on_ground(
    robot: Robot, frames: LegFrames, motion: Motion, weight: Float[Array, "leg"], up: Float[Array, "3"]
) -> tuple[Float[Array, "leg joint"], Float[Array, "leg 3"]]:
    """Joint torques [N m] of a motion on the ground and the contact forces [N, in B].

    Full inverse dynamics: links' weight and inertia, reflected rotors, joint loss, and tau = -J^T f (paper A III.B with the
    sign of the motors). `weight` shares the load among the feet, `up` is the vertical in B; see `share_load`.
    """
    torque, wrench = inverse_dynamics(robot, frames, motion)
    force = share_load(robot.hip_position + frames.foot, weight, wrench, up, TANGENTIAL)
    jacobian = jax.vmap(foot_jacobian)(frames)
    return torque - matvec(jnp.swapaxes(jacobian, -1, -2), force), force
