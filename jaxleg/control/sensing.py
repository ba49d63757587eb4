"""Foot forces without foot sensors: from motor torques and joint positions alone. Paper B, II (reading B18).

    f = -J^-T (tau - tau_weight - tau_inertia)

f is the ground on the foot; weight and inertia are those of a rigid-body model of the legs on a trunk that stands still, as it
does while a leg swings. What the motors give beyond them the ground takes. Speeds and accelerations are those of the low-passed
positions, and the torques are passed likewise, so that both sides of the equation are equally late.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxleg.control.contract import State
from jaxleg.conventions import GRAVITY
from jaxleg.leg.dynamics import Motion, all_folds, all_leg_frames, inverse_dynamics
from jaxleg.leg.kinematics import foot_jacobian
from jaxleg.leg.moving import Moving
from jaxleg.numerics import inverse3_safe, matvec
from jaxleg.pytree import pytree
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_rotation
from jaxleg.vectors import vector

CREEP = 0.02  # joint speed about which friction turns round [rad/s]


@pytree
class Senses:
    """What a robot measures, and how well; every field a leaf."""

    delay: Float[Array, "*batch"]  # of the low pass [s]
    inertia: Float[Array, "*batch"]  # share of the inertial load that the estimate takes account of: 0 or 1
    mass_error: Float[Array, "*batch"]  # of the model's links: it believes (1 + this) times their masses and inertias
    friction: Float[Array, "*batch"]  # of the joints, which the model does not know [N m]
    angle_noise: Float[Array, "*batch"]  # standard deviation of a measured joint position [rad]
    torque_noise: Float[Array, "*batch"]  # of a measured torque [N m]
    seed: Int[Array, "*batch"]  # of the noise


class Smoothed(NamedTuple):
    """A low-passed signal with its rate and acceleration."""

    value: Float[Array, "*n"]
    rate: Float[Array, "*n"]
    acceleration: Float[Array, "*n"]


class Joints(NamedTuple):
    """What the joints have been measured to do."""

    angles: Smoothed  # (leg, joint)
    torque: Smoothed
    tick: Int[Array, ""]


def at_rest(angles: Float[Array, "leg joint"], torque: Float[Array, "leg joint"]) -> Joints:
    """Before the first tick: the robot stands."""
    still = jnp.zeros_like(angles)
    return Joints(Smoothed(angles, still, still), Smoothed(torque, still, still), jnp.zeros((), jnp.int32))


def smoothed(past: Smoothed, now: Float[Array, "*n"], delay: Float[Array, ""], dt: Float[ArrayLike, ""]) -> Smoothed:
    """A tick of a critically damped second-order low pass that lags a ramp by `delay` [s]; stable for every dt [s]."""
    stiff = 2.0 / jnp.maximum(delay, 1e-6)
    rate = (past.rate + dt * stiff**2 * (now - past.value)) / (1.0 + dt * stiff) ** 2
    return Smoothed(past.value + dt * rate, rate, (rate - past.rate) / dt)


def measured(senses: Senses, past: Joints, torque: Float[Array, "leg joint"], after: State, dt: Float[ArrayLike, ""]) -> Joints:
    """The measurements of a tick taken in, in which the motors drove the joints by `torque` [N m] to the state `after`."""
    angles, speed = after.q[7:].reshape(4, 3), after.v[6:].reshape(4, 3)
    noise = jax.random.normal(jax.random.fold_in(jax.random.key(senses.seed), past.tick), (2, 4, 3), angles.dtype)
    given = torque + senses.friction * jnp.tanh(speed / CREEP) + senses.torque_noise * noise[1]
    seen = smoothed(past.angles, angles + senses.angle_noise * noise[0], senses.delay, dt)
    return Joints(seen, smoothed(past.torque, given, senses.delay, dt), past.tick + 1)


def felt_forces(robot: Robot, senses: Senses, felt: Joints, turn: Float[Array, "3"]) -> Float[Array, "leg 3"]:
    """Force of the ground on each foot in W [N], the trunk still at its (pitch, roll, yaw) `turn`.

    With `senses.inertia` 0 the legs' acceleration is left out: what a robot that only knows its links' weight feels. Finite,
    but wrong, at a stretched leg.
    """
    rotation, still = trunk_rotation(turn), jnp.zeros_like(turn)
    frames = all_leg_frames(robot, felt.angles.value)
    trunk = Moving(vector(still), vector(still), vector(GRAVITY * rotation[2]))
    motion = Motion(felt.angles.rate, senses.inertia * felt.angles.acceleration, trunk)
    load, _ = inverse_dynamics(believed(robot, senses.mass_error), all_folds(robot, felt.angles.value), motion)
    jacobian = jax.vmap(foot_jacobian)(frames)
    force = matvec(jnp.swapaxes(inverse3_safe(jacobian), -1, -2), load - felt.torque.value)
    return matvec(rotation, force)


def believed(robot: Robot, mass_error: Float[Array, ""]) -> Robot:
    """The robot whose links are heavier than they are by a share."""
    mass, inertia = ((1.0 + mass_error) * x for x in (robot.link_mass, robot.link_inertia))
    return dataclasses.replace(robot, link_mass=mass, link_inertia=inertia)
