"""Does a polish by the simulation's own gradients save anything on top of a search on the proxy?

The best gait of a finished quickstart, and what the polish of `search.polish_steps` makes of it on the same training terrains,
walk on the held-out ones in simulation. A polish is worth having where the interval of what it saves excludes zero.

    python -m experiments.polish [--run runs/quickstart] [--steps 5] [--quick]
"""

import dataclasses
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from experiments.check_saving import finished
from experiments.common import training, write
from experiments.randomised import answers
from jaxleg.cli.start import configure_jax
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.robot import RobotFile, build_robot
from jaxleg.search.config import Study, robot_path
from jaxleg.search.contest import Contest, contest, failures, saving
from jaxleg.search.run import Run, make_lab
from jaxleg.search.run_folder import RunFolder
from jaxleg.search.stages import polish
from jaxleg.search.training import training_lanes
from jaxleg.settings import load


def main(run: Path = Path("runs/quickstart"), steps: int = 5, out: Path | None = None, quick: bool = False) -> None:
    """Polish by so many steps (1 with `quick`, on two terrains) and compare."""
    configure_jax()
    result, study = finished(run / "result.json"), load(Study, run / "config.toml")
    search = dataclasses.replace(study.search, polish_steps=1 if quick else steps, polish_lanes=2 if quick else 32)
    study, robot = dataclasses.replace(study, search=search), load(RobotFile, robot_path(study, run / "config.toml"))
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = RunFolder.open(Path(name) / "run", {"config": study, "robot": robot}, resume=False)
        try:
            state = Run(study, make_lab(study, build_robot(robot)), folder, lambda *_: None)
            for kind, best in answers(study, result).items():
                rows.append({"kind": kind} | row(state, kind, best))
                tell(rows[-1], study.power)
        finally:
            folder.close()
    write("polish", out, {"quick": quick, "steps": search.polish_steps, "terrains": search.polish_lanes, "rows": rows})


def row(state: Run, kind: str, best: np.ndarray) -> dict[str, Any]:
    """A kind's best gait before and after, and what the polish saves on held-out terrains."""
    lanes, began = training_lanes(state, kind), time.perf_counter()
    after = polish(state, (kind,), {kind: lanes}, best)[-1]
    seconds = time.perf_counter() - began
    held = training(state.study, state.lab, kind, held_out=True)
    many = held.take(np.tile(np.arange(held.number), 2))
    vectors = np.float32(np.repeat(np.stack([best[-1], after]), held.number, axis=0))
    walked = state.lab.simulate_lanes(vectors, many.site, many.setting)
    seen = contest(*walked, np.asarray(many.setting.least_bend), 2)
    return compared(state.study, seen) | {"seconds": seconds, "vectors": vectors[:: held.number], "lanes": held.number}


def compared(study: Study, seen: Contest) -> dict[str, Any]:
    """What the second contestant saves of the first's energy, and failures of both."""
    both = seen.usable.all(axis=0)
    saved = {
        name: saving(seen.energy[1, both, i], seen.energy[0, both, i], study.search.resamples, study.seed)
        for i, name in enumerate(CONVENTIONS)
    }
    margin = [float(seen.margin[i, both].min()) for i in range(2)]
    return {"saving": saved, "failures": [failures(seen, i) for i in range(2)], "least_margin": margin}


def tell(row: dict[str, Any], power: str) -> None:
    """Print a row."""
    saved = row["saving"][power]
    low, high = saved["ci95"] or (float("nan"),) * 2
    print(f"{row['kind']}: a polish of {row['seconds']:.0f} s saves {100 * saved['mean']:.2f} %", end=" ")
    print(f"({100 * low:.2f} to {100 * high:.2f}) on {row['lanes']} held-out terrains;", end=" ")
    print(f"least margin {row['least_margin']} m, failures {row['failures']}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
