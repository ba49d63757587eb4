"""Blind swings over random terrain (paper B, Table II): the machine as printed and extended, in two readings of the terrain.

The paper has ten terrains a row; here are 10,000, in batches, with 95 % intervals. The calibrated reading draws the
spline's knots from [3 - 0.4 h-, 3 + 0.4 h+] under a map 7.5 high, the literal one from [3 - h-, 3 + h+] under 8. A support is
reachable if the end interval holds a window at least 0.02 wide, with slopes below 45 deg, between z- and z+, which the foot can
get to under z+.

    python -m experiments.blind_swing [--quick]
"""

from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import timed, write
from experiments.plain_swing import plain_swing
from jaxleg.batch import shared_out
from jaxleg.cli import configure_jax
from jaxleg.swing.blind import Swing, blind_swings
from jaxleg.swing.machine import Machine, Mode, Step, extended, printed
from jaxleg.swing.profile import Profile, height, natural_spline, slope
from jaxleg.swing.trace import blind_trace
from jaxleg.viz.swing import SwingPicture, draw_swings

ROWS = ((2, 0), (4, 0), (4, 2))  # h+, h-
READINGS = {"calibrated": (0.4, 7.5), "literal": (1.0, 8.0)}  # amplitude, z+
PAPER = {  # step, collisions, path, success with and without adjustment [%]
    (2, 0): (7.53, 0.0, 8.20, 100, 100),
    (4, 0): (7.11, 1.7, 10.03, 90, 10),
    (4, 2): (6.48, 2.6, 14.76, 80, 0),
}
STEP = Step(np.array([0.0, 3.0]), np.array([8.0, 3.0]))
GRID = 0.02  # grid on which a reachable support is looked for


class Machines(NamedTuple):
    """A kind of machine and its name."""

    name: str
    make: Any


MACHINES = (
    Machines("printed", printed),
    Machines("extended", extended),
    Machines("extended, stations from the left", lambda **changes: extended(coarse_to_fine=False, **changes)),
)


def main(out: Path | None = None, quick: bool = False) -> None:
    """Swing on all rows, readings and machines; `quick` takes 500 terrains each."""
    jax.config.update("jax_enable_x64", True)
    configure_jax()
    count, rows = 500 if quick else 10_000, []
    print(
        f"{'terrain':24s}{'machine':34s} step    path   adjustments  collisions  success %          first %  reachable, found %"
    )
    for reading, (amplitude, top) in READINGS.items():
        for above, below in ROWS:
            heights = terrains(count, above, below, amplitude)
            possible = reachable(heights, top)
            seen = {}
            for machine in MACHINES:
                content, seen[machine.name] = row(machine.make(high=top), heights, possible)
                rows.append(content)
                rows[-1] |= {"reading": reading, "machine": machine.name, "h_plus": above, "h_minus": below}
                rows[-1] |= {"paper": papers(PAPER[above, below], rows[-1])}
                show(rows[-1])
            coarse, left = (seen[MACHINES[k].name].adjustments.astype(float) for k in (1, 2))
            rows[-2]["adjustments_saved_by_order"] = saved = interval(left - coarse)
            span = np.round(saved["ci95"], 3)
            print(f"{'':24s}coarse to fine takes {saved['mean']:.3f} {span} adjustments less than from the left")
    ratio = against_python(terrains(30, 4, 2, 0.4), rows)
    print(f"a blind swing is {ratio:.0f} times as fast as plain Python's (printed, calibrated, h+ 4, h- 2)")
    write("blind_swing", out, {"rows": rows, "times_python": ratio, "n": count})
    pictures(terrains(count, 4, 2, 0.4), 7.5, (out or Path("runs") / "blind_swing") / "swings.png")


def terrains(count: int, above: float, below: float, amplitude: float) -> np.ndarray:
    """Knot heights (count, 15); the start lies at height 3."""
    heights = np.random.default_rng(0).uniform(3 - amplitude * below, 3 + amplitude * above, (count, 15))
    heights[:, 0] = 3.0
    return heights


def swings(machine: Machine, count: int) -> Any:
    """So many swings at once: knot heights -> `Swing`s."""
    step = Step(*map(jnp.asarray, STEP))
    return shared_out(
        lambda heights: blind_swings(machine, step, jax.vmap(natural_spline)(heights)), -(-count // jax.device_count())
    )


def row(machine: Machine, heights: np.ndarray, possible: np.ndarray) -> tuple[dict[str, Any], Swing]:
    """Means and 95 % intervals over the terrains with the time of all swings once compiled, and the swings."""
    call = swings(machine, len(heights))
    seen: Swing = call(heights)
    seconds = timed(call, heights)
    found = seen.exit == Mode.SUPPORTED
    share = float(found[possible].mean()) if possible.any() else None
    rest = {"reachable": float(possible.mean()), "reachable_found": share}
    return means(seen) | rest | {"seconds": seconds}, seen


def means(seen: Swing) -> dict[str, Any]:
    """Means with 95 % intervals over swings, and how many ended oddly; a failed step has no length, its path the return."""
    found = seen.exit == Mode.SUPPORTED
    values = {
        "step_length": np.where(found, seen.point[:, 0], 0.0),
        "path_length": seen.length,
        "time": seen.time,
        "adjustments": seen.adjustments.astype(float),
        "collisions": seen.collisions.astype(float),
        "success": found.astype(float),
        "success_without_adjustment": (found & (seen.adjustments == 0)).astype(float),
    }
    odd = {"stalled": seen.exit == Mode.STALLED, "lost": seen.lost, "struck": seen.struck}
    counts = {name: int(np.sum(x)) for name, x in odd.items()}
    return {name: interval(x) for name, x in values.items()} | counts | {"n": len(found)}


def interval(values: np.ndarray) -> dict[str, Any]:
    """Mean with its 95 % interval (normal) and the spread of single values."""
    std = float(values.std(ddof=1))
    mean, half = float(values.mean()), 1.96 * std / np.sqrt(len(values))
    return {"mean": mean, "ci95": [mean - half, mean + half], "std": std}


def papers(numbers: tuple[float, ...], ours: dict[str, Any]) -> dict[str, Any]:
    """The paper's numbers (means of ten, successes in percent) with the 95 % interval that ten terrains leave them.

    For means by the spread over our terrains, for successes Wilson's; and whether our mean lies within.
    """
    names = ("step_length", "collisions", "path_length", "success", "success_without_adjustment")
    rows = {}
    for name, number in zip(names, numbers, strict=False):
        if name.startswith("success"):
            low, high = wilson(number / 100.0, 10)
            value = number / 100.0
        else:
            value, half = number, 1.96 * ours[name]["std"] / np.sqrt(10)
            low, high = number - half, number + half
        rows[name] = {"value": value, "ci95_n10": [low, high], "ours_within": bool(low <= ours[name]["mean"] <= high)}
    return rows


def wilson(share: float, count: int) -> tuple[float, float]:
    """95 % interval of a share seen in so many samples (Wilson's score)."""
    z = 1.96
    centre, scale = share + z * z / (2 * count), 1.0 + z * z / count
    half = z * np.sqrt(share * (1.0 - share) / count + z * z / (4 * count**2))
    return float((centre - half) / scale), float((centre + half) / scale)


def reachable(heights: np.ndarray, top: float) -> np.ndarray:
    """Whether each terrain has a support that the foot can get to, on a fine grid; the map's lower bound is 0."""
    x = jnp.arange(0.0, 9.0 + 0.5 * GRID, GRID / 4)

    @jax.jit
    @jax.vmap
    def look(knots):
        spline: Profile = natural_spline(knots)
        ground, steep = height(spline, x), jnp.abs(slope(spline, x)) > 1.0
        open_way = jnp.cumsum(ground >= top) == 0
        good = (x >= 7.0) & ~steep & (ground >= 0.0) & (ground <= top) & open_way
        return jnp.any(jnp.convolve(good.astype(float), jnp.ones(5), mode="valid") > 4.5)  # five points span GRID

    return np.asarray(look(jnp.asarray(heights)))


def pictures(heights: np.ndarray, top: float, path: Path) -> None:
    """The roughest calibrated row: a typical and a bad swing as printed, the extended machine there and at its own worst."""
    machines = {"printed": printed(high=top), "extended": extended(high=top)}
    seen: dict[str, Swing] = {name: swings(machine, len(heights))(heights) for name, machine in machines.items()}
    adjusts = np.flatnonzero((seen["printed"].adjustments > 0) & (seen["printed"].exit == Mode.SUPPORTED))
    fails = np.flatnonzero(seen["printed"].exit == Mode.RETURNED)
    typical = adjusts[np.argsort(seen["printed"].length[adjusts])[len(adjusts) // 2]]
    bad = fails[np.argmax(seen["printed"].length[fails])]
    worst = int(np.argmax(seen["extended"].adjustments))
    chosen = (
        ("printed", typical, "printed, typical"),
        ("printed", bad, "printed, longest failure"),
        ("extended", bad, "extended, same terrain"),
        ("extended", worst, "extended, its worst"),
    )
    step, x = Step(*map(jnp.asarray, STEP)), np.linspace(-0.8, 10.0, 800)

    def panel(name, k, what):
        profile, swing = natural_spline(jnp.asarray(heights[k])), seen[name]
        how = Mode(swing.exit[k]).name.lower()
        title = f"{what}: {how},\npath {swing.length[k]:.1f}, {swing.adjustments[k]} adjustments"
        trace = blind_trace(machines[name], step, profile, 256)
        return SwingPicture(title, trace, x, np.asarray(height(profile, jnp.asarray(x))), (7.0, 9.0))

    draw_swings([panel(*which) for which in chosen], path)


def show(r: dict[str, Any]) -> None:
    """One line of the table."""
    first, success = 100 * r["success_without_adjustment"]["mean"], r["success"]
    numbers = f"{r['step_length']['mean']:5.2f}  {r['path_length']['mean']:6.2f}  {r['adjustments']['mean']:9.2f}  "
    share = f"{100 * success['mean']:6.2f} [{100 * success['ci95'][0]:.1f}, {100 * success['ci95'][1]:.1f}]"
    found = "-" if r["reachable_found"] is None else f"{100 * r['reachable_found']:.2f}"
    name = f"{r['reading']} h+ {r['h_plus']} h- {r['h_minus']}"
    beyond = ", ".join(k for k, p in r["paper"].items() if not p["ours_within"]) if r["reading"] == "calibrated" else ""
    rest = f"{r['collisions']['mean']:9.2f}    {share:20s}{first:6.1f}    {found}  {r['seconds']:.1f} s"
    rest += f"  beyond the paper's n = 10: {beyond}" if beyond and r["machine"] == "printed" else ""
    print(f"{name:24s}{r['machine']:34s}{numbers}{rest}")


def against_python(heights: np.ndarray, rows: list[dict[str, Any]]) -> float:
    """Plain Python's time a swing over the batched one's."""
    plain = timed(lambda: [plain_swing(knots) for knots in heights], repeats=5) / len(heights)
    ours = next(r for r in rows if (r["reading"], r["machine"], r["h_minus"]) == ("calibrated", "printed", 2))
    return plain / (ours["seconds"] / ours["n"])


if __name__ == "__main__":
    tyro.cli(main)
