"""Which steps and search lengths do paper A's gait constraints (4)-(7) allow, and which one binds?

The paper works them out at H_COG 0.50 m and a step of 0.2 m (IV.A): L_Step < 0.33 m by (6), L_Search < 0.4 m by (5) and
< 0.56 m by (7). It picks L_Step 0.2 m and L_Search 0.3 m.

    python -m experiments.gait_region [--quick]
"""

from pathlib import Path
from typing import Any

import jax
import tyro

from experiments.common import write
from jaxleg.cli import configure_jax
from jaxleg.gait.limits import Binding, gait_constraints, gait_region, search_limit, step_limit
from jaxleg.robot import Robot, load_robot
from jaxleg.viz.stance import gait_regions

ROBOT = Path(__file__).parent.parent / "configs" / "robots" / "pegasus.toml"
PAPER = {"step_by_6": 0.33, "search_by_5": 0.40, "search_by_7": 0.56}  # [m], printed to this many digits
HEIGHT, STEP, SEARCH = 0.50, 0.20, 0.30  # H_COG of the paper's numbers and its choice [m]
HEIGHTS = (0.44, 0.50, 0.56)
LINE = (
    "H_COG {hip_height:.2f} m: step < {step:.3f} m, search < {search:.3f} m by {binding}; "
    "the paper's choice has {slack:.3f} m left to {slack_binding}"
)


def main(out: Path | None = None, quick: bool = False) -> None:
    """Print the limits beside the paper's and draw the region at three heights; `quick` changes nothing, it takes seconds."""
    del quick
    configure_jax()
    jax.config.update("jax_enable_x64", True)
    robot = load_robot(ROBOT)
    ours = limits(robot)
    print("limit [m]     paper  ours")
    for name, printed in PAPER.items():
        print(f"{name:12s}  {printed:.2f}   {ours[name]:.4f}")
    heights = [at_height(robot, height) for height in HEIGHTS]
    for row in heights:
        print(LINE.format(**row))
    folder = out or Path("runs") / "gait_region"
    gait_regions(robot, list(HEIGHTS), (STEP, SEARCH), folder / "gait_region.png")
    write("gait_region", out, {"paper": PAPER, "ours": ours, "heights": heights})


def limits(robot: Robot) -> dict[str, float]:
    """The paper's three numbers [m]."""
    slack = gait_constraints(robot, HEIGHT, STEP, 0.0)
    step = step_limit(robot, HEIGHT).length
    return dict(zip(PAPER, map(float, (step, slack.search_behind, slack.search_reach))))


def at_height(robot: Robot, height: float) -> dict[str, Any]:
    """Limits at a height for the paper's step [m], which constraint sets them, and the slack of the paper's choice."""
    search, chosen = search_limit(robot, height, STEP), gait_region(robot, height, STEP, SEARCH)
    return {
        "hip_height": height,
        "step": float(step_limit(robot, height).length),
        "search": float(search.length),
        "binding": Binding(int(search.binding)).name,
        "slack": float(chosen.slack),
        "slack_binding": Binding(int(chosen.binding)).name,
    }


if __name__ == "__main__":
    tyro.cli(main)
