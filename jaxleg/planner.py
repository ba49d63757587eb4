"""Planner: how a walk is planned, in six parts, each with several fillings.

    route x foothold x posture x series x timing x swing

    part        question                                 fillings
    route       where does the stance stand when         Straight (A), Along a body path (C)
    foothold    which cells does a foot propose          Cascade (A), Ranked by cost, hand-set or learned (C)
    posture     how does the trunk stand over the feet   Incentre (A), Plane (C)
    series      how far ahead is looked                  Greedy (A), Tree (C)
    timing      how long does a phase take               BySpeed (A), ByAcceleration (C)
    swing       how does a foot fly                      Cycloid (A, C), Taut string (B); the machine that feels (B) takes over
                                                         from either in simulation

Paper A is Straight x Cascade x Incentre x Greedy x BySpeed x Cycloid, paper C is Along x Ranked x Plane x Tree x ByAcceleration
x Cycloid (`walk.presets`); paper B's machine takes the place of a planned swing in any walk. A Planner is a pytree: its numbers
are leaves, its parts are structure, so lanes of two presets never share a `vmap`.

A plan is made in two stages (`choose`, `build_walk`). First the choices: exact, discrete, without a gradient. Then the walk
as a differentiable function of the planner's numbers, the robot's and the map's, with the choices held.
"""

from jaxtyping import Array, Float

from jaxleg.foothold.cascade import Cascade
from jaxleg.foothold.ranked import Ranked
from jaxleg.gait.params import GaitParams
from jaxleg.gait.timing import ByAcceleration, BySpeed
from jaxleg.posture.incentre import Incentre
from jaxleg.posture.plane import Plane
from jaxleg.pytree import pytree, static
from jaxleg.route.stations import Along, Straight
from jaxleg.series.kinds import Greedy, Tree
from jaxleg.swing.clearance import Cycloid
from jaxleg.swing.taut import Taut


@pytree
class Limits:
    """What every step of a walk must keep; every field a leaf."""

    knee_bend: Float[Array, "*batch"]  # least, of every knee [rad]
    margin: Float[Array, "*batch"]  # least stability margin [m]


@pytree
class Planner:
    """How a walk is planned; see above. `standing` walks begin and end standing, others in mid-gait."""

    gait: GaitParams
    route: Straight | Along
    foothold: Cascade | Ranked
    posture: Incentre | Plane
    series: Greedy | Tree
    timing: BySpeed | ByAcceleration
    swing: Cycloid | Taut
    limits: Limits
    standing: bool = static(False)

    @property
    def shared(self) -> bool:
        """Whether both swings of a side happen in one pose: a search step by step gives each its own."""
        return self.posture.shared and isinstance(self.series, Greedy)

    @property
    def tree(self) -> Tree:
        """The tree search's numbers. Raises TypeError for a planner that has none."""
        if not isinstance(self.series, Tree):
            raise TypeError(f"this planner's series is {type(self.series).__name__}, but must be Tree to be searched")
        return self.series
