"""How far ahead a planner looks: not at all (paper A), or by a tree of candidate states with backtracking (paper C, 3.3)."""

from typing import Literal

from jaxtyping import Array, Float, Int

from jaxleg.pytree import pytree, static
from jaxleg.series.candidates import Adjustments, Counts

Order = Literal["paper", "energy"]


@pytree
class Greedy:
    """Each stance takes the footholds proposed first, whatever follows from them."""


@pytree
class Tree:
    """The tree search of paper C (C13, C14). Counts, depth, order and pruning are static, all else leaves."""

    adjustments: Adjustments
    budget: Int[Array, "*batch"]  # most candidates tried
    energy_weight: Float[Array, "*batch"]  # the order "energy" adds this times the energy of a step in the pose ...
    energy: Float[Array, "*batch"]  # ... over this much [J]
    acceleration: Float[Array, "*batch"]  # of a shift, for its time in that energy [m/s^2]
    swing_time: Float[Array, "*batch"]  # about what a swing takes, likewise [s]
    counts: Counts = static()
    depth: int = static(4)  # steps that must stand before the first is settled
    order: Order = static("paper")
    prune: bool = static(True)
