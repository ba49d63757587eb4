"""Table I of paper A: power of Pegasus on plain ground and on stairs, before and after, the paper's numbers beside ours.

One number is calibrated (the gear ratio: 35.4 W for `traditional` on flat ground); all others are predictions. The paper does
not define its "before": both readings stand here, and what else it might have been is a matter for `experiments.baselines`.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.common import each_on_its_own, setup, training, write
from experiments.slow_walk import SPEED, STAND, STAND_SHARE, Trace, mean_over_time, power_over_time, search_gait, slow, walks
from jaxleg.leg.energy import CONVENTIONS, cost_of_transport
from jaxleg.search.config import Study
from jaxleg.search.contest import keeps_limits
from jaxleg.search.contestants import baseline, short_name
from jaxleg.search.lanes import Lab
from jaxleg.search.referees import replay_contest
from jaxleg.search.training import Lanes
from jaxleg.sim.meters import Record
from jaxleg.viz.power import draw_power
from jaxleg.walk.data import PlanChecks

PAPER = {
    "flat": {"power_before_w": 35.4, "power_after_w": 31.8, "saving": 0.102, "saving_of_sums": 0.120, "cot": 7.68},
    "stairs": {"power_before_w": 37.8, "power_after_w": 35.2, "saving": 0.069, "saving_of_sums": 0.0794, "cot": 8.2},
}
BEFORE = ("traditional", "implied")
NAMES = (*BEFORE, "paper", "ours")
SETTLED = 0.5  # the robot has sunk into its stand [s]


class Table(NamedTuple):
    """What the contestants did on one kind of terrain."""

    kind: str
    study: Study
    lab: Lab
    vectors: dict[str, np.ndarray]  # parameters by contestant
    rows: dict[str, dict[str, Any]]  # results by contestant
    trace: Trace  # all lanes, contestant by contestant
    lanes: int  # of each contestant
    stand: float  # before the walk [s]


def table(kind: str, quick: bool, names: tuple[str, ...] = NAMES) -> Table:
    """Walk contestants on a kind of terrain and print what they needed."""
    study, lab = slow(*setup(), 9 if quick else 24)
    lanes = training(study, lab, kind)
    count = 1 if kind == "flat" else (2 if quick else lanes.number)
    vectors = {name: search_gait(study, lab, kind, quick) if name == "ours" else baseline(study, kind, name) for name in names}
    many = each_on_its_own(study, kind, lanes.take(np.arange(count)), names)
    each = np.repeat(list(vectors.values()), count, axis=0)
    stand, cycles = (STAND, 2) if kind == "stairs" else (0.0, 3)
    trace, plans = walks(lab, each, many, cycles, stand), checked(lab, each, many)
    part = {name: slice(i * count, (i + 1) * count) for i, name in enumerate(names)}
    others = by_mujoco(lab, each, many, names)
    rows = {
        name: row(lab, trace, where, stand) | planned(plans, many, where) | {"mujoco": others[name]}
        for name, where in part.items()
    }
    show(kind, rows)
    return Table(kind, study, lab, vectors, rows, trace, count, stand)


def row(lab: Lab, trace: Trace, lanes: slice, stand: float) -> dict[str, Any]:
    """Mean power [W] by convention walking, standing and over the paper's run; speed, COT, falls, margin of one contestant."""
    kept = picked(trace, lanes)
    parts = {convention: spans(power_over_time(lab.robot, kept, convention), kept, stand) for convention in CONVENTIONS}
    walk, still, run = ({convention: part[i] for convention, part in parts.items()} for i in range(3))
    meters = trace.meters
    speed = float(np.mean(meters.moved[lanes, 0] / (meters.time[lanes] - stand)))
    cot = float(cost_of_transport(run["net"] / speed, lab.robot.mass))
    safety = {"falls": int(np.sum(meters.fell[lanes])), "min_stability_margin": float(np.min(meters.margin[lanes]))}
    return {"power_w": run, "walking_w": walk, "stand_power_w": still, "speed": speed, "cot": cot} | safety


def by_mujoco(lab: Lab, vectors: np.ndarray, lanes: Lanes, names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Mean power [W] by convention walking two cycles in C MuJoCo, falls and least margin, of each contestant."""
    seen = replay_contest(lab, vectors, lanes, len(names))
    watts = seen.energy * (seen.distance / seen.time)[..., None]
    rows = {}
    for i, name in enumerate(names):
        power = dict(zip(CONVENTIONS, watts[i].mean(axis=0).tolist()))
        safety = {"falls": int(seen.fell[i].sum()), "min_stability_margin": float(seen.margin[i].min())}
        rows[name] = {"walking_w": power} | safety
    return rows


def checked(lab: Lab, vectors: np.ndarray, lanes: Lanes) -> PlanChecks:
    """What constrains the plans of lanes."""
    return lab.proxy_gradients(vectors.astype(np.float32), lanes.site, lanes.setting)[0].checks


def planned(plans: PlanChecks, lanes: Lanes, where: slice) -> dict[str, Any]:
    """Least knee bend [deg] and greatest lowering of the trunk [m] in the plans of some lanes; how many cannot be walked."""
    bend, lowered = float(np.min(plans.knee_bend[where])), float(np.max(plans.lowering[where]))
    bad = ~keeps_limits(plans, np.asarray(lanes.setting.least_bend))[where]
    return {"knee_bend_deg": float(np.rad2deg(bend)), "lowering_m": lowered, "infeasible": int(np.sum(bad))}


def spans(power: np.ndarray, kept: Record, stand: float) -> tuple[float, float | None, float]:
    """Mean over lanes of power [W] (lane, t) while walking, while standing (once settled), and over the paper's run."""
    time = np.asarray(kept.time)
    walk = float(np.mean([mean_over_time(p, t, stand) for p, t in zip(power, time)]))
    if not stand:
        return walk, None, walk
    still = float(np.mean([mean_over_time(p, t, SETTLED, stand) for p, t in zip(power, time)]))
    return walk, still, STAND_SHARE * still + (1.0 - STAND_SHARE) * walk


def picked(trace: Trace, lanes: slice) -> Record:
    """The records of some lanes."""
    return Record(*(x[lanes] for x in trace.record))


def show(kind: str, rows: dict[str, Any]) -> None:
    """Print the rows, the paper's power beside."""
    paper = PAPER[kind]
    print(f"{kind}, {SPEED} m/s, net power [W] (paper: {paper['power_before_w']} before, {paper['power_after_w']} after)")
    names = ("run", "walking", "standing", "positive", "absolute", "COT", "margin", "knee", "lowered", "falls", "unfit")
    print(" " * 12 + "".join(f"{name:>10s}" for name in names))
    for name, r in rows.items():
        power, still = r["power_w"], r["stand_power_w"]["net"]
        watts = (power["net"], r["walking_w"]["net"], np.nan if still is None else still, power["positive"], power["absolute"])
        cells = [f"{x:10.1f}" for x in watts] + [f"{r['cot']:10.2f}{r['min_stability_margin']:10.3f}"]
        cells += [f"{r['knee_bend_deg']:10.1f}{r['lowering_m']:10.3f}{r['falls']:10d}{r['infeasible']:10d}"]
        print(f"{name:12s}" + "".join(cells).replace("nan", "  -"))
        other = r["mujoco"]
        print(f"{'':12s}in C MuJoCo {other['walking_w']['net']:.1f} W walking, {other['falls']} falls")


def result(seen: Table) -> dict[str, Any]:
    """The paper's numbers and ours, per baseline: power before and after, with our parameters, savings under "net"."""
    rows = seen.rows
    ours = {}
    for before in BEFORE:
        power = {name: rows[name]["power_w"]["net"] for name in (before, "paper", "ours")}
        stand = {name: rows[name]["stand_power_w"]["net"] for name in (before, "paper", "ours")}
        ours[before] = {
            "power_before_w": power[before],
            "power_after_w": power["paper"],
            "power_ours_w": power["ours"],
            "stand_power_w": stand,
            "saving": {name: 1.0 - power[name] / power[before] for name in ("paper", "ours")},
            "mujoco_w": {name: rows[name]["mujoco"]["walking_w"]["net"] for name in (before, "paper", "ours")},
            "cot": {name: rows[name]["cot"] for name in power},
        }
    names = [short_name(leaf) for leaf in seen.lab.move]
    params = {name: dict(zip(names, map(float, vector))) for name, vector in seen.vectors.items()}
    return {"paper": PAPER[seen.kind], "ours": ours, "contestants": rows, "params": params, "speed": SPEED}


def finish(name: str, out: Path | None, seen: Table, content: dict[str, Any]) -> None:
    """Print the savings, write result.json and the figure of power against time on the first terrain."""
    for before, r in content["ours"].items():
        print(f"against {before}: the paper's parameters save {100 * r['saving']['paper']:.1f} %", end=" ")
        print(f"(paper says {100 * content['paper']['saving']:.1f} %), ours {100 * r['saving']['ours']:.1f} %")
    write(name, out, content)
    kept = picked(seen.trace, slice(None, None, seen.lanes))
    power = dict(zip(seen.rows, power_over_time(seen.lab.robot, kept, "net")))
    title = f"{SPEED} m/s on {'plain ground' if seen.kind == 'flat' else f'one of the {seen.lanes} stairs'}"
    draw_power(np.asarray(kept.time), power, seen.stand, title, (out or Path("runs") / name) / "power.png")


def saving_ratio(flat: Table, stairs: Table) -> dict[str, dict[str, float]]:
    """Saving on stairs over that on flat ground, the paper's parameters against each baseline: the run with its stand, and
    walking alone."""

    def saved(seen, before, power):
        return 1.0 - seen.rows["paper"][power]["net"] / seen.rows[before][power]["net"]

    powers = {"run": "power_w", "walking": "walking_w"}
    return {b: {s: saved(stairs, b, p) / saved(flat, b, p) for s, p in powers.items()} for b in BEFORE}
