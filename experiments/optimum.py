"""Does the search end where long runs of CMA-ES end? Ten numbers, the same proxy and lanes, on each kind of terrain.

The search from several seeds with its own settings, beside four runs of CMA-ES of 200 generations (`rivals`); what each ends
at is judged alike, by the proxy's objective over all training lanes.

    python -m experiments.optimum [--quick]
"""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from experiments import rivals
from experiments.common import setup, write
from experiments.searching import judged_lanes
from jaxleg.search.config import Study
from jaxleg.search.lanes import Lab
from jaxleg.search.training import Lanes

GENERATIONS = 200
Search = Callable[[int, rivals.Tell], None]  # of a seed


class LastOf:
    """Keeps the last vector told, and stops after so many tells."""

    def __init__(self, most: float = np.inf) -> None:
        self.vector, self.told, self.most = np.zeros(0), 0, most

    def __call__(self, vector: np.ndarray) -> None:
        self.told += 1
        if np.isfinite(vector).all():
            self.vector = vector
        if self.told >= self.most:
            raise rivals.TimeUp


def main(seeds: int = 5, long: int = 4, out: Path | None = None, quick: bool = False) -> None:
    """All kinds of the quickstart; `quick` takes flat ground, one seed and three generations."""
    study, lab = setup()
    seeds, long, generations = (1, 1, 3) if quick else (seeds, long, GENERATIONS)
    result: dict[str, Any] = {"quick": quick, "generations": generations}
    for kind in ("flat",) if quick else study.kinds:
        result[kind] = compared(study, lab, kind, judged_lanes(study, lab, kind), (seeds, long, generations))
        write("optimum", out, result)


def compared(study: Study, lab: Lab, kind: str, lanes: Lanes, size: tuple[int, int, int]) -> dict[str, Any]:
    """Where the search and the long runs end on one kind, and how far each of ours is above the best of theirs."""
    seeds, long, generations = size
    objective = rivals.by_proxy(lab, lanes)

    def ended(search: Search, most: float, runs: int) -> list[dict[str, Any]]:
        return [run_of(search, seed, most, objective) for seed in range(runs)]

    theirs = ended(lambda seed, tell: rivals.cmaes_proxy(study, lab, lanes, kind, seed, tell), generations, long)
    ours = ended(lambda seed, tell: rivals.ours(study, lab, lanes, kind, seed, tell), np.inf, seeds)
    best = min(run["value"] for run in theirs)
    above = [run["value"] / best - 1.0 for run in ours]
    print(kind, "above the best of theirs, %:", [round(100.0 * x, 2) for x in above])
    return {"terrains": lanes.number, "ours": ours, "cmaes": theirs, "above": above}


def run_of(search: Search, seed: int, most: float, objective: rivals.Objective) -> dict[str, Any]:
    """What a run ends at and the seconds it took; of the first of each kind, with compiling."""
    last, began, cpu = LastOf(most), time.perf_counter(), time.process_time()
    with contextlib.suppress(rivals.TimeUp):
        search(seed, last)
    wall, spent = time.perf_counter() - began, time.process_time() - cpu
    row = {"value": float(objective(last.vector[None])[0]), "steps": last.told, "wall": wall, "cpu": spent}
    print(row, last.vector.round(4).tolist(), flush=True)
    return row | {"vector": last.vector.tolist()}


if __name__ == "__main__":
    tyro.cli(main)
