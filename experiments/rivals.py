"""Ways to search the gait's ten numbers on one kind of terrain, each telling what it holds for best and when.

`ours` is the search of the command line (`best` alone); the others are what one would use instead, their settings fixed before
the first run: CMA-ES (the library `cmaes`) on our own proxy and over C MuJoCo's rollouts of our plans, and random search on the
proxy. All judge a vector alike, by energy over the traditional gait's and what it violates; only where the energy comes from
differs.
"""

import contextlib
import json
import pickle
import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from cmaes import CMA

from experiments.common import setup
from jaxleg.batch import over_lanes
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search import descent
from jaxleg.search.config import Study
from jaxleg.search.contestants import baseline, bounds
from jaxleg.search.gauss_newton import FAILED, Runs
from jaxleg.search.lanes import SCALES, Lab
from jaxleg.search.penalty import fine
from jaxleg.search.referees import replay_contest
from jaxleg.search.stages import judge
from jaxleg.search.training import Lanes, spread

POPULATION, SIGMA = 12, 0.2  # of CMA-ES; its width in those of the bounds, about the paper's own gait
REPLAYED = 32  # terrains a candidate over C MuJoCo: with few it fits them alone
Tell = Callable[[np.ndarray], None]
Objective = Callable[[np.ndarray], np.ndarray]  # (vector, number) -> (vector,)


class TimeUp(Exception):
    """The limit is reached."""


def run(method: str, kind: str, seeds: int, limits: tuple[float, float], lanes_file: str, out: str, born: float) -> None:
    """Search once cold, from when this process was `born`, then `seeds` times warm, each for at most as many seconds as its
    limit (cold, warm) once all is loaded. Writes rows of (wall and CPU seconds, vector) a run."""
    began = time.perf_counter() - (time.time() - born), 0.0
    study, lab = setup()
    lanes, traces = pickle.loads(Path(lanes_file).read_bytes()), []
    for seed in range(seeds + 1):
        trace, ready = [], time.perf_counter()

        def tell(vector: np.ndarray) -> None:
            trace.append((time.perf_counter() - began[0], time.process_time() - began[1], vector.tolist()))  # noqa: B023
            if time.perf_counter() - ready > limits[seed > 0]:  # noqa: B023
                raise TimeUp

        with contextlib.suppress(TimeUp):
            METHODS[method](study, lab, lanes, kind, seed, tell)
        traces.append(trace)
        began = time.perf_counter(), time.process_time()
    Path(out).write_text(json.dumps(traces))


def ours(study: Study, lab: Lab, lanes: Lanes, kind: str, seed: int, tell: Tell) -> None:
    """The descents of the command line's search that moves everything, from its starts."""
    span, search = descent.ranges(bounds(study, kind, "best")[None]), study.search
    known = np.stack([baseline(study, kind, name) for name in ("traditional", "paper")])
    points = descent.starts_of(jax.random.key(seed), known, span, search.starts)
    plan = descent.rounds(lanes.number, search.lanes, search.starts)
    descent.searched(lab, lanes, span, points, plan, search.steps, Told(span, tell))


class Told(descent.Keep):
    """Tells the best run's vector of every step."""

    def __init__(self, span: descent.Ranges, tell: Tell) -> None:
        self.span, self.tell = span, tell

    def report(self, number: int, terrains: int, runs: Runs) -> None:
        """The best of this step."""
        self.tell(self.span.vectors(runs.at[runs.value.argmin()]))


def cmaes_proxy(study: Study, lab: Lab, lanes: Lanes, kind: str, seed: int, tell: Tell) -> None:
    """CMA-ES on the proxy, over all training terrains."""
    evolve(study, kind, seed, by_proxy(lab, lanes), tell)


def cmaes_mujoco(study: Study, lab: Lab, lanes: Lanes, kind: str, seed: int, tell: Tell) -> None:
    """CMA-ES over C MuJoCo's replays of our plans."""
    evolve(study, kind, seed, by_mujoco(lab, spread(lanes, REPLAYED)), tell)


def random_proxy(study: Study, lab: Lab, lanes: Lanes, kind: str, seed: int, tell: Tell) -> None:
    """Vectors drawn evenly from the bounds, judged by the proxy."""
    low, high = bounds(study, kind, "best").T
    draw, objective, best = np.random.default_rng(seed), by_proxy(lab, lanes), np.inf
    while True:
        some = draw.uniform(low, high, (POPULATION, len(low)))
        values = objective(some)
        if values.min() < best:
            best = values.min()
            tell(some[values.argmin()])
        else:
            tell(some[0] * np.nan)  # nothing new, but time passes


METHODS = {"ours": ours, "cmaes_proxy": cmaes_proxy, "cmaes_mujoco": cmaes_mujoco, "random_proxy": random_proxy}


def evolve(study: Study, kind: str, seed: int, objective: Objective, tell: Tell) -> None:
    """CMA-ES within the bounds, from the paper's own gait, until `tell` has enough."""
    evolve_in(bounds(study, kind, "best"), baseline(study, kind, "paper"), (SIGMA, POPULATION, seed), objective, tell)


def evolve_in(box: np.ndarray, start: np.ndarray, how: tuple[float, int | None, int], objective: Objective, tell: Tell) -> None:
    """CMA-ES in a box (number, 2) from a vector; `how` its width in those of the box, its population (None: the library's
    own) and its seed."""
    (low, high), (sigma, population, seed) = box.T, how
    mean = np.clip((start - low) / (high - low), 0.05, 0.95)
    inside = np.tile([0.0, 1.0], (len(low), 1))
    search = CMA(mean=mean, sigma=sigma, bounds=inside, seed=seed + 1, population_size=population)
    best = np.inf
    while not search.should_stop():
        asked = [search.ask() for _ in range(search.population_size)]
        values = objective(low + (high - low) * np.stack(asked))
        search.tell(list(zip(asked, values.tolist())))
        better = values.min() < best
        best = min(best, values.min())
        tell(low + (high - low) * asked[values.argmin()] if better else low * np.nan)


def by_proxy(lab: Lab, lanes: Lanes) -> Objective:
    """The mean objective over the lanes by the proxy alone, without gradient; traced once a lab."""

    def lane(vector, site, setting):
        return lab.proxy(vector, site, lab.choose(vector, site, setting), setting).objective

    value = vars(lab).setdefault("proxy_alone", over_lanes(lane, lab.chunk))
    return lambda vectors: judge(value, vectors, lanes)


def by_mujoco(lab: Lab, lanes: Lanes) -> Objective:
    """The mean objective over the lanes with C MuJoCo's energy; a fall counts as what cannot be judged."""

    def value(vectors, site, setting):
        seen = replay_contest(lab, np.asarray(vectors), Lanes(site, setting), 1)
        lack = np.maximum(-seen.slack[0] / SCALES, 0.0)
        energy = seen.energy[0][:, CONVENTIONS.index(lab.convention)] / np.asarray(setting.energy)
        return np.where(seen.fell[0], FAILED, energy + fine(lack).sum(axis=1))

    return lambda vectors: judge(value, vectors, lanes)
