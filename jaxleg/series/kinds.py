"""How far ahead a planner looks: not at all (paper A), or by a tree of candidate states with backtracking (paper C, 3.3)."""

import dataclasses
from typing import Literal

import jax
from jaxtyping import Array, Float, Int

from jaxleg.series.candidates import Adjustments, Counts

Order = Literal["paper", "energy"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Greedy:
    """Each stance takes the footholds proposed first, whatever follows from them."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Tree:
    """The tree search of paper C (C13, C14). Counts, depth, order and pruning are static, all else leaves."""

    adjustments: Adjustments
    budget: Int[Array, "*batch"]  # most candidates tried
    energy_weight: Float[Array, "*batch"]  # the order "energy" adds this times the energy of a step in the pose ...
    energy: Float[Array, "*batch"]  # ... over this much [J]
    acceleration: Float[Array, "*batch"]  # of a shift, for its time in that energy [m/s^2]
    swing_time: Float[Array, "*batch"]  # about what a swing takes, likewise [s]
    counts: Counts = dataclasses.field(metadata={"static": True})
    depth: int = dataclasses.field(default=4, metadata={"static": True})  # steps that must stand before the first is settled
    order: Order = dataclasses.field(default="paper", metadata={"static": True})
    prune: bool = dataclasses.field(default=True, metadata={"static": True})
