"""Joint currents of the creeping gait (paper A, Fig. 2 and Section II.C): three cycles on plain ground at 0.012 m/s.

The paper's five numbers come from one leg (RH) of a robot whose gait it does not give; beside them stand the traditional
gait's, for that leg and over all four, and what moves the hip's current: the width of the stance and the trunk's sway.

    python -m experiments.creeping_currents [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, training, write
from experiments.slow_walk import Trace, currents, mean_over_time, slow, walks
from jaxleg.conventions import JOINTS, LEGS
from jaxleg.robot import Robot
from jaxleg.search.config import Cog, Study
from jaxleg.search.contestants import contestant
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.viz.power import draw_currents

PAPER = {"knee": {"mean": 1.611, "max": 5.140}, "hip": {"mean": 0.351, "max": 1.628}, "swinging_leg_below": 1.0}  # [A]
WIDTHS = (0.36, 0.30, 0.42)  # of the stance [m]; the first is the study's
SWAY_RATIO = 0.3  # way-points nearer to the crossing of the diagonals: less sway
LEG = LEGS.index("RH")
AIR = 1.0  # a foot is in the air below this normal force [N]


def main(out: Path | None = None, quick: bool = False) -> None:
    """Simulate it; `quick` changes nothing, it takes seconds anyway."""
    del quick
    study, lab = slow(*setup(), 3)
    less = dataclasses.replace(study, cog=Cog("median", SWAY_RATIO, study.cog.height_threshold))
    traces = {f"stance {width} m wide": walked(study, lab, width) for width in WIDTHS}
    traces[f"way-points at {SWAY_RATIO} of the median"] = walked(less, lab, WIDTHS[0])
    rows = {name: row(lab.robot, trace) for name, trace in traces.items()}
    print(f"{'currents [A]':52s} knee mean   max   hip mean   max   thigh mean   swinging leg's sum, at most")
    knee, hip = PAPER["knee"], PAPER["hip"]
    print(
        f"{'paper, RH':52s}   {knee['mean']:.3f}  {knee['max']:.3f}   {hip['mean']:.3f}  {hip['max']:.3f}"
        + 23 * " "
        + "below 1.0"
    )
    for name, seen in rows.items():
        for who in ("RH", "all legs"):
            about = f"{who}, {name}, sway {seen['sway_m']:.2f} m"
            numbers = "   ".join(f"{seen[who][j]['mean']:.3f}  {seen[who][j]['max']:.3f}" for j in ("knee", "hip"))
            print(f"{about:52s}   {numbers}       {seen[who]['thigh']['mean']:.3f}       {seen['swinging_leg']:.2f}")
    first = next(iter(traces.values()))
    write(
        "creeping_currents", out, {"paper": PAPER, "ours": rows, "falls": sum(int(t.meters.fell[0]) for t in traces.values())}
    )
    air, current = np.asarray(first.record.normal_force[0]) < AIR, currents(lab.robot, first.record)[0]
    path = (out or Path("runs") / "creeping_currents") / "currents.png"
    draw_currents(np.asarray(first.record.time[0]), current, air, LEG, path)


def walked(study: Study, lab: Lab, width: float) -> Trace:
    """Three cycles of the traditional gait with a stance of this width [m] (one lane)."""
    planner = with_leaves(contestant(study, "flat", "traditional"), ("gait.stance_width",), jnp.asarray([width]))
    lanes = training(study, lab, "flat").take(np.zeros(1, int))._replace(setting=settings_of(planner, 1))
    return walks(lab, read_leaves(planner, lab.move)[None], lanes, cycles=3)


def row(robot: Robot, trace: Trace) -> dict[str, Any]:
    """Mean and greatest current of each joint, of RH and of all legs, and the greatest sum of a leg in the air [A]."""
    time, current = np.asarray(trace.record.time[0]), currents(robot, trace.record)[0]
    mean = mean_over_time(np.moveaxis(current, 0, -1), time)
    air = np.asarray(trace.record.normal_force[0]) < AIR
    legs = {"RH": (mean[LEG], current[:, LEG].max(axis=0)), "all legs": (mean.mean(axis=0), current.max(axis=(0, 1)))}
    seen: dict[str, Any] = {
        who: {joint: {"mean": float(m[j]), "max": float(top[j])} for j, joint in enumerate(JOINTS)}
        for who, (m, top) in legs.items()
    }
    sway = float(np.ptp(trace.record.trunk_pos[0, :, 1]))
    return seen | {"swinging_leg": float(np.max(current.sum(axis=-1)[air])), "sway_m": sway}


if __name__ == "__main__":
    tyro.cli(main)
