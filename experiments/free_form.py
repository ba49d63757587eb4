"""What does a walk save whose form is free? Trunk, times, swings and feet moved by gradients, on top of the gait's ten numbers.

Three descents on the proxy from the quickstart's best gait, alike in optimiser, steps, training terrains and constraints: the
ten numbers alone, the ten with a half cycle's free form and its mirror image, and from there on with every half cycle's own.
They and `traditional` are then walked on held-out terrains in simulation and in C MuJoCo. All keep traditional's stability
margin, the kind's knee bend and one speed.

    python -m experiments.free_form [--quick] [--run runs/quickstart]    without a run, a quickstart search comes first
"""

import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from matplotlib.figure import Figure

from experiments.common import CONFIG, setup, training, write
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search import descent
from jaxleg.search.config import Study
from jaxleg.search.contest import Contest, contest, saving, summary
from jaxleg.search.contestants import baseline, bounds, contestant, planner_of, searched_planner
from jaxleg.search.free import FreeLab, free_lab
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.leaves import read_leaves
from jaxleg.search.referees import replay_contest
from jaxleg.search.sites import make_sites
from jaxleg.search.training import Lanes
from jaxleg.search.training import spread as evenly
from jaxleg.settings import load
from jaxleg.viz.style import BLACK, GREEN, GREY, ORANGE, WIDTH, label, legend_below, save
from jaxleg.walk.free import gathered, names_of, spread
from jaxleg.walk.reference import reference

FORMS = {"mirrored": (1, True), "whole": (None, False)}  # half cycles after which the form is alike, and left and right changed
NAMES = ("traditional", "ten", *FORMS)
COLOUR = dict(zip(NAMES, (GREY, BLACK, GREEN, ORANGE)))
AGAIN = 2  # rounds of a descent: its trust region begins anew
SAMPLES = (24, 24)  # of the picture


class Task(NamedTuple):
    """What is searched on one kind of terrain."""

    study: Study
    kind: str
    train: Lanes  # training terrains, judged against `traditional`
    start: np.ndarray  # the ten numbers to begin with
    steps: int


def main(out: Path | None = None, run: Path | None = None, quick: bool = False) -> None:
    """All kinds of the quickstart; `quick` takes flat ground, few steps, and begins with the paper's own gait."""
    study, lab = setup()
    folder = out or Path("runs") / "free_form"
    best = None if quick else found(run or folder / "quickstart")
    forms = {"mirrored": FORMS["mirrored"]} if quick else FORMS
    labs = {name: free_lab(lab, *form, move=study.search.move, chunk=4) for name, form in forms.items()}
    train, held, steps = (1, 1, 5) if quick else (8, 32, 60)
    rows: dict[str, Any] = {}
    for kind in ("flat",) if quick else study.kinds:
        task = make_task(study, labs["mirrored"], kind, best, train, steps)
        vectors, lasted = searched(task, labs)
        rows[kind] = row(task, labs, vectors, held) | {"search_seconds": lasted}
        write("free_form", out, {"numbers": sizes(labs), "kinds": rows, "quick": quick})
        if kind == "flat":
            draw(task, labs, vectors, folder / "free_form.png")


def found(run: Path) -> Study:
    """The study with the best gaits of a quickstart run in place; the run is made where there is none."""
    if not (run / "best.toml").exists():
        subprocess.run([sys.executable, "-m", "jaxleg.cli", "search", str(CONFIG), "--out", str(run)], check=True)
    return load(Study, run / "best.toml")


def sizes(labs: dict[str, FreeLab]) -> dict[str, int]:
    """How many numbers each search moves."""
    return {"ten": len(labs["mirrored"].move)} | {name: len(lab.move) + len(lab.bounds) for name, lab in labs.items()}


def make_task(study: Study, lab: FreeLab, kind: str, best: Study | None, train: int, steps: int) -> Task:
    """Training terrains on which energy counts against `traditional`'s, whose margin must keep to it."""
    lanes = evenly(training(study, lab, kind), train)
    vectors = np.tile(widened(lab, baseline(study, kind, "traditional")), (lanes.number, 1))
    alone = settings_of(contestant(study, kind, "traditional"), lanes.number)
    score, _ = lab.proxy_gradients(vectors, lanes.site, alone)
    energy = np.full(lanes.number, score.energy[:, CONVENTIONS.index(study.power)].mean())
    margin, energy = (jnp.asarray(x, float) for x in (score.checks.margin + study.search.margin_reserve, energy))
    planner = searched_planner(study, kind) if best is None else planner_of(best, best.kinds[kind], best.kinds[kind].gait)
    start = np.asarray(read_leaves(planner, study.search.move))
    return Task(study, kind, Lanes(lanes.site, lanes.setting._replace(margin=margin, energy=energy)), start, steps)


def widened(lab: FreeLab, ten: np.ndarray) -> np.ndarray:
    """The ten numbers, and a free form that adds nothing."""
    return np.concatenate([ten, np.zeros(len(lab.bounds))]).astype(np.float32)


def searched(task: Task, labs: dict[str, FreeLab]) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """The best vector of each search, and its seconds with compiling where it is the first of its lab."""
    vectors, lasted = {}, {}
    for name in ("ten", *labs):
        lab, began = labs[name if name in labs else "mirrored"], time.perf_counter()
        begin = widened(lab, task.start) if name != "whole" else on(lab, labs["mirrored"], vectors["mirrored"])
        vectors[name] = descended(task, lab, begin, free=name in labs)
        lasted[name] = time.perf_counter() - began
    return vectors, lasted


def on(lab: FreeLab, other: FreeLab, vector: np.ndarray) -> np.ndarray:
    """Another lab's vector as one of a lab whose form has more numbers."""
    ten, form = np.split(vector, [len(other.move)])
    return np.concatenate([ten, gathered(lab.tie, spread(other.tie, jnp.asarray(form)))]).astype(np.float32)


def descended(task: Task, lab: FreeLab, begin: np.ndarray, free: bool) -> np.ndarray:
    """The end of a descent from a vector on all training terrains at once; the free form's numbers move or stay zero. Feet
    go aside where every cell is a foothold: a cell's place is not the descent's to choose."""
    stays = np.array(names_of(lab.tie)) == "aside" if not np.all(task.train.site.valid) else np.zeros(len(lab.bounds), bool)
    form = np.where(stays[:, None] | (not free), 0.0, lab.bounds)
    box = np.concatenate([bounds(task.study, task.kind, "best"), form])
    span = descent.ranges(box[None])
    point, plan = span.scaled(np.clip(begin, *box.T))[None], [(task.train.number, 1)] * AGAIN
    best, value = descent.searched(lab, task.train, span, point, plan, task.steps)
    print(f"{task.kind}: {value[0]:.4f} of the baseline", flush=True)
    return best[0]


def row(task: Task, labs: dict[str, FreeLab], vectors: dict[str, np.ndarray], held: int) -> dict[str, Any]:
    """All contestants on held-out terrains in both engines, and what the free forms save of the others' energy."""
    study, kind = task.study, task.kind
    site = make_sites(study, labs["mirrored"].robot, kind, held_out=True)
    alone = Lanes(site, settings_of(searched_planner(study, kind), site.valid.shape[0]))
    lanes = evenly(alone, held)
    gaits = {"traditional": widened(labs["mirrored"], baseline(study, kind, "traditional"))} | vectors
    engines: dict[str, dict[str, Contest]] = {"simulation": {}, "mujoco": {}}
    for name, vector in gaits.items():
        lab, many = labs[name if name in FORMS else "mirrored"], np.tile(vector, (lanes.number, 1))
        score, meters = lab.simulate_lanes(many, lanes.site, lanes.setting)
        engines["simulation"][name] = contest(score, meters, np.asarray(lanes.setting.least_bend), 1)
        engines["mujoco"][name] = replay_contest(lab, many, lanes, 1)
    result = {name: told(study, lab.robot, {e: seen[name] for e, seen in engines.items()}) for name in gaits}
    for base in ("traditional", "ten"):
        result[f"saving_vs_{base}"] = {e: savings(study, seen, base) for e, seen in engines.items()}
    for name in gaits:
        print(
            kind, name, result[name]["simulation"]["energy_per_metre"][study.power], result["saving_vs_ten"]["mujoco"].get(name)
        )
    return result | {"vectors": {name: vector.tolist() for name, vector in vectors.items()}}


def told(study: Study, robot: Any, seen: dict[str, Contest]) -> dict[str, Any]:
    """One contestant by engine."""
    options = (study.power, float(robot.mass), study.search.resamples, study.seed)
    return {engine: summary(held, 0, {}, *options) for engine, held in seen.items()}


def savings(study: Study, seen: dict[str, Contest], base: str) -> dict[str, Any]:
    """What each free form, and the ten numbers, save of a contestant's energy, on lanes that both walk."""
    column, table = CONVENTIONS.index(study.power), {}
    names = list(seen)
    for name in names[names.index(base) + 1 :]:
        both = seen[name].usable[0] & seen[base].usable[0]
        pairs = (seen[x].energy[0, both, column] for x in (name, base))
        table[name] = saving(*pairs, study.search.resamples, study.seed)
    return table


def draw(task: Task, labs: dict[str, FreeLab], vectors: dict[str, np.ndarray], path: Path) -> None:
    """How the trunk goes with the ten numbers and with each free form: from above, its height and its roll."""
    figure = Figure(figsize=(WIDTH, 6.5), layout="constrained", facecolor="white")
    axes, lines = figure.subplots(3, 1, sharex=True), []
    for name, vector in vectors.items():
        x, y, z, roll = trunk_of(labs[name if name in FORMS else "mirrored"], task.train, vector)
        for ax, values in zip(axes, (100.0 * y, 100.0 * z, np.rad2deg(roll))):
            lines += ax.plot(100.0 * x, values, color=COLOUR[name], lw=1.5, label=name)[:1]
    for ax, words in zip(axes, ("to the left [cm]", "height of the trunk [cm]", "roll [deg]")):
        label(ax, "ahead [cm]" if ax is axes[-1] else "", words)
    legend_below(figure, lines[:: len(axes)], len(vectors))
    save(figure, path)


def trunk_of(lab: Lab, lanes: Lanes, vector: np.ndarray) -> tuple[np.ndarray, ...]:
    """The trunk's way on the first terrain: x, y, z [m] and roll [rad]."""
    site, setting = (jax.tree.map(lambda x: x[0], tree) for tree in lanes[:2])

    @jax.jit
    def way(vector):
        walk = lab.walk(vector, site, lab.choose(vector, site, setting), setting)
        return reference(lab.robot, walk, SAMPLES)

    track = way(jnp.asarray(vector))
    w, x, y, z = np.asarray(track.trunk_quat).T
    return *np.asarray(track.trunk_pos).T, np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


if __name__ == "__main__":
    tyro.cli(main)
