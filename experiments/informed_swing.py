"""Informed swings over random terrain (paper B, Table III): three planners, with maps that are right or wrong.

The terrain is that of the table's (h+, h-) = (4, 0); the map has three of its first ten knots lowered by dh, as the paper's.
Readings as in `blind_swing`. With a map that is right (dh = 0) the way is compared with the shortest to any support in the end
interval, found independently in plain Python.

    python -m experiments.informed_swing [--quick]
"""

from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from scipy.interpolate import CubicSpline

from experiments.blind_swing import READINGS, STEP, means, papers, terrains
from experiments.common import timed, write
from jaxleg.batch import shared_out
from jaxleg.cli import configure_jax
from jaxleg.swing.informed import Informed, informed_swings
from jaxleg.swing.localmap import points, sampled
from jaxleg.swing.machine import Machine, Mode, Step, extended, printed
from jaxleg.swing.planner import RoutePlanner, as_printed, cautious, repaired, shortest
from jaxleg.swing.profile import height, natural_spline
from jaxleg.swing.trace import informed_trace
from jaxleg.viz.swing import SwingPicture, draw_swings

ERRORS = (0, 1, 2, 3)  # dh
PAPER = {0: (7.48, 0.0, 9.11), 1: (7.45, 0.5, 9.73), 2: (7.48, 1.1, 10.34), 3: (7.42, 1.4, 13.37)}
MAP = (-0.5, 9.5, 201)  # from, to, points
ORACLE = 1000  # terrains on which the shortest way is sought


class Strategy(NamedTuple):
    """A machine with a planner, and their name."""

    name: str
    machine: Any
    planner: Any  # called once JAX is configured


STRATEGIES = (
    Strategy("field as printed", printed, as_printed),
    Strategy("field repaired", printed, repaired),
    Strategy("taut string", printed, shortest),
    Strategy("taut string, cautious", printed, cautious),
    Strategy("the same, extended machine", extended, cautious),
)


def main(out: Path | None = None, quick: bool = False) -> None:
    """Swing with all strategies, readings and map errors; `quick` takes 300 terrains each."""
    jax.config.update("jax_enable_x64", True)
    configure_jax()
    count, rows = 300 if quick else 10_000, []
    print(
        f"{'terrain':20s}{'strategy':28s} step    path   collisions  success %             first route found %  over shortest"
    )
    for reading, (amplitude, top) in READINGS.items():
        heights = terrains(count, 4, 0, amplitude)
        ways = np.array([shortest_way(knots) for knots in heights[:ORACLE]])
        for strategy in STRATEGIES:
            call = swings(strategy.machine(high=top), strategy.planner(), count)
            for error in ERRORS:
                seen: Informed = call(heights, lowered(heights, error))
                rows.append(means(seen.swing) | planned(seen, ways if error == 0 else None))
                rows[-1] |= {"reading": reading, "planner": strategy.name, "machine": strategy.machine.__name__, "dh": error}
                rows[-1] |= {"paper": papers(PAPER[error], rows[-1]), "h_plus": 4, "h_minus": 0}
                show(rows[-1])
            rows[-1]["seconds"] = timed(call, heights, lowered(heights, ERRORS[-1]), repeats=1)
            print(f"{'':48s}{count} swings in {rows[-1]['seconds']:.1f} s")
    write("informed_swing", out, {"rows": rows, "n": count})
    pictures(terrains(count, 4, 0, 0.4), 7.5, (out or Path("runs") / "informed_swing") / "swings.png")


def lowered(heights: np.ndarray, error: float) -> np.ndarray:
    """The map's knots: three of the first ten lie lower by the error."""
    order = np.argsort(np.random.default_rng(1).random((len(heights), 10)), axis=1)
    map_heights = heights.copy()
    map_heights[np.arange(len(heights))[:, None], order[:, :3]] -= error
    return map_heights


def swings(machine: Machine, planner: RoutePlanner, count: int) -> Any:
    """So many swings at once: knot heights of terrain and map -> `Informed`."""
    step = Step(*map(jnp.asarray, STEP))

    def batch(heights, believed):
        local = jax.vmap(lambda knots: sampled(natural_spline(knots), *MAP))(believed)
        return informed_swings(machine, planner, step, jax.vmap(natural_spline)(heights), local)

    return shared_out(batch, -(-count // jax.device_count()))


def planned(seen: Informed, ways: np.ndarray | None) -> dict[str, Any]:
    """How often the planner found no route, and how much longer than the shortest the way was where a support was found."""
    numbers = {"route_at_first": float(np.mean(seen.at_first)), "unplanned": float(np.mean(seen.unplanned))}
    if ways is None:
        return numbers
    both = (seen.swing.exit[:ORACLE] == Mode.SUPPORTED) & np.isfinite(ways)
    return numbers | {"over_shortest": float(np.mean(seen.swing.length[:ORACLE][both]) / np.mean(ways[both]))}


def pictures(heights: np.ndarray, top: float, path: Path) -> None:
    """Calibrated terrains: the field and the taut string with a right map, the cautious one with a wrong map."""
    step, x, machine = Step(*map(jnp.asarray, STEP)), np.linspace(-0.6, 10.0, 800), printed(high=top)
    wrong, rows = lowered(heights, 3.0), len(heights)
    field, taut = (swings(machine, planner, rows)(heights, heights) for planner in (as_printed(), shortest()))
    careful = swings(machine, cautious(), rows)(heights, wrong)
    stuck = np.flatnonzero(~field.at_first & (field.swing.exit == Mode.SUPPORTED))[0]
    ordered = np.argsort(careful.swing.length)
    worst = ordered[careful.swing.exit[ordered] == Mode.SUPPORTED][-1]
    hits = np.flatnonzero((careful.swing.collisions == 1) & (careful.swing.exit == Mode.SUPPORTED))[0]
    chosen = (
        ("field as printed, stuck at first", as_printed(), field, stuck, heights),
        ("taut string, right map", shortest(), taut, stuck, heights),
        ("cautious, map wrong by 3, one collision", cautious(), careful, hits, wrong),
        ("cautious, map wrong by 3, longest", cautious(), careful, worst, wrong),
    )

    def panel(what, planner, seen, k, believed):
        profile, local = natural_spline(jnp.asarray(heights[k])), sampled(natural_spline(jnp.asarray(believed[k])), *MAP)
        title = f"{what}:\npath {seen.swing.length[k]:.1f}"
        drawn = informed_trace(machine, planner, step, profile, local)
        ground = np.asarray(height(profile, jnp.asarray(x)))
        view = None if believed is heights else (np.asarray(points(local)), np.asarray(local.ground))
        return SwingPicture(title, drawn, x, ground, (7.0, 9.0), view)

    draw_swings([panel(*which) for which in chosen], path)


def shortest_way(knots: np.ndarray, spacing: float = 0.01) -> float:
    """Shortest way over the terrain to any support in the end interval: a stack of the hull's corners, point by point."""
    terrain = CubicSpline(np.arange(len(knots)), knots, bc_type="natural")
    x = np.arange(0.0, 9.0 + 0.5 * spacing, spacing)
    z, steep, stack, best = terrain(x), np.abs(terrain(x, 1)), [(0.0, float(knots[0]), 0.0)], np.inf
    for to in zip(x[1:], z[1:], steep[1:], strict=True):
        while len(stack) > 1 and _bends_up(stack[-2], stack[-1], to):
            stack.pop()
        stack.append((to[0], to[1], stack[-1][2] + np.hypot(to[0] - stack[-1][0], to[1] - stack[-1][1])))
        if to[0] >= 7.0 and to[2] < 1.0:
            best = min(best, stack[-1][2])
    return best


def _bends_up(a, b, c):
    return (b[1] - a[1]) * (c[0] - a[0]) <= (c[1] - a[1]) * (b[0] - a[0])


def show(r: dict[str, Any]) -> None:
    """One line of the table."""
    success, terrain = r["success"], f"{r['reading']} dh {r['dh']}"
    share = f"{100 * success['mean']:6.2f} [{100 * success['ci95'][0]:.1f}, {100 * success['ci95'][1]:.1f}]"
    numbers = f"{r['step_length']['mean']:5.2f}  {r['path_length']['mean']:6.2f}  {r['collisions']['mean']:9.3f}"
    over = f"{r['over_shortest']:.3f}" if "over_shortest" in r else ""
    print(f"{terrain:20s}{r['planner']:28s}{numbers}    {share:24s}{100 * r['route_at_first']:9.1f}            {over}")


if __name__ == "__main__":
    tyro.cli(main)
