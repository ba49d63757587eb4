"""Where do gradients pay? A free form's many numbers by our descent and by CMA-ES on the same proxy, on level ground.

From the quickstart's best gait, a half cycle's form with its mirror image, and every half cycle's own. CMA-ES has the library's
own population, a twentieth of the bounds as its width and three seeds, all fixed before the first run, and is stopped at 20
times our warm time; told is how long it takes to within 1 % of our answer, where it ends, and else what it has come to.

    python -m experiments.free_rivals [--quick] [--run runs/quickstart]
"""

import contextlib
import time
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from experiments import rivals
from experiments.common import setup, write
from experiments.free_form import FORMS, Task, descended, found, make_task, widened
from jaxleg.search.contestants import bounds
from jaxleg.search.free import FreeLab, free_lab

WITHIN, STOPPED = 1.01, 20.0  # times our objective; times our warm time
SIGMA, SEEDS, STEPS = 0.05, 3, 60


def main(out: Path | None = None, run: Path | None = None, quick: bool = False) -> None:
    """Both forms; `quick` takes the mirrored one, one seed, few steps, and begins with the paper's own gait."""
    study, lab = setup()
    best = None if quick else found(run or Path("runs/quickstart"))
    result: dict[str, Any] = {"quick": quick, "stopped": STOPPED, "forms": {}}
    for name in list(FORMS)[:1] if quick else FORMS:
        freed = free_lab(lab, *FORMS[name], move=study.search.move, chunk=4)
        task = make_task(study, freed, "flat", best, 1, 3 if quick else STEPS)
        result["forms"][name] = compared(task, freed, 1 if quick else SEEDS, 1.0 if quick else STOPPED)
        print(name, result["forms"][name], flush=True)
        write("free_rivals", out, result)


def compared(task: Task, lab: FreeLab, seeds: int, stopped: float) -> dict[str, Any]:
    """Our descent, cold and warm, and CMA-ES's runs."""
    objective, begin = rivals.by_proxy(lab, task.train), widened(lab, task.start)
    seconds = []
    for _ in range(2):
        began = time.perf_counter()
        answer = descended(task, lab, begin, free=True)
        seconds.append(time.perf_counter() - began)
    value = float(objective(answer[None])[0])
    box = np.concatenate([bounds(task.study, task.kind, "best"), lab.bounds])
    runs = [evolved(box, begin, seed, objective, WITHIN * value, stopped * seconds[1]) for seed in range(seeds)]
    return {"numbers": len(box), "value": value, "cold": seconds[0], "warm": seconds[1], "cmaes": runs}


def evolved(
    box: np.ndarray, begin: np.ndarray, seed: int, objective: rivals.Objective, target: float, limit: float
) -> dict[str, Any]:
    """Seconds until a run of CMA-ES is at the target (None: never), and its objective there or at the limit."""
    began, seen = time.perf_counter(), []

    def judge(vectors: np.ndarray) -> np.ndarray:
        values = objective(vectors.astype(np.float32))
        seen.append((time.perf_counter() - began, float(values.min())))
        return values

    def tell(vector: np.ndarray) -> None:
        if time.perf_counter() - began > limit or min(value for _, value in seen) <= target:
            raise rivals.TimeUp

    with contextlib.suppress(rivals.TimeUp):
        rivals.evolve_in(box, begin, (SIGMA, None, seed), judge, tell)
    there = [wall for wall, value in seen if value <= target]
    return {"seconds": there[0] if there else None, "value": min(value for _, value in seen), "limit": limit}


if __name__ == "__main__":
    tyro.cli(main)
