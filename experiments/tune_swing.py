"""Searched parameters for paper B's swings, where the paper guessed: fronts of success against path length and adjustments.

Blind machines: gamma_H, l_back, N_limit of the printed one, and of the extended one gamma_H, l_back and how many stations it
probes, on the roughest literal row (h+ 4, h- 2). The cautious planner: d0, w_pre, theta_pre and the numbers of its repairs, on
calibrated terrains (4, 0) with maps wrong by 1, 2 and 3. Settings are a Sobol sequence, the paper's first; the best are refined
by ever smaller normal steps. The choice is made on training terrains, the comparison on others.

    python -m experiments.tune_swing [--quick]
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from scipy.stats import qmc

from experiments.blind_swing import STEP, interval, terrains
from experiments.common import write
from experiments.informed_swing import MAP, lowered
from jaxleg.batch import shared_out
from jaxleg.cli import configure_jax
from jaxleg.swing.blind import Swing, blind_swings
from jaxleg.swing.informed import informed_swings
from jaxleg.swing.localmap import sampled
from jaxleg.swing.machine import Machine, Mode, Step, extended, printed
from jaxleg.swing.planner import RoutePlanner, cautious
from jaxleg.swing.profile import natural_spline
from jaxleg.viz.swing import draw_front

LITERAL, CALIBRATED = 8.0, 7.5  # z+
BLIND = {"height_share": (0.1, 1.0), "back": (0.1, 1.5)}
LIMIT, STATIONS = (1.0, 12.0), (3, 5, 9, 17, 33, 257)
PLANNER = {
    "clearance": (0.03, 0.55),
    "half_width": (0.05, 1.5),
    "ramp": (0.3, 4.0),
    "reach": (0.2, 2.5),
    "margin": (0.05, 0.8),
    "gentle": (0.2, 0.95),
    "press": (0.01, 0.3),
}
Evaluate = Callable[[np.ndarray], tuple[float, float, float]]  # settings -> success, path length, adjustments


def main(out: Path | None = None, quick: bool = False) -> None:
    """Search all three; `quick` takes 500 terrains and a few settings."""
    jax.config.update("jax_enable_x64", True)
    configure_jax()
    folder = out or Path("runs") / "tune_swing"
    count, tries = (500, 8) if quick else (10_000, 64)
    both = terrains(2 * count, 4, 2, 1.0)
    train, held_out = both[:count], both[count:]
    content = {"printed": tune_printed(train, held_out, tries, folder)}
    content["extended"] = tune_extended(train, held_out, tries, folder)
    content["planner"] = tune_planner(count, tries, folder)
    write("tune_swing", out, content | {"n": count})


def tune_printed(train: np.ndarray, held_out: np.ndarray, tries: int, folder: Path) -> dict[str, Any]:
    """gamma_H, l_back and N_limit of the printed machine."""
    call = blind_lanes(len(train))
    spans = BLIND | {"limit": LIMIT}

    def machine(x):
        named = dict(zip(spans, x))
        return printed(high=LITERAL, **named | {"limit": float(np.round(named["limit"]))})

    paper = np.array([0.3, 0.5, 3.0])
    found = search(lambda x: judge(call(train, common=(machine(x),))), spans, paper, tries)
    rows = {name: call(held_out, common=(machine(x),)) for name, x in (("paper", paper), ("tuned", found["best"]))}
    return report("printed", found, spans, rows, folder)


def tune_extended(train: np.ndarray, held_out: np.ndarray, tries: int, folder: Path) -> dict[str, Any]:
    """gamma_H, l_back and the stations of the extended machine; the paper's numbers with as many stations as first built."""
    call = blind_lanes(len(train))
    spans = BLIND | {"stations": (0.0, 0.999)}

    def machine(x):
        stations = STATIONS[int(x[2] * len(STATIONS))]
        base = extended(max(STATIONS), high=LITERAL, height_share=x[0], back=x[1])
        order = np.full(max(STATIONS), np.inf)  # a station at infinity is none: there the machine gives up
        order[:stations] = extended(stations).stations
        return dataclasses.replace(base, stations=jnp.asarray(order))

    paper = np.array([0.3, 0.5, 0.999])
    found = search(lambda x: judge(call(train, common=(machine(x),))), spans, paper, tries)
    rows = {name: call(held_out, common=(machine(x),)) for name, x in (("paper", paper), ("tuned", found["best"]))}
    return report("extended", found, spans, rows, folder)


def tune_planner(count: int, tries: int, folder: Path) -> dict[str, Any]:
    """The planner for maps in doubt, machine as printed; judged over the three map errors together."""
    third = count // 3
    both = terrains(2 * third, 4, 0, 0.4)
    wrong = {error: lowered(both, error) for error in (1, 2, 3)}

    def stacked(part):
        return np.tile(both[part], (3, 1)), np.concatenate([maps[part] for maps in wrong.values()])

    call = shared_out(_planned, -(-3 * third // jax.device_count()))
    train, held_out = stacked(slice(third)), stacked(slice(third, None))
    start = np.array([float(getattr(cautious(), name)) for name in PLANNER])

    def planner(x) -> RoutePlanner:
        return cautious(**dict(zip(PLANNER, map(float, x))))

    found = search(lambda x: judge(call(*train, common=(planner(x),))), PLANNER, start, max(tries // 2, 4))
    rows = {"shipped": call(*held_out, common=(planner(start),)), "tuned": call(*held_out, common=(planner(found["best"]),))}
    return report("planner", found, PLANNER, rows, folder)


def _planned(planner: RoutePlanner, heights, believed) -> Swing:
    local = jax.vmap(lambda knots: sampled(natural_spline(knots), *MAP))(believed)
    machine, step = printed(high=CALIBRATED), Step(*map(jnp.asarray, STEP))
    return informed_swings(machine, planner, step, jax.vmap(natural_spline)(heights), local).swing


def blind_lanes(count: int) -> Any:
    """Batched blind swings of a machine that is given: (heights, common=(machine,)) -> `Swing`s."""

    def batch(machine: Machine, heights):
        return blind_swings(machine, Step(*map(jnp.asarray, STEP)), jax.vmap(natural_spline)(heights))

    return shared_out(batch, -(-count // jax.device_count()))


def judge(seen: Swing) -> tuple[float, float, float]:
    """Success, mean path length and adjustments."""
    return float(np.mean(seen.exit == Mode.SUPPORTED)), float(np.mean(seen.length)), float(np.mean(seen.adjustments))


def search(evaluate: Evaluate, spans: dict[str, tuple], first: np.ndarray, tries: int) -> dict[str, Any]:
    """All settings tried, their values, and the shortest path at no less success than the first setting."""
    low, high = np.array(list(spans.values())).T
    points = qmc.scale(qmc.Sobol(len(spans), seed=0).random(tries), low, high)
    x, values = [first], [evaluate(first)]
    rng, width = np.random.default_rng(0), 0.15
    for k in range(2 * tries):
        at = points[k] if k < tries else np.clip(_best(x, values) + width * (high - low) * rng.normal(size=len(low)), low, high)
        width = width if k < tries else 0.97 * width
        x.append(at)
        values.append(evaluate(at))
    return {"x": np.array(x), "values": np.array(values), "best": _best(x, values)}


def _best(x, values):
    values = np.array(values)
    enough = values[:, 0] >= values[0, 0]
    return x[int(np.argmin(np.where(enough, values[:, 1], np.inf)))]


def front_of(values: np.ndarray) -> np.ndarray:
    """Settings that no other beats in success, path length and adjustments at once."""
    cost = values * np.array([-1.0, 1.0, 1.0])
    beaten = [np.any(np.all(cost <= c, axis=1) & np.any(cost < c, axis=1)) for c in cost]
    return np.flatnonzero(~np.array(beaten))


def report(name: str, found: dict[str, Any], spans: dict[str, Any], rows: dict[str, Swing], folder: Path) -> dict[str, Any]:
    """Print and draw one search; the first row is what it started from."""
    before, after = rows
    settings = dict(zip(spans, map(float, found["best"])))
    shorter = interval((rows[before].length - rows[after].length) / rows[before].length.mean())
    more = interval((rows[after].exit == Mode.SUPPORTED).astype(float) - (rows[before].exit == Mode.SUPPORTED))
    held_out = {row: dict(zip(("success", "path_length", "adjustments"), judge(seen))) for row, seen in rows.items()}
    held_out |= {"collisions": {row: float(np.mean(seen.collisions)) for row, seen in rows.items()}}
    print(f"{name}: {', '.join(f'{k} {v:.3g}' for k, v in settings.items())}")
    for row in (before, after):
        r = held_out[row]
        numbers = f"success {100 * r['success']:.2f} %, path {r['path_length']:.2f}, adjustments {r['adjustments']:.2f}"
        print(f"  held out, {row:8s} {numbers}, collisions {held_out['collisions'][row]:.2f}")
    span = f"[{100 * shorter['ci95'][0]:.1f}, {100 * shorter['ci95'][1]:.1f}]"
    print(f"  path shorter by {100 * shorter['mean']:.1f} % {span}, success more by {100 * more['mean']:.2f} points")
    values = found["values"]
    front = front_of(values)
    marked = {row: judge(seen) for row, seen in rows.items()}
    draw_front(values, front, marked, folder / f"front_{name}.png")
    listed = [
        dict(zip((*spans, "success", "path_length", "adjustments"), map(float, (*found["x"][k], *values[k])))) for k in front
    ]
    return {"settings": settings, "held_out": held_out, "shorter": shorter, "success_gained": more, "front": listed}


if __name__ == "__main__":
    tyro.cli(main)
