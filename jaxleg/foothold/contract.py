"""What every filling of a planner's foothold part offers, and how its answers look.

    stance(robot, gait, site, nominal, yaw, room) -> Footholds       of the four feet together: greedy series, first stances
    propose(robot, gait, site, nominal, yaw, leg) -> Proposal        of one leg, best first: tree searches

`nominal` are the stance's nominal footholds (leg, x y in W) [m], `yaw` its heading [rad]; `room` says of four feet (leg, 3)
[m] how far inside of all bounds on them but the ground's they stand together [m]; negative: outside. Exact, without a gradient.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.numerics import Code

Room = Callable[[Float[Array, "leg 3"]], Float[Array, ""]]


def endless(feet: Float[Array, "leg 3"]) -> Float[Array, ""]:
    """The `Room` where nothing but the ground bounds the feet."""
    return jnp.full((), jnp.inf, feet.dtype)


class FootholdStatus(Code):
    """How a foothold was found. Paper A, IV.B.3, of its cascade; a foot alone finds one in its rectangle or a wider one."""

    NOMINAL = 0  # within rectangle and workspace; the cascade's by an offset common to all feet
    WIDENED = 1  # likewise within the lengthened rectangle
    NEAREST = 2  # no common offset: this leg's valid cell nearest to nominal, whatever the workspace
    NONE = 3  # no valid cell at all: placed nowhere, the lane is infeasible


class Footholds(NamedTuple):
    """Chosen offsets from the nominal footholds (x, y in W) [m] and a `FootholdStatus` a leg; NONE comes with offset 0."""

    offset: Float[Array, "leg 2"]
    status: Int[Array, "leg"]


class Proposal(NamedTuple):
    """Candidate footholds of a leg, best first."""

    xy: Float[Array, "foothold 2"]  # in W [m]
    exists: Bool[Array, "foothold"]
    cost: Float[Array, "foothold"]
