"""The phases of a walk: which leg swings in each, and what moves from where to where."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.gait.order import SHIFT, STEP_LEGS


class Flight(NamedTuple):
    """A foot's law in one swing, or in many (leading axes); `swing.flight.fly` says where the foot is."""

    apex: Float[Array, "*batch"]  # of the path above the higher end [m]
    lift: Float[Array, "*batch"]  # of a cycloid: part of the time at either end in which the foot moves only up or down
    corner: Float[Array, "*batch corner 2"]  # of a route: share of the way, height in W [m]; none: a cycloid
    rounding: Float[Array, "*batch"]  # length [m] over which the corners are rounded to either side


def no_flights(count: int, dtype: jnp.dtype) -> Flight:
    """The flights of so many phases in which no foot flies."""
    zero = jnp.zeros(count, dtype)
    return Flight(zero, zero, jnp.zeros((count, 0, 2), dtype), zero)


class Moves(NamedTuple):
    """What moves in the phases of a walk; poses are (x, y, z, pitch, roll, yaw), see `rotations.trunk_rotation`."""

    trunk_from: Float[Array, "phase 6"]
    trunk_to: Float[Array, "phase 6"]
    feet_from: Float[Array, "phase leg 3"]  # foot centres in W [m]
    feet_to: Float[Array, "phase leg 3"]
    flight: Flight  # of the leg that swings, leading axis phase
    swings: Float[Array, "phase leg"]  # 1 for the leg that swings in this phase


class Phases(NamedTuple):
    """The phases of a walk in time: `Moves`, and when."""

    start: Float[Array, "phase"]  # time at which the phase begins [s]
    duration: Float[Array, "phase"]  # [s]
    trunk_from: Float[Array, "phase 6"]
    trunk_to: Float[Array, "phase 6"]
    feet_from: Float[Array, "phase leg 3"]
    feet_to: Float[Array, "phase leg 3"]
    flight: Flight
    swings: Float[Array, "phase leg"]


class Layout(NamedTuple):
    """The phases of a walk of so many steps; static."""

    leg: np.ndarray  # that swings, or `SHIFT`
    step: np.ndarray  # that swings, or that follows the shift


def layout(steps: int, shared: bool, standing: bool) -> Layout:
    """A body shift before each swing, or with `shared` before the two swings of a side. A walk that ends `standing` has a last
    shift, wherever it ends, and so another block of phases."""
    block = (SHIFT, 0, 1) if shared else (SHIFT, 0)
    each = 2 if shared else 1
    rows = [(kind, first + max(kind, 0)) for first in range(0, steps + each * standing, each) for kind in block]
    leg = [kind if kind == SHIFT else STEP_LEGS[step % len(STEP_LEGS)] for kind, step in rows]
    return Layout(np.array(leg), np.array([step for _, step in rows]))
