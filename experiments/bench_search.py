"""How soon does the search come to its own optimum, against what one would use instead? See `rivals`.

For each kind of terrain the target is 1.01 times what C MuJoCo says of the default search's answer on other terrains (energy
over the traditional gait's, and violations); of each rival the time until what it holds for best is as good. Cold: a new
process with an empty cache, compilation counted; warm: again in the same process, other seeds (two on ground of many terrains).
A rival is stopped at 50 times our median warm time, in its cold run not before 6 times our cold one; one that did not get there
counts as that.

    python -m experiments.bench_search [--quick] [--kinds flat] [--seeds 5]
"""

import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from matplotlib.figure import Figure

from experiments import rivals
from experiments.common import setup, write
from experiments.searching import judged_lanes
from jaxleg.search.config import Study
from jaxleg.search.lanes import Lab
from jaxleg.search.training import Lanes, spread
from jaxleg.viz.style import WIDTH, label, legend_below, save

WITHIN, STOPPED, COLD = 1.01, 50.0, 6.0  # times our refereed energy; times our warm time, times our cold one
HELD = 8  # terrains of the referee
RIVALS = tuple(rivals.METHODS)[1:]


def main(
    kinds: tuple[str, ...] = ("flat", "rough", "stairs"), seeds: int = 5, out: Path | None = None, quick: bool = False
) -> None:
    """Time all ways on each kind; `quick` takes flat ground, one seed, and stops rivals at twice our time."""
    folder = out or Path("runs/bench_search")
    study, lab = setup()
    result = {"quick": quick, "seeds": seeds}
    for kind in ("flat",) if quick else kinds:
        few = 1 if quick else seeds if kind == "flat" else min(seeds, 2)
        result[kind] = compared(study, lab, kind, few, 2.0 if quick else STOPPED)
        write("bench_search", out, result)
        draw({name: row for name, row in result.items() if isinstance(row, dict)}, folder / "search.png")


def compared(study: Study, lab: Lab, kind: str, seeds: int, stopped: float) -> dict[str, Any]:
    """All ways on one kind."""
    lanes, others = judged_lanes(study, lab, kind), spread(judged_lanes(study, lab, kind, held_out=True), HELD)
    referee = rivals.by_mujoco(lab, others)
    traces = {"ours": traced("ours", kind, lanes, seeds, (1e9, 1e9))}
    values = {"ours": refereed(referee, traces["ours"])}
    target = WITHIN * float(np.median([run[-1][2] for run in values["ours"]]))
    cold, *warm = (first(run, target, np.inf)[0] for run in values["ours"])
    limit = stopped * float(np.median(warm))
    limits = max(limit, COLD * cold) if stopped == STOPPED else limit, limit
    for name in RIVALS if kind == "flat" else RIVALS[:2]:
        few = seeds if kind == "flat" or name == "cmaes_proxy" else 0
        few = min(few, 1) if name == "random_proxy" else few
        values[name] = refereed(referee, traced(name, kind, lanes, few, limits))
    rows = {name: told(runs, target, limits) for name, runs in values.items()}
    for name, row in rows.items():
        base = rows["ours"]
        row["times_ours"] = {
            "cold": {by: row["cold"][by] / base["cold"][by] for by in ("wall", "cpu")},
            "warm": {by: row["warm"][by]["median"] / base["warm"][by]["median"] for by in ("wall", "cpu")},
        }
        print(
            kind,
            name,
            row["cold"],
            row["warm"],
            row["times_ours"],
            f"{row['reached']} of {row['runs']}",
            row["end"],
            flush=True,
        )
    return {"target": target, "limits_s": limits, "terrains": lanes.number, "load": os.getloadavg()[0], "ways": rows}


def traced(
    method: str, kind: str, lanes: Lanes, seeds: int, limits: tuple[float, float]
) -> list[list[tuple[float, float, list[float]]]]:
    """What a way held for best and when, run by run, in a process of its own with an empty cache."""
    with tempfile.TemporaryDirectory() as name:
        file, answer = Path(name) / "lanes", Path(name) / "answer"
        file.write_bytes(pickle.dumps(lanes))
        asked = ", ".join(map(repr, (method, kind, seeds, limits, str(file), str(answer), time.time())))
        places = {"XDG_CACHE_HOME": name, "JAXLEG_CACHE": f"{name}/cache"}
        call = f"from experiments.rivals import run; run({asked})"
        subprocess.run([sys.executable, "-c", call], check=True, env=os.environ | places)
        return json.loads(answer.read_text())


def refereed(referee: rivals.Objective, traces: list) -> list[list[tuple[float, float, float]]]:
    """The same with what the referee says of each vector in its place; what is nothing new is as good as the one before."""
    seen, runs = {}, []
    for trace in traces:
        held, run = np.inf, []
        for wall, cpu, vector in trace:
            key = tuple(vector)
            if np.isfinite(vector).all():
                held = seen.setdefault(key, seen.get(key) or float(referee(np.array([vector]))[0]))
            run.append((wall, cpu, held))
        runs.append(run)
    return runs


def first(run: list, target: float, limit: float) -> tuple[float, float]:
    """Wall and CPU seconds until a run is as good as the target; the limit where it never is."""
    for wall, cpu, value in run:
        if value <= target:
            return wall, cpu
    return max(limit, run[-1][0]), max(limit, run[-1][1])


def told(runs: list, target: float, limits: tuple[float, float]) -> dict[str, Any]:
    """Times to the target and the best value of each run; the first run is the cold one."""
    times = [first(run, target, limits[number > 0]) for number, run in enumerate(runs)]
    warm = [{"wall": wall, "cpu": cpu} for wall, cpu in times[1:] or times]  # a way that takes minutes has no warm runs here
    return {
        "cold": {"wall": times[0][0], "cpu": times[0][1]},
        "warm": {by: spread_of([row[by] for row in warm]) for by in ("wall", "cpu")},
        "reached": sum(min(value for _, _, value in run) <= target for run in runs),
        "runs": len(runs),
        "end": spread_of([run[-1][2] for run in runs]),
        "curves": [
            [(round(wall, 2), round(value, 4)) for wall, _, value in run[:: max(1, len(run) // 40)]] for run in runs[1:] or runs
        ],
    }


def spread_of(values: list[float]) -> dict[str, float]:
    """Median, least and greatest."""
    return {"median": float(np.median(values)), "least": min(values), "greatest": max(values)}


def draw(kinds: dict[str, Any], path: Path) -> None:
    """What the referee says of the best so far against time, warm; a panel a kind."""
    figure, lines = Figure(figsize=(WIDTH, 3.8), layout="constrained"), {}
    axes = np.atleast_1d(figure.subplots(1, len(kinds)))
    for ax, (kind, row) in zip(axes, kinds.items()):
        for number, (name, way) in enumerate(row["ways"].items()):
            for curve in way["curves"]:
                wall, value = np.array(curve).T
                (lines[name],) = ax.step(wall, value, where="post", color=f"C{number}", lw=1.2, label=name.replace("_", ", "))
        ax.axhline(row["target"], color="0.5", lw=1.0, ls=":")
        label(ax, "wall time, warm [s]", "", kind)
        ax.set(xscale="log", ylim=(0.9 * row["target"], 1.6 * row["target"]))
    axes[0].set_ylabel("refereed objective / traditional's energy [-]")
    legend_below(figure, list(lines.values()), len(lines))
    save(figure, path)


if __name__ == "__main__":
    tyro.cli(main)
