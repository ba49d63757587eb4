"""What does stability cost, and what does speed? Fronts of energy against margin at several speeds, level and rough.

At each speed the gait is searched with ever higher stability margins as the floor; each answer walks on held-out terrains in
simulation, `traditional` at the same speed beside it.

    python -m experiments.pareto [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from matplotlib.figure import Figure

from experiments.common import setup, training, write
from experiments.searching import best_vector, judged_lanes
from jaxleg.search.config import Study
from jaxleg.search.contest import Contest, contest, failures, summary
from jaxleg.search.contestants import baseline, contestant, numbers, searched_planner
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.leaves import with_leaves
from jaxleg.search.run import make_lab
from jaxleg.search.training import Lanes, spread
from jaxleg.viz.style import BLUE, GREEN, ORANGE, WIDTH, label, legend_below, save

KINDS = ("flat", "rough")
SPEEDS = {0.03: BLUE, 0.05: GREEN, 0.07: ORANGE}  # [m/s]
MARGINS = (0.02, 0.04, 0.06, 0.08, 0.10, 0.12)  # [m]
TERRAINS = 32  # of each kind, training and held out


def main(out: Path | None = None, quick: bool = False) -> None:
    """All fronts; `quick` takes flat ground, one speed and two margins."""
    study, lab = setup()
    result: dict[str, Any] = {"quick": quick, "power": study.power, "fronts": []}
    for speed in list(SPEEDS)[1:2] if quick else SPEEDS:
        at, own = at_speed(study, lab, speed)
        for kind in KINDS[:1] if quick else KINDS:
            front = fronts(at, own, kind, MARGINS[1:4:2] if quick else MARGINS)
            result["fronts"].append({"kind": kind, "speed": speed} | front)
            tell(result["fronts"][-1])
            write("pareto", out, result)
    draw(result["fronts"], (out or Path("runs/pareto")) / "pareto.png")


def at_speed(study: Study, lab: Lab, speed: float) -> tuple[Study, Lab]:
    """Study and lab at a speed [m/s], with simulation steps as long as the study's own."""
    longer = study.speed / speed
    simulation = dataclasses.replace(study.simulation, steps=max(1, round(study.simulation.steps * longer)))
    study = dataclasses.replace(study, speed=speed, simulation=simulation)
    return study, make_lab(study, lab.robot)


def fronts(study: Study, lab: Lab, kind: str, margins: tuple[float, ...]) -> dict[str, Any]:
    """The best gait at each margin [m], and `traditional`, on held-out terrains."""
    lanes, held = spread(judged_lanes(study, lab, kind), TERRAINS), spread(training(study, lab, kind, held_out=True), TERRAINS)
    rows = []
    for margin in margins:
        floor = np.full_like(lanes.setting.margin, margin)
        vector = best_vector(study, lab, kind, lanes._replace(setting=lanes.setting._replace(margin=floor)))
        rows.append({"margin": margin} | row(study, lab, kind, held, vector))
    return {"rows": rows, "traditional": row(study, lab, kind, held)}


def row(study: Study, lab: Lab, kind: str, held: Lanes, vector: np.ndarray | None = None) -> dict[str, Any]:
    """What a searched gait, or `traditional`, does on held-out terrains, and the least margin of its plans."""
    planner = contestant(study, kind, "traditional")
    if vector is not None:
        planner = with_leaves(searched_planner(study, kind), study.search.move, vector)
    lanes = held._replace(setting=settings_of(planner, held.number))
    own = baseline(study, kind, "traditional") if vector is None else vector
    score, meters = lab.simulate_lanes(np.tile(np.float32(own), (held.number, 1)), lanes.site, lanes.setting)
    seen: Contest = contest(score, meters, np.asarray(lanes.setting.least_bend), 1)
    options = study.power, float(lab.robot.mass), study.search.resamples, study.seed
    told = summary(seen, 0, numbers(study, planner), *options) | {"failures": failures(seen, 0)}
    return told | {"planned_margin": float(np.min(score.checks.margin))}


def tell(front: dict[str, Any]) -> None:
    """Print a front."""
    rows = [("traditional", front["traditional"]), *((f"floor {r['margin']:.2f} m", r) for r in front["rows"])]
    for name, seen in rows:
        energy = seen["energy_per_metre"]["positive"]["mean"]
        print(
            f"{front['kind']} {front['speed']} m/s, {name}: {energy} J/m, margin planned {seen['planned_margin']:.3f} m, in"
            f" simulation {seen['min_stability_margin']} m, {seen['failures']}",
            flush=True,
        )


def draw(all_fronts: list[dict[str, Any]], path: Path) -> None:
    """Energy against the planned margin; a panel a kind, a colour a speed, squares for `traditional`."""
    kinds = list(dict.fromkeys(front["kind"] for front in all_fronts))
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained", facecolor="white")
    axes, lines = np.atleast_1d(figure.subplots(1, len(kinds), sharey=True)), []
    for ax, kind in zip(axes, kinds):
        for front in (f for f in all_fronts if f["kind"] == kind):
            rows, colour = [r for r in front["rows"] if r["energy_per_metre"]["positive"]["mean"]], SPEEDS[front["speed"]]
            margins = [100 * r["planned_margin"] for r in rows]
            energies = [r["energy_per_metre"]["positive"]["mean"] for r in rows]
            lines += ax.plot(margins, energies, "o-", color=colour, ms=4, label=f"{front['speed']} m/s")
            other = front["traditional"]
            ax.plot(100 * other["planned_margin"], other["energy_per_metre"]["positive"]["mean"], "s", color=colour, ms=6)
        label(ax, "least stability margin of the plan [cm]", "energy, simulated [J/m]" if ax is axes[0] else "", kind)
        ax.set_ylim(bottom=0.0)
    legend_below(figure, lines[: len(lines) // len(kinds)], len(SPEEDS))
    save(figure, path)


if __name__ == "__main__":
    tyro.cli(main)
