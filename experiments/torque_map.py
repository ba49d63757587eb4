"""Is paper A's torque-saving workspace the best of its size? Torque maps of both knee branches (paper A, Fig. 4).

The paper suggests H_COG 0.48-0.52 m with the foot 0.20-0 m behind the hip, between the lines where one joint needs no
torque. Measured here: those lines by bisection against their closed form, and the mean of |thigh| + |knee| and of
thigh^2 + knee^2 over its workspace beside the best workspace of the same size, every point of which keeps a least knee
bend: slid along L_F2H at the paper's heights, and free in height too.

    python -m experiments.torque_map [--quick]
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import write
from jaxleg.cli import configure_jax
from jaxleg.gait.limits import leg_length
from jaxleg.leg.statics import knee_zero_line, leg_torque, torque_map
from jaxleg.leg.workspace import Cost, Workspace, allowed_means, best_window, centres, cost, keeps_bend, mean_cost
from jaxleg.robot import Robot, load_robot
from jaxleg.viz.torque_map import best_workspaces, half_planes

ROBOT = Path(__file__).parent.parent / "configs" / "robots" / "pegasus.toml"
FORCE = 86.2  # [N], a leg's share at rest, printed
PAPER = Workspace(-0.20, 0.0, 0.48, 0.52)  # [m], printed
FOOT, HEIGHT = (-0.40, 0.40), (0.26, 0.60)  # where workspaces are looked for [m]
BENDS = (20, 35)  # least knee bend [deg]
LINE_HEIGHTS = np.linspace(0.28, 0.58, 31)  # where the lines are measured [m]
HERE, FREE = "at_paper_heights", "free_height"


def main(out: Path | None = None, quick: bool = False) -> None:
    """Print and draw everything; cells of 1 mm (2 mm with `quick`)."""
    configure_jax()
    jax.config.update("jax_enable_x64", True)
    robot, size = load_robot(ROBOT), 0.002 if quick else 0.001
    branches = {"backward": robot, "forward": dataclasses.replace(robot, knee_sign=-robot.knee_sign)}
    errors = {name: line_errors(branch) for name, branch in branches.items()}
    errors["forward_is_mirrored_n_m"] = mirror_error(*branches.values())
    best = search(robot, size)
    paper = {name: float(value) for name, value in mean_cost(robot, PAPER, FORCE, window(size))._asdict().items()}
    report(errors, best, paper)
    folder = out or Path("runs") / "torque_map"
    draw(branches, best, size, folder)
    write("torque_map", out, {"line_errors": errors, "cell_m": size, **summary(best, paper)})


def line_errors(robot: Robot) -> dict[str, float]:
    """Largest distance [m] of the lines without thigh and knee torque, found by bisection, from x = 0 and (A5)."""
    reach = jnp.sqrt(leg_length(robot) ** 2 - LINE_HEIGHTS**2)
    knee = jax.vmap(lambda h, end: root(lambda x: leg_torque(robot, x, h, FORCE).knee, end, 0.0 * end))
    thigh = jax.vmap(lambda h, end: root(lambda x: leg_torque(robot, x, h, FORCE).thigh, -0.9 * end, 0.8 * end))
    heights = jnp.asarray(LINE_HEIGHTS)
    away = knee(heights, -robot.knee_sign * reach) - knee_zero_line(robot, heights)
    return {"thigh_m": float(jnp.max(jnp.abs(thigh(heights, reach)))), "knee_m": float(jnp.max(jnp.abs(away)))}


def root(function, start: jax.Array, end: jax.Array, halvings: int = 60) -> jax.Array:
    """Where `function` changes sign between `start` and `end`, by bisection."""
    sign = jnp.sign(function(start))

    def halve(_, bracket):
        middle = 0.5 * (bracket[0] + bracket[1])
        near = jnp.sign(function(middle)) == sign
        return jnp.where(near, middle, bracket[0]), jnp.where(near, bracket[1], middle)

    return sum(jax.lax.fori_loop(0, halvings, halve, (start, end))) / 2


def mirror_error(backward: Robot, forward: Robot) -> float:
    """Largest difference [N m] between one branch's torques and the other's mirror image."""
    x, h = centres(*FOOT, 80), centres(*HEIGHT, 34)
    ours, other = (jax.jit(torque_map)(robot, x, h, FORCE) for robot in (backward, forward))
    differences = [jnp.abs(a) - jnp.abs(b)[::-1] for a, b in zip(ours[:2], other[:2])]
    return float(max(jnp.max(jnp.abs(jnp.where(ours.reachable, difference, 0.0))) for difference in differences))


def window(size: float) -> tuple[int, int]:
    """The paper's workspace in cells of `size` [m]."""
    return round((PAPER.ahead - PAPER.behind) / size), round((PAPER.high - PAPER.low) / size)


class Map(NamedTuple):
    """Cell centres along both axes [m] and the cost at each."""

    x: jax.Array
    h: jax.Array
    cost: Cost


class Found(NamedTuple):
    """The best workspace of the paper's size [m] and the mean of the criterion over it."""

    workspace: Workspace
    mean: float


def make_map(robot: Robot, size: float, height: tuple[float, float]) -> Map:
    """The costs over the range searched, in cells of `size` [m]."""
    x, h = (centres(*span, round((span[1] - span[0]) / size)) for span in (FOOT, height))
    return Map(x, h, cost(jax.jit(torque_map)(robot, x, h, FORCE)))


Table = dict[str, dict[str, dict[str, Found]]]


def search(robot: Robot, size: float) -> Table:
    """The best workspaces: `[criterion][least bend in degrees][freedom]`."""
    spans = {HERE: (PAPER.low, PAPER.high), FREE: HEIGHT}
    grids = {freedom: make_map(robot, size, span) for freedom, span in spans.items()}
    return {
        name: {
            str(bend): {freedom: best_of(robot, grid, name, bend, size, spans[freedom][0]) for freedom, grid in grids.items()}
            for bend in BENDS
        }
        for name in Cost._fields
    }


def best_of(robot: Robot, grid: Map, criterion: str, bend: float, size: float, low: float) -> Found:
    """The best workspace within a map that begins at height `low` [m], least knee bend `bend` [deg]."""
    allowed = keeps_bend(robot, grid.x, grid.h, size, np.deg2rad(bend))
    found = best_window(getattr(grid.cost, criterion), allowed, window(size))
    return Found(placed(FOOT[0] + size * int(found.x), low + size * int(found.h)), float(found.mean))


def placed(behind: float, low: float) -> Workspace:
    """The paper's workspace moved to another corner [m]."""
    ends = behind, behind + PAPER.ahead - PAPER.behind, low, low + PAPER.high - PAPER.low
    return Workspace(*(round(end, 4) for end in ends))


def each(best: Table, function: Callable[[str, Found], Any]) -> dict[str, Any]:
    """The table with `function(criterion, found)` at each entry."""
    return {
        name: {bend: {freedom: function(name, found) for freedom, found in by.items()} for bend, by in table.items()}
        for name, table in best.items()
    }


def summary(best: Table, paper: dict[str, float]) -> dict[str, Any]:
    """What result.json holds of the search; the paper prints its workspace and no mean."""
    here = {name: table["35"][HERE].workspace for name, table in best.items()}
    return {
        "workspace_paper": PAPER._asdict(),
        "workspace_best": each(best, lambda _, found: found.workspace._asdict()),
        "mean_torque": {
            "paper": paper,
            "best": each(best, lambda _, found: found.mean),
            "paper_over_best": each(best, lambda name, found: paper[name] / found.mean),
        },
        "paper": {"L_F2H": PAPER[:2], "H_COG": PAPER[2:]},
        "ours": {name: {"L_F2H": found[:2], "H_COG": found[2:]} for name, found in here.items()},
    }


def report(errors: dict[str, Any], best: Table, paper: dict[str, float]) -> None:
    """The table on the terminal."""
    for branch in ("backward", "forward"):
        print(f"{branch} knee: lines off by {errors[branch]['thigh_m']:.1e} (thigh), {errors[branch]['knee_m']:.1e} m (knee)")
    print(f"forward against the mirrored backward map: {errors['forward_is_mirrored_n_m']:.1e} N m")
    print("criterion  bend  freedom            L_F2H [m]       H_COG [m]      mean    paper's  paper / best")
    for name, table in best.items():
        for bend, by in table.items():
            for freedom, found in by.items():
                place = "{:6.3f} {:6.3f}   {:5.3f} {:5.3f}".format(*found.workspace)
                means = f"{found.mean:8.2f} {paper[name]:8.2f}  {paper[name] / found.mean:.4f}"
                print(f"{name:9s}  {bend:>4s}  {freedom:16s}  {place}  {means}")


def draw(branches: dict[str, Robot], best: Table, size: float, folder: Path) -> None:
    """Both figures."""
    mirrored = Workspace(-PAPER.ahead, -PAPER.behind, PAPER.low, PAPER.high)
    half_planes(branches, FORCE, {"backward": PAPER, "forward": mirrored}, folder / "torque_map.png")
    shown = {
        name: {
            "best at the paper's heights": table["35"][HERE].workspace,
            "best at any height, knee bend at least 35 deg": table["35"][FREE].workspace,
            "best at any height, knee bend at least 20 deg": table["20"][FREE].workspace,
        }
        for name, table in best.items()
    }
    robot = branches["backward"]
    best_workspaces(robot, FORCE, PAPER, shown, slides(robot, size), BENDS, folder / "workspaces.png")


def slides(robot: Robot, size: float) -> dict[str, np.ndarray]:
    """Mean over the paper's workspace slid along L_F2H: columns rear end [m] and mean, while it keeps the least bend."""
    grid = make_map(robot, size, (PAPER.low, PAPER.high))
    allowed = keeps_bend(robot, grid.x, grid.h, size, np.deg2rad(min(BENDS)))
    curves = {}
    for name, values in grid.cost._asdict().items():
        mean = np.asarray(allowed_means(values, allowed, window(size)))[:, 0]
        curves[name] = np.stack([FOOT[0] + size * np.arange(len(mean)), mean], axis=1)[np.isfinite(mean)]
    return curves


if __name__ == "__main__":
    tyro.cli(main)
