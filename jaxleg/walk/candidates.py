"""Candidate states of a step: footholds times roll, pitch and height of the trunk. Paper C, (22)-(28) (C13).

A candidate's number is ((foothold * rolls + roll) * pitches + pitch) * heights + height, so that in the order of numbers the
height is adjusted first, then pitch, roll, and the foothold last (28). Adjustments begin at the default and go outwards.
"""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.numerics import Code


@dataclasses.dataclass(frozen=True)
class Counts:
    """How many candidates of each kind; static."""

    footholds: int = 12  # (23), in the order of cost
    rolls: int = 3  # (24)
    pitches: int = 3  # (25)
    heights: int = 5  # (26)

    @property
    def candidates(self) -> int:
        """Number of candidate states (27)."""
        return self.footholds * self.rolls * self.pitches * self.heights


class Adjustments(NamedTuple):
    """Default height of the trunk over the plane of the feet and the steps of its adjustments."""

    height: Float[Array, ""]  # [m]
    height_step: Float[Array, ""]  # [m]
    pitch_step: Float[Array, ""]  # [rad]
    roll_step: Float[Array, ""]  # [rad]


class Place(NamedTuple):
    """A candidate's indices among footholds, rolls, pitches and heights."""

    foothold: Int[Array, "*n"]
    roll: Int[Array, "*n"]
    pitch: Int[Array, "*n"]
    height: Int[Array, "*n"]


class Cause(Code):
    """Why a candidate state cannot be reached. `HIND_LEG`, `LEFT_LEG` and `COLLISION` are contacts with the ground."""

    NONE = 0
    NO_FOOTHOLD = 1  # there are fewer footholds than candidates
    KINEMATICS = 2  # out of reach, knee too straight or out of a joint's range
    STABILITY = 3  # centre of mass too near to the support triangle's edge
    HIND_LEG = 4
    LEFT_LEG = 5
    COLLISION = 6  # right front leg or trunk
    NOT_FINITE = 7  # unseen ground on the way


def outwards(count: int) -> np.ndarray:
    """Steps away from the default in the order in which they are tried: 0, 1, -1, 2, -2, ..."""
    index = np.arange(count)
    return np.where(index % 2 == 1, (index + 1) // 2, -(index // 2))


def place_of(candidate: Int[ArrayLike, "*n"], counts: Counts) -> Place:
    """Indices of a candidate's number."""
    rest, height = jnp.divmod(jnp.asarray(candidate), counts.heights)
    rest, pitch = jnp.divmod(rest, counts.pitches)
    foothold, roll = jnp.divmod(rest, counts.rolls)
    return Place(foothold, roll, pitch, height)


def adjustment(place: Place, adjustments: Adjustments, counts: Counts) -> Float[Array, "*n 3"]:
    """Height over the plane [m], then pitch and roll beyond it [rad], of a place."""
    dtype = adjustments.height.dtype
    steps = [jnp.asarray(outwards(n), dtype)[i] for n, i in zip((counts.heights, counts.pitches, counts.rolls), place[:0:-1])]
    height = adjustments.height + steps[0] * adjustments.height_step
    return jnp.stack([height, steps[1] * adjustments.pitch_step, steps[2] * adjustments.roll_step], axis=-1)


def pruned(candidate: Int[Array, ""], cause: Int[Array, ""], counts: Counts) -> Bool[Array, "candidate"]:
    """Candidates of the same node that need not be tried after one has failed. Paper C, 3.3.2, rules (i)-(iii) (C14).

    (i) a kinematic failure: no greater height; (ii) a hind leg on the ground: no pose with its nose further up, which lowers
    the hind legs (the paper counts pitch the other way); (iii) a left leg on the ground: no smaller roll. All three with the
    other adjustments unchanged. Heuristics: a leg folded too far, say, would profit from a greater height. Where a foothold is
    missing, so are all after it.
    """
    all_ = place_of(jnp.arange(counts.candidates, dtype=candidate.dtype), counts)
    here = place_of(candidate, counts)
    height, pitch, roll = (jnp.asarray(outwards(n)) for n in (counts.heights, counts.pitches, counts.rolls))
    foothold, same_roll, same_pitch, same_height = (a == b for a, b in zip(all_, here))
    higher = height[all_.height] > height[here.height]
    nose_up = pitch[all_.pitch] > pitch[here.pitch]
    leftward = roll[all_.roll] < roll[here.roll]
    return (
        ((cause == Cause.KINEMATICS) & foothold & same_roll & same_pitch & higher)
        | ((cause == Cause.HIND_LEG) & foothold & same_roll & same_height & nose_up)
        | ((cause == Cause.LEFT_LEG) & foothold & same_pitch & same_height & leftward)
        | ((cause == Cause.NO_FOOTHOLD) & (all_.foothold >= here.foothold))
    )
