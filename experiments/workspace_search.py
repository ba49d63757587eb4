"""Which workspace under the hips saves most, and on which ground? Paper A's rectangle beside the best one.

On grounds from level to 8 cm rough and on stairs the gait's numbers and the workspace's bounds are searched together, once
with L_F2H held to the paper's [-0.20, 0] m and once with both of its ends free; all answers walk on held-out terrains. Then the
ends alone are moved, every other number as the paper's rectangle has it at its best, over a grid and by the exact choice; and
the best gait is given ever wider bounds: how many walks lose their footing, and what does it cost?

    python -m experiments.workspace_search [--quick]
"""

import dataclasses
import functools
import itertools
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.common import setup, training, write
from experiments.searching import best_vector, judged_by, judged_lanes
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search.config import MOVE, WORKSPACE, Study
from jaxleg.search.contest import Contest, contest, failures, saving, summary, workspace
from jaxleg.search.contestants import baseline, bounds, contestant, numbers, searched_planner, short_name
from jaxleg.search.gauss_newton import FAILED
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.leaves import with_leaves
from jaxleg.search.training import Lanes
from jaxleg.viz.style import BLUE, GREEN, GREY, ORANGE, WIDTH, label, legend_below, save

ROUGH = (0.0, 0.02, 0.04, 0.06, 0.08)  # amplitudes [m]
ENDS = ("gait.workspace.behind", "gait.workspace.ahead")
NUMBERS = (*MOVE, *WORKSPACE)
PAPER = (-0.20, 0.0)  # L_F2H [m]
GRID = 7  # values of each end in the grid
WIDTHS = (-0.02, 0.0, 0.01, 0.02, 0.03, 0.05, 0.08)  # added to either end of what the best gait uses on level ground [m]
NAMES = {"traditional": GREY, "paper": ORANGE, "rectangle": BLUE, "free": GREEN}


class Ground(NamedTuple):
    """A kind of terrain and its lanes."""

    name: str
    train: Lanes  # judged against the traditional gait
    held: Lanes


def main(out: Path | None = None, quick: bool = False, train: int = 128, held: int = 96) -> None:
    """All grounds; `quick` takes two of them and a few terrains."""
    study, lab = setup()
    study = on_grounds(study, ROUGH[::4] if quick else ROUGH, *((16, 8) if quick else (train, held)), stairs=not quick)
    lab = dataclasses.replace(lab, move=NUMBERS)
    study = dataclasses.replace(study, search=dataclasses.replace(study.search, move=NUMBERS))
    result: dict[str, Any] = {"quick": quick, "numbers": [short_name(name) for name in NUMBERS], "grounds": {}}
    for name in study.kinds:
        result["grounds"][name] = row = on_ground(study, lab, name, quick)
        tell(name, row)
        write("workspace_search", out, result)
    draw(result["grounds"], (out or Path("runs/workspace_search")) / "workspace.png")


def on_grounds(study: Study, rough: tuple[float, ...], train: int, held: int, stairs: bool) -> Study:
    """The study on rough ground of these amplitudes [m], and on stairs."""
    kinds = {
        f"rough_{round(1000 * height)}mm": dataclasses.replace(study.kinds["rough"], amplitude=height, difficulty=(1.0, 1.0))
        for height in rough
    }
    kinds |= {"stairs": study.kinds["stairs"]} if stairs else {}
    terrains = dataclasses.replace(study.terrains, train=train * len(kinds), held_out=held * len(kinds))
    return dataclasses.replace(study, kinds=kinds, terrains=terrains)


def on_ground(study: Study, lab: Lab, name: str, quick: bool) -> dict[str, Any]:
    """Everything on one kind of terrain."""
    ground = Ground(name, judged_lanes(study, lab, name), training(study, lab, name, held_out=True))
    found = {
        "rectangle": answer(study, lab, ground, PAPER, quick),
        "free": answer(study, lab, ground, None, quick),
    }
    judge = functools.partial(judged_by(lab), lanes=ground.train)
    found["ends"], moved = ends_alone(judge, found["rectangle"], 3 if quick else GRID)
    seen = {name: walked(study, lab, ground, name, found.get(name)) for name in ("traditional", "paper", *found)}
    rows = {who: told(study, lab, name, who, held, found.get(who)) for who, held in seen.items()}
    pairs = [("free", "traditional"), ("free", "rectangle"), ("free", "paper"), ("ends", "rectangle")]
    return {
        "contestants": rows,
        "saving": {f"{one} against {other}": saved(study, seen[one], seen[other]) for one, other in pairs},
        "ends_alone": moved,
        "widths": [wider(judge, found["free"], rows["free"]["workspace"]["used"], more) for more in WIDTHS],
        "terrains": {"train": ground.train.number, "held_out": ground.held.number},
    }


def answer(study: Study, lab: Lab, ground: Ground, ends: tuple[float, float] | None, quick: bool) -> np.ndarray:
    """The best numbers on the training terrains, with L_F2H from and to `ends` [m], or these moved too."""
    box = bounds(study, ground.name, "best")
    for name, end in zip(ENDS, ends or ()):
        box[NUMBERS.index(name)] = end
    return best_vector(study, lab, ground.name, ground.train, box, steps=2 if quick else None)


def ends_alone(judge, vector: np.ndarray, count: int) -> tuple[np.ndarray, dict[str, Any]]:
    """The vector with the ends of the grid whose mean objective is least, and all of the grid."""
    behind, ahead = np.linspace(-0.30, 0.0, count), np.linspace(0.0, 0.30, count)
    tried = [moved(vector, pair) for pair in itertools.product(behind, ahead)]
    means = [float(np.nan_to_num(judge(x).objective, nan=FAILED).mean()) for x in tried]
    return tried[int(np.argmin(means))], {"behind": behind.tolist(), "ahead": ahead.tolist(), "objective": means}


def moved(vector: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """The vector with these ends of L_F2H [m]."""
    vector = vector.copy()
    vector[[NUMBERS.index(name) for name in ENDS]] = ends
    return vector


def wider(judge, vector: np.ndarray, used: dict[str, float], more: float) -> dict[str, float]:
    """What bounds so much wider [m] than those used cost: energy over the traditional gait's, walks that lose their footing."""
    score = judge(moved(vector, (used["behind"] - more, used["ahead"] + more)))
    apart = 1.0 - score.checks.found[:, : FootholdStatus.NEAREST].sum(axis=1)
    return {
        "width": used["ahead"] - used["behind"] + 2.0 * more,
        "objective": float(np.nan_to_num(score.objective, nan=FAILED).mean()),
        "apart": float((apart > 0.0).mean()),
        "inside": float(score.checks.inside.mean()),
    }


def walked(study: Study, lab: Lab, ground: Ground, name: str, vector: np.ndarray | None) -> Contest:
    """A contestant in simulation on the held-out terrains."""
    lanes = ground.held
    if vector is None:
        vector = baseline(study, ground.name, name)
        lanes = lanes._replace(setting=settings_of(contestant(study, ground.name, name), lanes.number))
    rows = np.tile(np.float32(vector), (lanes.number, 1))
    score, meters = lab.simulate_lanes(rows, lanes.site, lanes.setting)
    return contest(score, meters, np.asarray(lanes.setting.least_bend), 1)


def told(study: Study, lab: Lab, kind: str, who: str, held: Contest, vector: np.ndarray | None) -> dict[str, Any]:
    """One contestant's figures: what every study tells of it, its workspace and its failures."""
    if vector is None:
        planner = contestant(study, kind, who)
    else:
        planner = with_leaves(searched_planner(study, kind), NUMBERS, jnp.asarray(vector, float))
    params = numbers(study, planner)
    row = summary(held, 0, params, study.power, float(lab.robot.mass), study.search.resamples, study.seed)
    return row | {"workspace": workspace(held, 0, params), "failures": failures(held, 0)}


def saved(study: Study, one: Contest, other: Contest) -> dict[str, Any]:
    """What one contestant saves of another's energy, with its interval, on terrains that both walk."""
    both, column = one.usable[0] & other.usable[0], CONVENTIONS.index(study.power)
    return saving(one.energy[0, both, column], other.energy[0, both, column], study.search.resamples, study.seed)


def tell(name: str, row: dict[str, Any]) -> None:
    """Print a ground's rows."""
    for who, seen in row["contestants"].items():
        space, lost = seen["workspace"], seen["failures"]
        energy = seen["energy_per_metre"]["positive"]["mean"]
        ends = ", ".join(f"{end} {bound}" for end, bound in space["bounds"].items())
        print(f"{name} {who}: {energy} J/m, inside {space['inside']}, {lost}, {ends}")
    for pair, seen in row["saving"].items():
        print(f"{name}: {pair} saves {seen['mean']} {seen['ci95']}", flush=True)


def draw(grounds: dict[str, Any], path: Path) -> None:
    """Energy by ground, the workspace that the best gait uses, and what its bounds' width costs."""
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    energy, space, width = figure.subplots(1, 3)
    names = list(grounds)
    for who, colour in NAMES.items():
        means = [grounds[name]["contestants"][who]["energy_per_metre"]["positive"]["mean"] for name in names]
        energy.plot(range(len(names)), [np.nan if x is None else x for x in means], "o-", color=colour, ms=4)
    energy.set_ylim(bottom=0.0)
    for i, name in enumerate(names):
        used = grounds[name]["contestants"]["free"]["workspace"]["used"]
        space.plot([i, i], [used["behind"], used["ahead"]], color=GREEN, lw=5, solid_capstyle="butt")
    space.axhspan(*PAPER, color=ORANGE, alpha=0.25, lw=0)
    shades = np.linspace(0.85, 0.2, len(names))
    for shade, name in zip(shades, names):
        rows = grounds[name]["widths"]
        width.plot([r["width"] for r in rows], [r["apart"] for r in rows], ".-", color=str(shade), label=name)
    for ax in (energy, space):
        ax.set_xticks(range(len(names)), [name.replace("rough_", "").replace("_", " ") for name in names], rotation=45)
    label(energy, "", "energy [J/m]", "held-out ground")
    label(space, "", "L_F2H used [m]", "best (bar), paper (band)")
    label(width, "width of the bounds [m]", "walks with feet apart [-]", "narrower bounds")
    width.legend(fontsize=7, frameon=False)
    words = {
        "traditional": "traditional",
        "paper": "paper's own",
        "rectangle": "best in its rectangle",
        "free": "best, bounds free",
    }
    legend_below(figure, [Line2D([], [], color=NAMES[who], marker="o", ms=4, label=words[who]) for who in NAMES], 4)
    save(figure, path)


if __name__ == "__main__":
    tyro.cli(main)
