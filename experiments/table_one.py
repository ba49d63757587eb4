"""Table I of paper A: power of Pegasus on plain ground and on stairs, before and after, the paper's numbers beside ours.

One number is calibrated (the gear ratio: 35.4 W for `traditional` on flat ground); all others are predictions. The paper does
not define its "before": both readings stand here, and what else it might have been is a matter for `experiments.baselines`.
"""

from pathlib import Path
from typing import Any

import numpy as np

from experiments.common import setup, training, write
from experiments.slow_walk import SPEED, STAND, STAND_SHARE, Trace, mean_over_time, power_over_time, search_gait, slow, walks
from jaxleg.energy import CONVENTIONS, cost_of_transport
from jaxleg.search.config import PARAMETERS, Study, baseline
from jaxleg.search.lanes import Lab
from jaxleg.viz.power import draw_power

PAPER = {
    "flat": {"power_before_w": 35.4, "power_after_w": 31.8, "saving": 0.102, "saving_of_sums": 0.120, "cot": 7.68},
    "stairs": {"power_before_w": 37.8, "power_after_w": 35.2, "saving": 0.069, "saving_of_sums": 0.0794, "cot": 8.2},
}
BEFORE = ("traditional", "implied")
NAMES = (*BEFORE, "paper", "ours")


def table(kind: str, quick: bool, names: tuple[str, ...] = NAMES) -> tuple[Study, Lab, dict[str, np.ndarray], dict[str, Any]]:
    """Walk contestants on a kind of terrain; returns study, lab, their parameters and the rows, and prints them."""
    study, lab = slow(*setup(), 9 if quick else 24)
    lanes = training(study, lab, kind)
    count = 1 if kind == "flat" else (2 if quick else lanes.number)
    vectors = {name: search_gait(study, lab, kind, quick) if name == "ours" else baseline(study, kind, name) for name in names}
    many = lanes.take(np.tile(np.arange(count), len(names)))
    stand = STAND if kind == "stairs" else 0.0
    trace = walks(lab, np.repeat(list(vectors.values()), count, axis=0), many, cycles=3 if kind == "flat" else 2, stand=stand)
    rows = {name: row(lab, trace, slice(i * count, (i + 1) * count), stand) for i, name in enumerate(names)}
    show(kind, rows)
    return study, lab, vectors, {"kind": kind, "rows": rows, "trace": (trace, count, stand)}


def row(lab: Lab, trace: Trace, lanes: slice, stand: float) -> dict[str, Any]:
    """Mean power [W] by convention walking, standing and over the paper's run; speed, COT, falls, margin of one contestant."""
    walk, still, run = {}, {}, {}
    time = np.asarray(trace.record.time[lanes])
    share = STAND_SHARE if stand else 0.0
    for convention in CONVENTIONS:
        power = power_over_time(lab.robot, _some(trace, lanes), convention)
        walk[convention] = float(np.mean([mean_over_time(p, t, stand) for p, t in zip(power, time)]))
        end, begin = (stand, 0.5) if stand else (1.0, 0.5)
        still[convention] = float(np.mean([mean_over_time(p, t, begin, end) for p, t in zip(power, time)])) if stand else None
        run[convention] = share * (still[convention] or 0.0) + (1.0 - share) * walk[convention]
    meters = trace.meters
    speed = float(np.mean(meters.distance[lanes] / (meters.time[lanes] - stand)))
    cot = float(cost_of_transport(run["net"] / speed, lab.robot.mass))
    safety = {"falls": int(np.sum(meters.fell[lanes])), "min_stability_margin": float(np.min(meters.margin[lanes]))}
    return {"power_w": run, "walking_w": walk, "stand_power_w": still, "speed": speed, "cot": cot} | safety


def _some(trace: Trace, lanes: slice):
    return type(trace.record)(*(x[lanes] for x in trace.record))


def show(kind: str, rows: dict[str, Any]) -> None:
    """Print the rows, the paper's power beside."""
    paper = PAPER[kind]
    print(f"{kind}, {SPEED} m/s, net power [W] (paper: {paper['power_before_w']} before, {paper['power_after_w']} after)")
    print(
        f"{'':13s}{'run':>7s}{'walking':>9s}{'standing':>10s}{'positive':>10s}{'absolute':>10s}{'COT':>7s}{'margin':>8s}  falls"
    )
    for name, r in rows.items():
        still = "" if r["stand_power_w"]["net"] is None else f"{r['stand_power_w']['net']:.1f}"
        numbers = f"{r['power_w']['net']:7.1f}{r['walking_w']['net']:9.1f}{still:>10s}"
        others = (
            f"{r['power_w']['positive']:10.1f}{r['power_w']['absolute']:10.1f}{r['cot']:7.2f}{r['min_stability_margin']:8.3f}"
        )
        print(f"{name:13s}{numbers}{others}{r['falls']:7d}")


def result(kind: str, rows: dict[str, Any], vectors: dict[str, np.ndarray]) -> dict[str, Any]:
    """The paper's numbers and ours, per baseline: power before and after, with our parameters, savings under "net"."""
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
            "cot": {name: rows[name]["cot"] for name in power},
        }
    params = {name: dict(zip(PARAMETERS, map(float, vector))) for name, vector in vectors.items()}
    return {"paper": PAPER[kind], "ours": ours, "contestants": rows, "params": params, "speed": SPEED}


def finish(name: str, out: Path | None, seen: dict[str, Any], content: dict[str, Any], lab: Lab) -> None:
    """Print the savings, write result.json and the figure of power against time."""
    for before, r in content["ours"].items():
        print(f"against {before}: the paper's parameters save {100 * r['saving']['paper']:.1f} %", end=" ")
        print(f"(paper says {100 * content['paper']['saving']:.1f} %), ours {100 * r['saving']['ours']:.1f} %")
    write(name, out, content)
    trace, count, stand = seen["trace"]
    kept = type(trace.record)(*(x[::count] for x in trace.record))
    power = power_over_time(lab.robot, kept, "net")
    draw_power(np.asarray(kept.time), dict(zip(NAMES, power)), stand, (out or Path("runs") / name) / "power.png")


def saving_ratio(flat: dict[str, Any], stairs: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Saving on stairs over that on flat ground, the paper's parameters against each baseline: the run with its stand, and
    walking alone."""

    def saved(rows, before, power):
        return 1.0 - rows["paper"][power]["net"] / rows[before][power]["net"]

    spans = {"run": "power_w", "walking": "walking_w"}
    return {b: {s: saved(stairs, b, p) / saved(flat, b, p) for s, p in spans.items()} for b in BEFORE}
