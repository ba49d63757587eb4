"""A walk whose form is free: trunk at every border of its phases, their durations, apex and lift of swings, feet aside.

Ten numbers of a gait place the trunk by rules: over an in-centre, level, still while a leg swings. Here each place has numbers
of its own, added to what the rules say, so that gradients can find what no rule has thought of. How many differ is a matter of
what is tied together (`Tie`): a half cycle and its mirror image, a cycle, or nothing.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEG_END, LEG_SIDE
from jaxleg.gait.order import SHIFT
from jaxleg.walk.choices import Choices
from jaxleg.walk.data import Walk

MIRRORED = np.array([1.0, -1.0, 1.0, 1.0, -1.0, -1.0])  # of a pose (x, y, z, pitch, roll, yaw)


class Free(NamedTuple):
    """What is added to a planned walk; all zero is the walk as it was planned."""

    trunk: Float[Array, "border 6"]  # to its pose where a phase begins, and where the last one ends [m, rad]
    time: Float[Array, "phase"]  # log of a phase's duration over the planned one; the walk takes as long as before
    apex: Float[Array, "phase"]  # to the apex of the phase's swing [m]
    lift: Float[Array, "phase"]  # to the part of its time in which the foot only moves up or down
    aside: Float[Array, "stance leg"]  # to the foothold, to the left [m]


class Tie(NamedTuple):
    """Which number of a vector stands at each place of `Free`, and with which sign; sign 0: none does."""

    index: Free
    sign: Free


def tie(legs: tuple[int, ...], stances: int, period: int | None = None, mirrored: bool = False) -> Tie:
    """Ties of walks whose phases swing `legs` (or `SHIFT`): phases `period` apart are alike (None: only the two ends of the
    walk are), or `mirrored`, left and right changed. Feet go as far aside in all stances."""
    period, known = period or len(legs), {}

    def place(*key):
        """The index of the number of this name."""
        return known.setdefault(key, len(known))

    turned = [bool(mirrored and p // period % 2) for p in range(len(legs) + 1)]
    index, sign = {}, {}
    index["trunk"] = np.array([[place("trunk", p % period, i) for i in range(6)] for p in range(len(legs) + 1)])
    sign["trunk"] = np.array([MIRRORED if turn else np.ones(6) for turn in turned])
    for name in ("time", "apex", "lift"):
        there = np.array([name == "time" or leg != SHIFT for leg in legs])  # in a shift no foot flies
        index[name] = np.array([place(name, p % period) if has else 0 for p, has in enumerate(there)])
        sign[name] = there.astype(float)
    aside = [place("aside", LEG_END[leg] if mirrored else leg) for leg in range(4)]
    index["aside"], sign["aside"] = (np.tile(row, (stances, 1)) for row in (aside, LEG_SIDE if mirrored else np.ones(4)))
    return Tie(Free(**index), Free(**sign))


def count_of(tie: Tie) -> int:
    """Numbers of the vector that a tie spreads."""
    return 1 + max(int(np.max(x)) for x in tie.index)


def names_of(tie: Tie) -> list[str]:
    """What each number of the vector is: "trunk 0" (x) to "trunk 5" (yaw), "time", "apex", "lift", "aside"."""
    names = [""] * count_of(tie)
    for name, index, sign in zip(Free._fields, tie.index, tie.sign):
        for place in np.argwhere(sign != 0.0):
            names[index[tuple(place)]] = f"trunk {place[1]}" if name == "trunk" else name
    return names


def spread(tie: Tie, vector: Float[Array, "number"]) -> Free:
    """The numbers of a vector at their places."""
    return jax.tree.map(lambda index, sign: jnp.asarray(sign, vector.dtype) * vector[index], tie.index, tie.sign)


def gathered(tie: Tie, free: Free) -> np.ndarray:
    """The vector that `spread` spreads so: of what is not alike where the tie has it alike, the last."""
    vector = np.zeros(count_of(tie))
    for index, sign, values in zip(tie.index, tie.sign, free):
        there = sign != 0.0
        vector[index[there]] = (sign * np.asarray(values))[there]
    return vector


def aside(choices: Choices, free: Free) -> Choices:
    """The choices with the footholds moved aside; the walk is then built on the ground under them."""
    return choices._replace(offset=choices.offset.at[..., 1].add(free.aside))


def freed(walk: Walk, free: Free) -> Walk:
    """The walk with trunk, times and swings moved. All phases must be used: a walk that may end before is not freed."""
    phases, poses = walk.phases, _poses_before(walk)
    longer = phases.duration * jnp.exp(free.time)
    duration = longer * (jnp.sum(phases.duration) / jnp.sum(longer))
    flight = phases.flight._replace(apex=phases.flight.apex + free.apex, lift=phases.flight.lift + free.lift)
    moved = phases._replace(
        start=jnp.cumsum(duration) - duration,
        duration=duration,
        trunk_from=phases.trunk_from + free.trunk[:-1],
        trunk_to=phases.trunk_to + free.trunk[1:],
        flight=flight,
    )
    return dataclasses.replace(walk, phases=moved, poses=walk.poses + free.trunk[poses])


def _poses_before(walk: Walk) -> Int[np.ndarray, "pose"]:
    """The border at which the trunk has each pose of a walk: before the first phase, each swing, and at the end."""
    swings = np.flatnonzero(np.array(walk.legs) != SHIFT)
    return np.array([0, *swings, len(walk.legs)])
