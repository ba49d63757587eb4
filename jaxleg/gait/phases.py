"""The phases of a walk: which leg swings in each, and what moves from where to where."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from jaxleg.gait.order import SHIFT, STEP_LEGS


class Moves(NamedTuple):
    """What moves in the phases of a walk; poses are (x, y, z, pitch, roll, yaw), see `rotations.trunk_rotation`."""

    trunk_from: Float[Array, "phase 6"]
    trunk_to: Float[Array, "phase 6"]
    feet_from: Float[Array, "phase leg 3"]  # foot centres in W [m]
    feet_to: Float[Array, "phase leg 3"]
    apex: Float[Array, "phase leg"]  # swing apex above the higher end [m], 0 for standing legs
    swings: Float[Array, "phase leg"]  # 1 for the leg that swings in this phase


class Phases(NamedTuple):
    """The phases of a walk in time: `Moves`, and when."""

    start: Float[Array, "phase"]  # time at which the phase begins [s]
    duration: Float[Array, "phase"]  # [s]
    trunk_from: Float[Array, "phase 6"]
    trunk_to: Float[Array, "phase 6"]
    feet_from: Float[Array, "phase leg 3"]
    feet_to: Float[Array, "phase leg 3"]
    apex: Float[Array, "phase leg"]
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
