"""`Robot`: geometry, masses, motors and limits of a quadruped as one pytree."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.pytree import pytree


@pytree
class Robot:
    """A quadruped: a trunk and four legs of three revolute joints (hip roll, thigh pitch, knee pitch).

    Every field is a leaf, so any of them may be differentiated or batched. Link j of a leg (hip, thigh, shank) has its
    frame at joint j, aligned with the trunk when all joint angles are zero.
    """

    hip_position: Float[Array, "*batch leg xyz"]  # hip joint in B [m]
    joint_axis: Float[Array, "*batch leg joint xyz"]  # unit axis of joint j in the frame of its link
    link_offset: Float[Array, "*batch leg joint xyz"]  # end of link j (next joint, or the foot) in its frame [m]
    trunk_mass: Float[Array, "*batch"]  # [kg]
    trunk_com: Float[Array, "*batch xyz"]  # in B [m]
    trunk_inertia: Float[Array, "*batch xyz"]  # principal moments about the COM, axes of B [kg m^2]
    link_mass: Float[Array, "*batch leg joint"]  # [kg]
    link_com: Float[Array, "*batch leg joint xyz"]  # in the link's frame [m]
    link_inertia: Float[Array, "*batch leg joint xyz"]  # principal moments about the COM, axes of the link [kg m^2]
    rotor_inertia: Float[Array, "*batch leg joint"]  # reflected to the joint (gear^2 times the rotor's) [kg m^2]
    joint_damping: Float[Array, "*batch leg joint"]  # viscous loss of joint and gear [N m s]
    torque_limit: Float[Array, "*batch leg joint"]  # [N m]
    stiffness: Float[Array, "*batch leg joint"]  # position gain kp of the joint controller [N m/rad]
    velocity_gain: Float[Array, "*batch leg joint"]  # kd [N m s/rad]
    foot_radius: Float[Array, "*batch"]  # disc that the foot needs on the ground [m]
    contact_radius: Float[Array, "*batch"]  # the foot touches as a sphere of this radius about the end of the shank [m]
    leg_radius: Float[Array, "*batch"]  # of the capsules round thigh and shank that must not touch the ground [m]
    joint_range: Float[Array, "*batch leg joint 2"]  # least and greatest joint angle [rad]
    trunk_size: Float[Array, "*batch xyz"]  # length, width, height of the trunk's box about B's origin [m]
    torque_constant: Float[Array, "*batch"]  # K_t of the motor [N m/A]
    resistance: Float[Array, "*batch"]  # R of a winding [Ohm]
    gear_ratio: Float[Array, "*batch"]  # joint torque = K_t * current * gear ratio
    knee_sign: Float[Array, "*batch"]  # +1: knees point backward (knee angle > 0), -1: forward

    @property
    def mass(self) -> Float[Array, "*batch"]:
        """Total mass [kg]."""
        return self.trunk_mass + jnp.sum(self.link_mass, axis=(-2, -1))
