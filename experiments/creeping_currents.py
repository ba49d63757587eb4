"""Joint currents of the creeping gait (paper A, Fig. 2 and Section II.C): three cycles on plain ground at 0.012 m/s.

The paper's five numbers come from one leg (RH) of a robot whose gait it does not give; beside them stand the traditional
gait's, for that leg and over all four, and what moves the hip's current: the width of the stance.

    python -m experiments.creeping_currents [--quick]
"""

from pathlib import Path
from typing import Any

import numpy as np
import tyro

from experiments.common import setup, training, write
from experiments.slow_walk import Trace, currents, mean_over_time, slow, walks
from jaxleg.conventions import JOINTS, LEGS
from jaxleg.search.config import PARAMETERS, baseline
from jaxleg.viz.power import draw_currents

PAPER = {"knee": {"mean": 1.611, "max": 5.140}, "hip": {"mean": 0.351, "max": 1.628}, "swinging_leg_below": 1.0}  # [A]
WIDTHS = (0.36, 0.30, 0.42)  # of the stance [m]; the first is the study's
LEG = LEGS.index("RH")
AIR = 1.0  # a foot is in the air below this normal force [N]


def main(out: Path | None = None, quick: bool = False) -> None:
    """Simulate in MJX; `quick` changes nothing, it takes seconds anyway."""
    del quick
    study, lab = slow(*setup(), 3)
    vectors = np.tile(baseline(study, "flat", "traditional"), (len(WIDTHS), 1))
    vectors[:, PARAMETERS.index("stance_width")] = WIDTHS
    trace = walks(lab, vectors, training(study, lab, "flat").take(np.zeros(len(WIDTHS), int)), cycles=3)
    rows = [row(currents(lab.robot, trace.record)[i], trace, i) for i in range(len(WIDTHS))]
    print("currents [A]       knee mean    max   hip mean    max   thigh mean   greatest sum of a swinging leg")
    print(
        f"paper, RH              {PAPER['knee']['mean']:.3f}  {PAPER['knee']['max']:.3f}      "
        f"{PAPER['hip']['mean']:.3f}  {PAPER['hip']['max']:.3f}                    below {PAPER['swinging_leg_below']:.1f}"
    )
    for width, seen in zip(WIDTHS, rows):
        for who in ("RH", "all legs"):
            r = seen[who]
            print(
                f"ours, {who:8s} {width:.2f} m {r['knee']['mean']:6.3f}  {r['knee']['max']:.3f}      {r['hip']['mean']:.3f}"
                f"  {r['hip']['max']:.3f}        {r['thigh']['mean']:.3f}        {seen['swinging_leg']:.2f}"
            )
    ours = {f"stance width {width} m": seen for width, seen in zip(WIDTHS, rows)}
    write("creeping_currents", out, {"paper": PAPER, "ours": ours, "falls": int(np.sum(trace.meters.fell))})
    air = np.asarray(trace.record.normal_force[0]) < AIR
    time, current = np.asarray(trace.record.time[0]), currents(lab.robot, trace.record)[0]
    draw_currents(time, current, air, LEG, (out or Path("runs") / "creeping_currents") / "currents.png")


def row(current: np.ndarray, trace: Trace, lane: int) -> dict[str, Any]:
    """Mean and greatest current of each joint, of RH and of all legs, and the greatest sum of a leg well into its swing."""
    time = np.asarray(trace.record.time[lane])
    mean = mean_over_time(np.moveaxis(current, 0, -1), time)
    air = np.asarray(trace.record.normal_force[lane]) < AIR
    legs = {"RH": (mean[LEG], current[:, LEG].max(axis=0)), "all legs": (mean.mean(axis=0), current.max(axis=(0, 1)))}
    seen: dict[str, Any] = {
        who: {joint: {"mean": float(m[j]), "max": float(top[j])} for j, joint in enumerate(JOINTS)}
        for who, (m, top) in legs.items()
    }
    return seen | {"swinging_leg": float(np.percentile(current.sum(axis=-1)[air], 99.0))}


if __name__ == "__main__":
    tyro.cli(main)
