"""Stand-ins for what a search is made of, so that its steps can be tried on numbers known in closed form."""

from typing import Any

from jaxleg.search.config import Study
from jaxleg.search.lanes import Lab
from jaxleg.search.run import Run


class StandInLab(Lab):
    """A lab without a robot: what it is asked is what a test puts in."""

    def __init__(self, **functions: Any) -> None:
        self.__dict__.update(functions)


class StandInRun(Run):
    """A run without a folder: every stage is computed, none saved."""

    def __init__(self, study: Study, lab: Lab, robot: Any = None) -> None:
        self.study, self.lab, self.robot, self.kinds, self.done = study, lab, robot, tuple(study.kinds), 0.0

    def remember(self, stage, like, compute):
        """The answer, computed."""
        return compute()

    def clock(self, stage, began):
        """No time is kept."""

    def tell(self, units, text):
        """Nobody listens."""
