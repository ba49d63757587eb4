"""Foot forces without foot sensors: from joint torques, speeds and the trunk's motion. Paper B, II (reading B18).

    f = -J^-T (tau - tau_weight - tau_inertia)

f is the ground on the foot; weight and inertia are those of the rigid-body model. What the motors give beyond them the
ground takes.
"""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.control.contract import State, Terms
from jaxleg.numerics import inverse3_safe, matvec
from jaxleg.robot import Robot


def felt_forces(
    terms: Terms,
    robot: Robot,
    torque: Float[Array, "leg joint"],
    before: State,
    after: State,
    dt: Float[ArrayLike, ""],
    inertia: Float[ArrayLike, ""] = 1.0,
) -> Float[Array, "leg 3"]:
    """Force of the ground on each foot in W [N], from the torques [N m] that moved the robot from one state to the next.

    `terms` are the model's at `before`. With `inertia` 0 the legs' and trunk's accelerations are left out: what a robot
    that only knows its links' weight feels. Finite, but wrong, at a stretched leg.
    """
    trunk, legs = (after.v - before.v)[:6] / dt, ((after.v - before.v)[6:] / dt).reshape(4, 3)
    accelerating = matvec(terms.legs, legs) + matvec(jnp.swapaxes(terms.coupling, -1, -2), trunk)
    load = terms.leg_bias + robot.joint_damping * after.v[6:].reshape(4, 3) + inertia * accelerating
    return matvec(jnp.swapaxes(inverse3_safe(terms.foot_by_leg), -1, -2), load - torque)
