"""One run of a study: what its stages share, what they remember in the run folder, and where they report progress."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxleg.robot import Robot
from jaxleg.search.config import Study
from jaxleg.search.lanes import Lab
from jaxleg.search.run_folder import RunFolder
from jaxleg.sim.contact import Ground

Report = Callable[[float, str], None]  # where progress goes: units of work done, and a line on what is going on


def make_lab(study: Study, robot: Robot, programs: Path | None = None) -> Lab:
    """The lab of a study: everything its lanes share; its programs are kept in a folder, if one is named."""
    sim = study.simulation
    return Lab(
        robot=robot,
        move=study.search.move,
        ground=Ground(friction=sim.friction),
        samples=(sim.shift_samples, sim.swing_samples),
        steps=sim.steps,
        chunk=sim.chunk,
        convention=study.power,
        terms=sim.engine,
        counted=study.search.counted,
        programs=programs,
    )


@dataclasses.dataclass
class Run:
    """One run of a study: its settings, what its lanes share, its folder and what is shared between the stages."""

    study: Study
    lab: Lab
    folder: RunFolder
    report: Report

    def __post_init__(self) -> None:
        self.robot = self.lab.robot
        self.kinds = tuple(self.study.kinds)
        self.seconds: dict[str, float] = {}
        self.trained: dict[str, int] = {}  # distinct training terrains by kind
        self.done = 0.0

    def tell(self, units: float, text: str) -> None:
        """Report progress by so many units of work."""
        self.done += units
        self.report(self.done, text)

    def remember(self, stage: str, like: Any, compute: Callable[[], Any]) -> Any:
        """The stage's answer from the run folder, or computed now and saved there; of `like`'s types either way.

        Without that a gradient in float32 times a width in float64 would be saved as what no resume can read.
        """
        saved = self.folder.load(stage, like)
        if saved is None:
            saved = jax.tree.map(lambda x, wanted: np.asarray(x, wanted.dtype), compute(), like)
            self.folder.save(stage, saved)
        return saved

    def clock(self, stage: str, began: float) -> None:
        """Add the seconds since `began` to a stage's time."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - began
