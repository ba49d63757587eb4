"""A search of a walk's free form (`walk.free`): in a vector its numbers stand behind those of the planner."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Array, Float

from jaxleg.gait.limits import leg_length
from jaxleg.gait.order import SHIFT
from jaxleg.gait.phases import layout
from jaxleg.search.lanes import CYCLES, Lab, Setting, stations
from jaxleg.terrain.site import Site
from jaxleg.walk.build import build_walk, lowered
from jaxleg.walk.choices import Choices
from jaxleg.walk.data import Walk
from jaxleg.walk.free import Tie, aside, freed, names_of, spread, tie

SHAPE = layout(4 * CYCLES, shared=True, standing=False)  # of paper A's crawl
# How far a number may move: lengths as shares of the leg's, angles in radians, the log of a time, shares of a time.
SPANS = {
    **{f"trunk {i}": (-1 / 6, 1 / 6) for i in range(3)},
    **{f"trunk {i}": (-0.3, 0.3) for i in range(3, 6)},
    "time": (-0.8, 0.8),
    "apex": (0.0, 1 / 12),  # no lower than planned: that is what clears the ground
    "lift": (0.0, 0.2),
    "aside": (-1 / 6, 1 / 6),
}
ROWS = 512  # with fewer, models of tens of numbers miss what binds next
LENGTHS = ("trunk 0", "trunk 1", "trunk 2", "apex", "aside")


@dataclasses.dataclass(frozen=True, kw_only=True)
class FreeLab(Lab):
    """A lab whose vectors hold, behind the planner's numbers in `move`, those of a free form."""

    tie: Tie

    def walk(self, vector: Float[Array, "parameter"], site: Site, choice: Choices, setting: Setting) -> Walk:
        """The walk of one lane with its footholds chosen, then freed, and then lowered as far as its legs ask."""
        planner, free = self.planner(vector, setting), spread(self.tie, vector[len(self.move) :])
        tall = dataclasses.replace(planner, posture=dataclasses.replace(planner.posture, lowering="none"))
        walk = build_walk(tall, self.robot, site, stations(planner, CYCLES), aside(choice, free))
        walk = freed(walk, free)
        phases, poses, lowering = lowered(planner, self.robot, SHAPE, walk.phases, walk.poses)
        return dataclasses.replace(walk, phases=phases, poses=poses, lowering=lowering)

    @property
    def bounds(self) -> np.ndarray:
        """Bounds (number, 2) of the free form's numbers."""
        names = names_of(self.tie)
        leg = np.where(np.isin(names, LENGTHS), float(leg_length(self.robot)), 1.0)
        return np.array([SPANS[name] for name in names]) * leg[:, None]


def free_lab(lab: Lab, halves: int | None = 1, mirrored: bool = True, **changes: Any) -> FreeLab:
    """A lab's free form of paper A's crawl: alike, or `mirrored`, after so many half cycles (None: never)."""
    phases = int(np.flatnonzero(SHAPE.leg == SHIFT)[1])  # of a half cycle
    ties = tie(tuple(SHAPE.leg.tolist()), CYCLES + 1, halves and halves * phases, mirrored)
    numbers = {field.name: getattr(lab, field.name) for field in dataclasses.fields(lab)}
    return FreeLab(**numbers | {"move": (), "rows": ROWS} | changes, tie=ties)
