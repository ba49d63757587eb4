"""Descents that know their corners: several runs in lock step, each in a box, by ask and tell.

Each step goes to the lowest point of a convex model within a trust region: the costs' curvature (BFGS, damped as Powell does)
and, exactly, the least of the constraints' straight lines: the Gauss-Newton (prox-linear) method for h(c(x)) with convex h
(Lewis & Wright 2016, A proximal method for composite minimization), with a trust region. `bench_search` times it.
"""

from typing import NamedTuple

import jax
import numpy as np

from jaxleg.search.config import Span
from jaxleg.search.convex import Corners, Problem, lowest
from jaxleg.search.model import Model
from jaxleg.search.penalty import fine

FIRST, AGAIN, MOST, LAST = 0.2, 0.05, 0.5, 1e-3  # radius of the trust region, in widths of the numbers' ranges
WORTH = 1e-4  # gain that a step must promise, of a baseline's energy
FLAT = 0.1  # curvature of the cost at first
FAILED = 10.0  # baselines' energies that a lane costs which cannot be judged


class Runs(NamedTuple):
    """Where all runs stand; arrays only, saved at every checkpoint. Numbers are in widths of their ranges."""

    at: np.ndarray  # (run, number) best so far
    value: np.ndarray  # (run,) objective there, on the lanes of the last step
    radius: np.ndarray  # (run,) of the trust region
    reach: np.ndarray  # (run,) within which the model there knows the rows that may come lowest
    curvature: np.ndarray  # (run, number, number) of the cost
    steps: np.ndarray  # (), done so far
    ended: np.ndarray  # (), whether all have


class Judged(NamedTuple):
    """The objective of one run's vector over its lanes, and its model there."""

    value: float
    slope: np.ndarray  # (number,) of the cost
    rows: np.ndarray  # (constraint, row), of all lanes; these and their slopes in the model's precision
    slopes: np.ndarray  # (constraint, row, number)
    weight: np.ndarray  # (constraint,) of its lane in the objective


def begin(at: np.ndarray) -> Runs:
    """Runs that begin at these points (run, number)."""
    runs, numbers = at.shape
    curvature = np.tile(FLAT * np.eye(numbers), (runs, 1, 1))
    return _started(at.astype(float), np.full(runs, FIRST), curvature, np.zeros((), np.int32))


def on_others(runs: Runs, pick: np.ndarray) -> Runs:
    """Some of the runs, or some several times, that go on with other lanes."""
    return _started(runs.at[pick], np.maximum(runs.radius[pick], AGAIN), runs.curvature[pick], runs.steps)


def _started(at, radius, curvature, steps):
    return Runs(at, np.full(len(at), np.inf), radius, 2.0 * radius, curvature, steps, np.zeros((), bool))


def judged(model: Model, width: np.ndarray, counted: Span = (0.0, 1.0)) -> Judged:
    """One run's lanes (leading axis) as one model in widths, of those that are `counted` (`counts`). A lane that cannot be
    judged costs `FAILED` and has no slope."""
    usable = np.isfinite(model.cost) & np.isfinite(model.slope).all(axis=1)
    usable &= np.isfinite(model.rows).all(axis=(1, 2)) & np.isfinite(model.slopes).all(axis=(1, 2, 3))
    with np.errstate(invalid="ignore"):
        cost = np.asarray(model.cost, float) + fine(np.maximum(-np.asarray(model.rows, float).min(axis=2), 0.0)).sum(axis=1)
    cost = np.where(usable, cost, FAILED)
    weight = counts(cost, counted)
    kept = usable & (weight > 0.0)
    slope, rows, slopes = (np.asarray(x)[kept] for x in model[2:])
    flat = rows.reshape(-1, rows.shape[-1]), slopes.reshape(-1, *slopes.shape[2:]) * width.astype(slopes.dtype)
    slope = weight[kept] @ slope.astype(float) * width
    return Judged(float(weight @ cost), slope, *flat, np.repeat(weight[kept], rows.shape[1]))


def counts(cost: np.ndarray, counted: Span) -> np.ndarray:
    """Weight of each lane in the objective: its part of the shares (from, to) of all lanes, in the order of their cost.

    (0, 1) is the mean, (0.9, 1) the mean of the dearest tenth (CVaR; Rockafellar & Uryasev 2000), (0, 0.99) leaves out the
    dearest hundredth: so many may fail. Which lanes these are is held in a model, as is which foothold is chosen.
    """
    low, high = counted
    place = np.argsort(np.argsort(cost, kind="stable")) / len(cost)
    inside = np.minimum(place + 1.0 / len(cost), high) - np.maximum(place, low)
    return np.maximum(inside, 0.0) / (high - low)


class Descents:
    """All runs, each within its box (run, number, 2), in widths: `ask` for vectors, `tell` how they were judged.

    The first `ask` is for the points where the runs stand, also of runs that go on from a checkpoint.
    """

    def __init__(self, runs: Runs, box: np.ndarray) -> None:
        self.runs, self.box, self.asked = runs, box, False
        self.known: dict[int, Judged] = {}
        self.tried, self.promised = runs.at.copy(), np.full(len(runs.at), np.inf)

    def ask(self) -> dict[int, np.ndarray]:
        """The vectors (number,) that want judging next, by run; a run that gains no more has ended and asks for none."""
        for run in np.flatnonzero(self._going()).tolist() if self.asked else ():
            self.tried[run], self.promised[run] = self._trial(run)
        return {run: self.tried[run] for run in np.flatnonzero(self._going()).tolist()}

    @property
    def reach(self) -> np.ndarray:
        """How far (run,) from what was asked a model must hold: as far as a step may go next."""
        return 2.0 * self.runs.radius if self.asked else self.runs.reach

    def _going(self) -> np.ndarray:
        """Whether each run may still gain something."""
        return (self.runs.radius > LAST) & (self.promised > WORTH)

    def tell(self, seen: dict[int, Judged]) -> None:
        """Judgements of what was asked, by run."""
        runs = self.runs = jax.tree.map(np.array, self.runs)
        runs.steps[...] += self.asked and len(seen) > 0
        self.asked = True
        for run, there in seen.items():
            if run in self.known:
                self._compare(run, self.known[run], there)
            else:
                self.known[run], runs.value[run] = there, there.value

    def _trial(self, run: int) -> tuple[np.ndarray, float]:
        """The lowest point of a run's model within box and trust region, and the gain that it promises."""
        here, at, radius = self.known[run], self.runs.at[run], self.runs.radius[run]
        low, high = np.maximum(self.box[run, :, 0] - at, -radius), np.minimum(self.box[run, :, 1] - at, radius)
        free = high > low
        if not free.any():
            return at, 0.0
        problem = Problem(here.slope[free], self.runs.curvature[run][np.ix_(free, free)], _binding(here, free, radius))
        step = np.zeros_like(at)
        step[free] = lowest(problem, np.minimum(low[free], 0.0), np.maximum(high[free], 0.0))
        return np.clip(at + step, *self.box[run].T), -problem.value(step[free])

    def _compare(self, run: int, here: Judged, there: Judged) -> None:
        """Go there if it is worth it, and learn from it."""
        runs, step, reach = self.runs, self.tried[run] - self.runs.at[run], self.reach[run]
        gain, length = here.value - there.value, np.max(np.abs(step))
        if there.value < FAILED:  # beyond reach slopes say nothing
            runs.curvature[run] = bent(runs.curvature[run], step, there.slope - here.slope)
        if gain > 0.5 * self.promised[run] and length > 0.8 * runs.radius[run]:
            runs.radius[run] = min(2.0 * runs.radius[run], MOST)
        if gain > 0.1 * self.promised[run]:
            runs.at[run], runs.value[run], runs.reach[run], self.known[run] = self.tried[run], there.value, reach, there
        else:
            runs.radius[run] = 0.4 * min(runs.radius[run], length)


def _binding(here: Judged, free: np.ndarray, radius: float) -> list[Corners]:
    """The constraints that may bind within the radius, of each its rows that may be the least there (or a few more, so that
    there are few groups), by the free numbers."""
    change = radius * np.sum(np.abs(here.slopes[..., free]), axis=2)
    lowest, highest = here.rows - change, here.rows + change
    binds = np.flatnonzero(np.any(lowest < 0.0, axis=1))
    needed = np.sum(lowest[binds] <= highest[binds].min(axis=1, keepdims=True, initial=np.inf), axis=1)
    groups, slopes = np.ceil(np.log2(needed)).astype(int), here.slopes[..., free]
    corners = []
    for group in np.unique(groups):
        which = binds[groups == group]
        row = np.argsort(lowest[which], axis=1)[:, : 2**group]
        rows = (x[which[:, None], row].astype(float) for x in (here.rows, slopes))
        corners.append(Corners(*rows, here.weight[which]))
    return corners


def bent(curvature: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """BFGS's update of a curvature by a step and the change of slope along it, damped to stay positive (Powell 1978)."""
    pushed = curvature @ step
    before, seen = step @ pushed, step @ change
    if before < 1e-12:
        return curvature
    share = 1.0 if seen >= 0.2 * before else 0.8 * before / (before - seen)
    change = share * change + (1.0 - share) * pushed
    return curvature - np.outer(pushed, pushed) / before + np.outer(change, change) / (step @ change)
