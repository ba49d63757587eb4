"""Are the savings real? The quickstart's result, row by row against what it has to reach.

On held-out terrains in simulation, under each power convention, no falls, speed equal within 1 %: on flat ground (knee bend
>= 35 deg) (ii) saves >= 24 % and (iii) >= 40 % against `traditional`, (iii) >= 20 % against the paper's own parameters; on
8/30 stairs (iii) saves >= 20 % against `traditional`. C MuJoCo agrees in sign and within 30 % of the saving. `implied` stands
beside.

    python -m experiments.check_saving                     runs the quickstart search first
    python -m experiments.check_saving --run runs/quickstart     reads a finished run
"""

import json
import subprocess
import sys
from pathlib import Path

import tyro

from experiments.common import CONFIG, write
from jaxleg.leg.energy import CONVENTIONS

# terrain, searched contestant, baseline (its key in result.json), saving to reach
ROWS = (
    ("flat", "best_ii", "saving", 0.24),
    ("flat", "best", "saving", 0.40),
    ("flat", "best", "saving_vs_paper", 0.20),
    ("flat", "best", "saving_vs_implied", None),
    ("rough", "best", "saving", None),
    ("stairs", "best", "saving", 0.20),
    ("stairs", "best", "saving_vs_implied", None),
)
BASE = {"saving": "traditional", "saving_vs_paper": "paper", "saving_vs_implied": "implied"}


def main(run: Path | None = None, out: Path | None = None, quick: bool = False) -> bool:
    """Check every row; returns whether all with a target pass. `quick` reads runs/quickstart."""
    folder = run or Path("runs/quickstart")
    if run is None and not quick:
        subprocess.run([sys.executable, "-m", "jaxleg.cli", "search", str(CONFIG), "--out", str(folder)], check=True)
    result = finished(folder / "result.json")
    rows = [check(result, *row, convention) for row in ROWS for convention in CONVENTIONS]
    print(f"{'terrain':8s}{'contestant':12s}{'against':13s}{'power':10s}{'simulation':>12s}{'C MuJoCo':>10s}  verdict")
    for row in rows:
        saved = "".join(f"{100.0 * row[engine]:{size}.1f}" for engine, size in (("simulation", 12), ("mujoco", 10)))
        print(f"{row['kind']:8s}{row['contestant']:12s}{row['against']:13s}{row['power']:10s}{saved}  {row['verdict']}")
    write("check_saving", out, {"rows": rows})
    return all(row["verdict"] in ("", "pass") for row in rows)


def finished(path: Path) -> dict:
    """The result of a finished search; exit status 2 and a sentence for what is none."""
    try:
        result = json.loads(path.read_text())
        _ = result["saving"]["simulation"], result["saving"]["mujoco"]
    except (OSError, ValueError, LookupError, TypeError):
        print(f"{path}: is not the result of a finished search of this version; let --run name its run folder", file=sys.stderr)
        raise SystemExit(2) from None
    return result


def check(result: dict, kind: str, name: str, key: str, target: float | None, power: str) -> dict:
    """One row: the savings, and what falls short."""
    saved = {engine: result[key][engine][name][kind][power]["mean"] for engine in ("simulation", "mujoco")}
    ours, base = result[name][kind], result[BASE[key]][kind]
    row = {"kind": kind, "contestant": name, "against": BASE[key], "power": power}
    if None in saved.values():
        return row | dict.fromkeys(saved, float("nan")) | {"verdict": "no pairs"}
    faults = []
    if target is not None:
        faults += [f"under {100 * target:.0f} %"] * (saved["simulation"] < target)
        faults += [f"{ours['falls'] + base['falls']} falls"] * (ours["falls"] + base["falls"] > 0)
        refereed = sum(result["referee"][who][kind]["falls"] for who in (name, BASE[key]))
        faults += [f"{refereed} falls in C MuJoCo"] * (refereed > 0)
        faults += ["knee bend"] * (ours["min_knee_bend_deg"] < result["least_knee_bend_deg"][kind] - 0.2)
        faults += ["speed differs"] * (abs(ours["speed"] / base["speed"] - 1.0) > 0.01)
        faults += ["C MuJoCo disagrees"] * (abs(saved["mujoco"] / saved["simulation"] - 1.0) > 0.3)
    speed = ours["speed"] / base["speed"] - 1.0
    verdict = "" if target is None else ", ".join(faults) or "pass"
    return row | saved | {"speed_difference": speed, "verdict": verdict}


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
