"""Bounds of the local map of a swing: what the leg reaches in the vertical plane of a step. Paper B, III.A (reading B19)."""

from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.numerics import sqrt_safe
from jaxleg.robot import Robot


class Bounds(NamedTuple):
    """Lowest and highest foot centre [m] at places of the step."""

    low: Float[Array, "place"]
    high: Float[Array, "place"]


def swing_bounds(
    robot: Robot,
    hip: Float[Array, "3"],
    place: Float[Array, "place 2"],
    least_bend: Float[ArrayLike, ""],
    most_bend: Float[ArrayLike, ""],
) -> Bounds:
    """z- and z+ in W at horizontal places (x, y) [m] of a leg whose hip joint is at `hip`, between two knee bends [rad].

    The leg's plane stands off the hip's roll axis by L1, so the foot's distance from the hip joint is between two values of
    sqrt(L1^2 + r^2), r from the thigh joint: a shell, whatever the trunk's orientation. Bounds are at hip height where the
    place is beyond the shell.
    """
    lateral = jnp.sum(robot.link_offset[0, :, 1]) ** 2
    away = jnp.sum((place - hip[None, :2]) ** 2, axis=-1)
    longest, shortest = (reach_for_bend(robot.link_offset[0], bend) ** 2 + lateral for bend in (least_bend, most_bend))
    return Bounds(hip[2] - sqrt_safe(longest - away), hip[2] - sqrt_safe(shortest - away))
