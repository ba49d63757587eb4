"""Candidate states of a step: footholds times roll, pitch and height of the trunk. Paper C, (22)-(28) (C13).

A candidate's number is ((foothold * rolls + roll) * pitches + pitch) * heights + height, so that in the order of numbers the
height is adjusted first, then pitch, roll, and the foothold last (28). Adjustments begin at the default and go outwards.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.status import Status


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
        return self.footholds * self.poses

    @property
    def poses(self) -> int:
        """Number of poses over each foothold."""
        return self.rolls * self.pitches * self.heights


class Adjustments(NamedTuple):
    """Size of a step away from the default height, pitch and roll of the trunk."""

    height: Float[Array, ""]  # [m]
    pitch: Float[Array, ""]  # [rad]
    roll: Float[Array, ""]  # [rad]


class Place(NamedTuple):
    """A candidate's indices among footholds, rolls, pitches and heights."""

    foothold: Int[Array, "*n"]
    roll: Int[Array, "*n"]
    pitch: Int[Array, "*n"]
    height: Int[Array, "*n"]


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


def steps_away(candidate: Int[ArrayLike, "*n"], counts: Counts) -> Int[Array, "*n 3"]:
    """Steps of a candidate away from the default height, pitch and roll."""
    place = place_of(candidate, counts)
    pairs = ((counts.heights, place.height), (counts.pitches, place.pitch), (counts.rolls, place.roll))
    return jnp.stack([jnp.asarray(outwards(n), jnp.int32)[i] for n, i in pairs], axis=-1)


def adjustment_of(steps: Int[Array, "*n 3"], adjustments: Adjustments) -> Float[Array, "*n 3"]:
    """Height [m], pitch and roll [rad] beyond the default that so many steps make."""
    size = jnp.stack([*adjustments])
    return steps.astype(size.dtype) * jax.lax.broadcast_to_rank(size, steps.ndim)


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
        ((cause == Status.KINEMATICS) & foothold & same_roll & same_pitch & higher)
        | ((cause == Status.HIND_LEG) & foothold & same_roll & same_height & nose_up)
        | ((cause == Status.LEFT_LEG) & foothold & same_pitch & same_height & leftward)
        | ((cause == Status.NO_FOOTHOLD) & (all_.foothold >= here.foothold))
    )
