"""The search of a study, stage by stage: descents on the proxy, then, if wanted, a polish in simulation."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.search.config import Span, Study
from jaxleg.search.contestants import STAGES, baseline, bounds
from jaxleg.search.descent import Keep, ranges, rounds, searched, starts_of
from jaxleg.search.gauss_newton import FAILED, Runs, counts
from jaxleg.search.lanes import Lab
from jaxleg.search.run import Run
from jaxleg.search.sites import share
from jaxleg.search.training import Lanes, pooled, spread

STEP_UNITS, POLISH_UNITS = 1.0, 30.0  # of work: a step of the descents, a polish


def work(study: Study) -> float:
    """Units of work of a whole study, about a second each: what `Report` counts up to."""
    groups = [tuple(study.kinds)] if study.one_for_all else [(kind,) for kind in study.kinds]
    of_groups = sum(descent_units(study, group) + POLISH_UNITS * (study.search.polish_steps > 0) for group in groups)
    return of_groups + (18.0 + 16.0 * (study.randomise.lanes > 0)) * len(study.kinds) + 10.0


def descent_units(study: Study, group: tuple[str, ...]) -> float:
    """Units of work of a group's descents: the most steps of all rounds, on as many terrains as the study asks for."""
    kinds, search = list(study.kinds), study.search
    terrains = sum(share(study.terrains.train, len(kinds), kinds.index(kind)) for kind in group)
    return STEP_UNITS * search.steps * len(rounds(terrains, search.lanes, search.starts))


class InFolder(Keep):
    """A group's search, kept in the run folder round by round and told of step by step."""

    def __init__(self, state: Run, name: str) -> None:
        self.state, self.name, self.began = state, name, time.perf_counter()

    def load(self, number: int, like: Runs) -> Runs | None:
        """Where round `number` stands, if it was begun before."""
        return self.state.folder.load(f"{self.name}/descent_{number}", like)

    def save(self, number: int, runs: Runs) -> None:
        """Keep where a round stands."""
        self.state.folder.save(f"{self.name}/descent_{number}", runs)

    def report(self, number: int, terrains: int, runs: Runs) -> None:
        """A row of the history for each search, and a line of progress."""
        about = {"kind": self.name, "terrains": terrains, "step": int(runs.steps)}
        for stage, values in zip(STAGES, runs.value.reshape(len(STAGES), -1)):
            row = about | {"stage": stage, "best": float(values.min()), "mean": float(values.mean())}
            self.state.folder.append_history(row | {"seconds": round(time.perf_counter() - self.began, 3)})
        on = f"{terrains} terrain{'s' * (terrains > 1)}"
        text = f"{self.name}: step {int(runs.steps)} on {on}, best {runs.value.min():.3f} of the baseline"
        self.state.tell(STEP_UNITS, text)


def search_group(state: Run, group: tuple[str, ...], training: dict[str, Lanes]) -> np.ndarray:
    """Descend on the proxy, all three searches at once; returns the best of each (stage, parameter)."""
    began, study, search = time.perf_counter(), state.study, state.study.search
    name, lanes = "+".join(group), pooled(training, group)
    span = ranges(np.stack([bounds(study, group[0], stage) for stage in STAGES]))
    known = np.stack([baseline(study, group[0], c) for c in ("traditional", "paper")])
    key = jax.random.fold_in(jax.random.key(study.seed), 100 + state.kinds.index(group[0]))
    points = starts_of(key, known, span, search.starts)
    plan, ahead = rounds(lanes.number, search.lanes, search.starts), state.done + descent_units(study, group)
    best, _ = searched(state.lab, lanes, span, points, plan, search.steps, InFolder(state, name))
    state.clock("descent", began)
    state.tell(ahead - state.done, f"{name}: searched")
    return best


def polish(state: Run, group: tuple[str, ...], training: dict[str, Lanes], best: np.ndarray) -> np.ndarray:
    """Improve the last search's answer by gradients of the simulation itself; a step that does not help is halved."""
    began, study, search = time.perf_counter(), state.study, state.study.search
    if not search.polish_steps:
        return best
    lanes = spread(pooled(training, group), search.polish_lanes)
    low, high = bounds(study, group[0], STAGES[-1]).T

    def compute() -> np.ndarray:
        """All searches' answers, the last one's after its steps downhill."""
        kept, rate = best[-1], search.polish_rate
        value, gradient = simulated_gradient(state.lab, kept, lanes)
        for step in range(search.polish_steps):
            slope = gradient * (high - low)
            trial = np.clip(kept - rate * (high - low) * slope / max(float(np.linalg.norm(slope)), 1e-12), low, high)
            new_value = judge(lambda *x: simulated_objective(state.lab, *x), trial[None], lanes, state.lab.counted)[0]
            better = new_value < value
            kept, value, rate = (trial, new_value, rate) if better else (kept, value, 0.5 * rate)
            if better and step + 1 < search.polish_steps:
                _, gradient = simulated_gradient(state.lab, kept, lanes)
        return np.concatenate([best[:-1], kept[None]])

    best = state.remember(f"{'+'.join(group)}/polished", np.zeros_like(best), compute)
    state.clock("polish", began)
    state.tell(POLISH_UNITS, f"{'+'.join(group)}: polished with the simulation's gradients")
    return best


def judge(objective: Callable[..., np.ndarray], vectors: np.ndarray, lanes: Lanes, counted: Span = (0.0, 1.0)) -> np.ndarray:
    """Mean objective of each vector over the lanes that are `counted` (`gauss_newton.counts`); a lane that cannot be judged
    costs ten times the baseline."""
    rows = jnp.asarray(np.repeat(vectors, lanes.number, axis=0), float)
    many = lanes.take(np.tile(np.arange(lanes.number), len(vectors)))
    values = objective(rows, many.site, many.setting).reshape(len(vectors), -1)
    values = np.where(np.isfinite(values), values, FAILED)
    return np.array([counts(row, counted) @ row for row in values])


def simulated_objective(lab: Lab, *lanes: Any) -> np.ndarray:
    """Objective of each lane in simulation; not finite for a fallen one."""
    score, meters = lab.simulate_lanes(*lanes)
    return np.where(meters.fell, np.inf, score.objective)


def simulated_gradient(lab: Lab, vector: np.ndarray, lanes: Lanes) -> tuple[float, np.ndarray]:
    """Mean objective and gradient of one vector over the lanes that count, in simulation; those without a finite gradient
    stay out of it."""
    rows = jnp.asarray(np.tile(vector, (lanes.number, 1)), float)
    score, meters, gradient = lab.simulate_gradients(rows, lanes.site, lanes.setting)
    usable = ~meters.fell & np.isfinite(gradient).all(axis=1)
    value = np.where(usable, score.objective, FAILED)
    weight = counts(value, lab.counted)
    return float(weight @ value), weight @ np.where(usable[:, None], gradient, 0.0)
