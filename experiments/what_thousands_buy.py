"""How many terrains does a search need before what it finds holds on others? One gait for four kinds of ground.

The gait's ten numbers are searched on 4, 16, ... 4096 terrains (disjoint draws of a size, where there are enough), in equal
shares of all kinds and difficulties. Each answer is judged on held-out terrains: by the proxy on all of them, in simulation on
a part; that of the largest search, with `traditional`, on all of them and in C MuJoCo. Then the mean gives place to the dearest
tenth of the terrains (CVaR), and to all but the dearest hundredth.

    python -m experiments.what_thousands_buy [--quick]
"""

import dataclasses
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import tyro
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.common import CONFIG, setup, training, write
from experiments.searching import best_vector, for_each, judged_by, judged_lanes
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search.config import Study
from jaxleg.search.contest import Contest, bootstrap, contest, failed, keeps_limits, saving
from jaxleg.search.contestants import contestant
from jaxleg.search.gauss_newton import FAILED, counts
from jaxleg.search.lanes import Lab, Score, settings_of
from jaxleg.search.leaves import read_leaves
from jaxleg.search.referees import replay_contest
from jaxleg.search.training import Lanes, pooled, spread
from jaxleg.viz.style import BLUE, GREY, ORANGE, WIDTH, label, save

SIZES = (4, 16, 64, 256, 1024, 4096)
DRAWS = 3  # searches of a size, as far as its terrains allow
WALKED, REFEREED = 1024, 96  # held-out terrains of each answer in simulation; of the largest search's in C MuJoCo
COUNTED = {"mean": (0.0, 1.0), "dearest tenth": (0.9, 1.0), "all but a hundredth": (0.0, 0.99)}
Judge = Callable[[np.ndarray, Lanes], Score]


class Grounds(NamedTuple):
    """All terrains, kind by kind, judged against `traditional`; and held-out ones with `traditional`'s own planners."""

    train: Lanes
    held: Lanes
    traditional: Lanes


def main(out: Path | None = None, quick: bool = False) -> None:
    """All sizes; `quick` takes the two smallest and sixteen terrains."""
    study, lab = setup(CONFIG.parent / "thousands.toml")
    sizes = SIZES[:2] if quick else SIZES
    study = of_size(study, sizes[-1])
    began = time.perf_counter()
    grounds = make_grounds(study, lab)
    result: dict[str, Any] = {"quick": quick, "grounds_seconds": time.perf_counter() - began, "sizes": []}
    part = spread(grounds.traditional, WALKED)
    base = walked(lab, own(study, part), part)
    judge = judged_by(lab)
    for size in sizes:
        for number in range(min(DRAWS, grounds.train.number // size)):
            lanes = drawn(grounds.train, size, number, len(study.kinds))
            vector, row = answer(study, lab, grounds, lanes, judge)
            row |= {"terrains": size, "draw": number, "simulation": in_simulation(study, lab, grounds, vector, base)}
            result["sizes"].append(row)
            tell(f"{size} terrains, draw {number}", row)
            write("what_thousands_buy", out, result)
    result["verified"] = verified(study, lab, grounds, vector)
    result["counted"] = {}
    for name, shares in COUNTED.items():
        lanes = drawn(grounds.train, sizes[-2], 0, len(study.kinds))
        vector, row = answer(study, dataclasses.replace(lab, counted=shares), grounds, lanes, judge)
        result["counted"][name] = row | {"simulation": in_simulation(study, lab, grounds, vector, base)}
        tell(name, result["counted"][name])
    result["peak_gib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    write("what_thousands_buy", out, result)
    draw(result["sizes"], (out or Path("runs/what_thousands_buy")) / "thousands.png")


def of_size(study: Study, terrains: int) -> Study:
    """The study with so many training terrains, and as many held-out ones."""
    return dataclasses.replace(study, terrains=dataclasses.replace(study.terrains, train=terrains, held_out=terrains))


def make_grounds(study: Study, lab: Lab) -> Grounds:
    """All terrains of the study."""
    kinds = tuple(study.kinds)
    train, held = ({kind: judged_lanes(study, lab, kind, held_out) for kind in kinds} for held_out in (False, True))
    others = {}
    for kind in kinds:
        lanes = training(study, lab, kind, held_out=True)
        others[kind] = lanes._replace(setting=settings_of(contestant(study, kind, "traditional"), lanes.number))
    return Grounds(*(jax.tree.map(np.asarray, pooled(lanes, kinds)) for lanes in (train, held, others)))


def drawn(lanes: Lanes, size: int, number: int, kinds: int) -> Lanes:
    """Draw `number` of so many lanes: of each kind in equal shares, spread evenly over its difficulties, no draw with
    another's."""
    apart = lanes.number // size
    first = (2 * number + 1) * apart // (2 * min(DRAWS, apart))
    place = np.arange(size // kinds) * apart + first
    return lanes.take((lanes.number // kinds * np.arange(kinds)[:, None] + place).reshape(-1))


def answer(study: Study, lab: Lab, grounds: Grounds, lanes: Lanes, judge: Judge) -> tuple[np.ndarray, dict[str, Any]]:
    """The best vector on these training lanes, and what the proxy says of it there and on the held-out ones."""
    began = time.perf_counter()
    vector = best_vector(study, lab, next(iter(study.kinds)), lanes)
    row = {"search_seconds": time.perf_counter() - began, "vector": vector.tolist()}
    told = {name: by_proxy(study, judge(vector, some), some) for name, some in (("train", lanes), ("held", grounds.held))}
    return vector, row | told


def by_proxy(study: Study, score: Score, lanes: Lanes) -> dict[str, Any]:
    """Mean objective with its interval, that of the dearest tenth, and the share of lanes that cannot be planned."""
    value = np.nan_to_num(score.objective, nan=FAILED)
    unfit = ~keeps_limits(score.checks, np.asarray(lanes.setting.least_bend))
    return {
        "objective": bootstrap(value, study.search.resamples, study.seed),
        "dearest_tenth": float(counts(value, COUNTED["dearest tenth"]) @ value),
        "infeasible": float(unfit.mean()),
        "apart": float((score.checks.found[:, FootholdStatus.NEAREST :].sum(axis=1) > 0.0).mean()),
    }


def own(study: Study, lanes: Lanes) -> np.ndarray:
    """The numbers (lane, number) that the lanes' own planners have."""
    return np.asarray(read_leaves(lanes.setting.planner, study.search.move)).T


def walked(lab: Lab, vectors: np.ndarray, lanes: Lanes) -> Contest:
    """Walks on lanes in simulation, of one vector or of one a lane."""
    score, meters = lab.simulate_lanes(for_each(vectors, lanes), lanes.site, lanes.setting)
    return contest(score, meters, np.asarray(lanes.setting.least_bend), 1)


def in_simulation(study: Study, lab: Lab, grounds: Grounds, vector: np.ndarray, base: Contest) -> dict[str, Any]:
    """What walks of the answer cost on held-out terrains in simulation, beside `traditional`'s on the same."""
    return compared(study, walked(lab, vector, spread(grounds.held, WALKED)), base)


def compared(study: Study, ours: Contest, base: Contest) -> dict[str, Any]:
    """Energy on the terrains that both walk, what is saved of `traditional`'s, and how many of all lanes failed."""
    both, column = ours.usable[0] & base.usable[0], CONVENTIONS.index(study.power)
    energy, others = (seen.energy[0, both, column] for seen in (ours, base))
    options = study.search.resamples, study.seed
    return {
        "energy_per_metre": bootstrap(energy, *options),
        "dearest_tenth": float(counts(energy, COUNTED["dearest tenth"]) @ energy),
        "saving": saving(energy, others, *options),
        "lanes": int(both.size),
        "failures": {who: failed(seen, 0) for who, seen in (("ours", ours), ("traditional", base))},
    }


def verified(study: Study, lab: Lab, grounds: Grounds, vector: np.ndarray) -> dict[str, Any]:
    """The answer and `traditional` on all held-out terrains in simulation, and on some in C MuJoCo."""
    began, other = time.perf_counter(), grounds.traditional
    ours, base = walked(lab, vector, grounds.held), walked(lab, own(study, other), other)
    some, others = (spread(lanes, REFEREED) for lanes in (grounds.held, other))
    replays = [replay_contest(lab, for_each(v, lanes), lanes, 1) for v, lanes in ((vector, some), (own(study, others), others))]
    rows = {"simulation": compared(study, ours, base), "mujoco": compared(study, *replays)}
    print("verified", rows, flush=True)
    return rows | {"seconds": time.perf_counter() - began}


def tell(what: str, row: dict[str, Any]) -> None:
    """A line of progress."""
    train, held, seen = row["train"]["objective"], row["held"]["objective"], row["simulation"]
    print(
        f"{what}: proxy {train['mean']:.4f} there, {held['mean']:.4f} held out; in simulation saves"
        f" {100 * seen['saving']['mean']:.1f} %, failed {seen['failures']['ours']} of {seen['lanes']};"
        f" {row['search_seconds']:.0f} s",
        flush=True,
    )


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Objective, energy and failures by the number of training terrains; a point a search."""
    figure = Figure(figsize=(WIDTH, 3.2), layout="constrained", facecolor="white")
    objective, energy, failures = figure.subplots(1, 3)
    sizes = np.array([row["terrains"] for row in rows])
    for name, colour, words in (("train", GREY, "on its own terrains"), ("held", BLUE, "held out")):
        points(objective, sizes, [row[name]["objective"]["mean"] for row in rows], colour, words)
    points(energy, sizes, [row["simulation"]["energy_per_metre"]["mean"] for row in rows], BLUE, "")
    for who, colour in (("traditional", ORANGE), ("ours", BLUE)):
        each = [row["simulation"]["failures"][who] for row in rows]
        lost = [100 * (seen["falls"] + seen["infeasible"]) / seen["lanes"] for seen in each]
        points(failures, sizes, lost, colour, who)
    words = "training terrains"
    usual = np.median([row["held"]["objective"]["mean"] for row in rows])
    objective.set_ylim(0.7 * usual, 1.3 * usual)  # one unlucky search may be several times as dear
    label(objective, words, "objective / traditional's energy [-]", "proxy")
    label(energy, words, "energy [J/m]", "simulated, held out")
    label(failures, words, "walks that fail [%]", "simulated, held out")
    for ax in (objective, failures):
        ax.legend(fontsize=8, frameon=False)
    save(figure, path)


def points(ax: Axes, sizes: np.ndarray, values: list[float], colour: str, words: str) -> None:
    """All searches, and the median of each size."""
    values = np.array(values, float)
    each = np.unique(sizes)
    ax.plot(sizes, values, "o", color=colour, ms=3, alpha=0.5)
    ax.plot(each, [np.median(values[sizes == size]) for size in each], "-", color=colour, lw=1.5, label=words)
    ax.set_xscale("log", base=4)
    ax.set_xticks(each, each)


if __name__ == "__main__":
    tyro.cli(main)
