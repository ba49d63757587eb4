"""Electrical power and energy of the motors. Paper A, equation (1)."""

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.conventions import GRAVITY
from jaxleg.robot import Robot

Convention = Literal["net", "positive", "absolute"]
CONVENTIONS: tuple[Convention, ...] = ("net", "positive", "absolute")


class Power(NamedTuple):
    """Power of the motors [W] (or energy [J] once integrated): what the three conventions are made of."""

    mechanical: Float[Array, "*n"]  # sum of torque times speed, regeneration included
    mechanical_positive: Float[Array, "*n"]  # the same, without regeneration
    joule: Float[Array, "*n"]  # heat of the windings


def motor_power(robot: Robot, torque: Float[Array, "*n"], speed: Float[Array, "*n"]) -> Power:
    """Mechanical and Joule power [W] of joints, from torque [N m] and speed [rad/s]. Paper A, equation (1).

    The current is torque / (K_t * gear); the joule heat I^2 R.
    """
    mechanical = torque * speed
    current = torque / (robot.torque_constant * robot.gear_ratio)
    return Power(mechanical, jax.nn.relu(mechanical), current**2 * robot.resistance)


def electrical(power: Power, convention: Convention) -> Float[Array, "*n"]:
    """Electrical power (or energy) under a convention for negative mechanical power.

    `net` as printed (regeneration returns it), `positive` (it is lost), `absolute` (braking costs as much as driving;
    |p| = 2 max(p, 0) - p).
    """
    mechanical = {
        "net": power.mechanical,
        "positive": power.mechanical_positive,
        "absolute": 2.0 * power.mechanical_positive - power.mechanical,
    }[convention]
    return mechanical + power.joule


def cost_of_transport(energy_per_metre: Float[ArrayLike, "*n"], mass: Float[ArrayLike, ""]) -> Float[Array, "*n"]:
    """Energy per metre over weight, dimensionless: P / (m g v)."""
    return jnp.asarray(energy_per_metre) / (mass * GRAVITY)
