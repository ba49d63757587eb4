"""Gradients of paper C's walks with their choices held, against differences: a part of `one_planner`."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.c_walks import (
    CYCLES,
    SAMPLES,
    STEPS,
    Walks,
    electrical_of,
    planned,
    some_maps,
    stations_of,
    take,
)
from jaxleg.batch import layout, over_lanes
from jaxleg.planner import Planner
from jaxleg.search.lanes import Lab
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.sim.rollout import simulate
from jaxleg.walk.build import build_walk
from jaxleg.walk.choices import Choices
from jaxleg.walk.navigation import Navigator
from jaxleg.walk.proxy import evaluate
from jaxleg.walk.reference import reference

MOVED = (
    *(f"gait.{name}" for name in ("step_length", "stance_length", "stance_width", "skew", "foot_offset", "workspace.high")),
    *("gait.swing_height", "gait.lift_share", "posture.levelling", "posture.cog.ratio", "timing.acceleration", "route.turn"),
)
SIX = MOVED[:6]  # that must not be without effect
STEP = 1e-5  # of a number's scale, in simulation, whose energy is rounded more
SMALL_STEP = 1e-6  # by the proxy: a long walk has so many corners (greatest and least of many) that a wider step crosses some
SCALE = np.array([0.2, 0.6, 0.4, 0.1, 0.1, 0.5, 0.1, 0.2, 1.0, 1.0, 1.0, 0.3])
TARGETS = {"proxy": 1e-4, "simulated, flat": 1e-3, "simulated, rough": 1e-2}


def c_gradients(lab: Lab, navigator: Navigator, count: int) -> dict[str, Any]:
    """Gradients of C's walks, their choices held: proxy over the whole walk, simulated energy over two cycles, against
    Richardson-extrapolated central differences and forward mode; float64."""
    rough, found = planned(navigator, some_maps(2 * count, 0.6))
    rough = take(rough, np.flatnonzero(found)[:count])
    level, _ = planned(navigator, jax.tree.map(lambda x: x[:1], some_maps(2, 0.0)))
    values = np.asarray(read_leaves(navigator.planner, MOVED))
    vectors = values + SCALE * 0.02 * np.random.default_rng(0).standard_normal((count, len(values)))
    proxy = functools.partial(proxy_energy, lab, navigator.planner)
    simulated = functools.partial(simulated_energy, lab, navigator.planner)
    lab.engine  # noqa: B018  built outside of any tracing
    few = max(count // 4, 1)
    rows = {
        "proxy": gradient_errors(proxy, vectors, rough, SMALL_STEP),
        "simulated, flat": gradient_errors(simulated, vectors[:few], take(level, np.zeros(few, int))),
        "simulated, rough": gradient_errors(simulated, vectors[:few], take(rough, np.arange(few))),
    }
    for name, row in rows.items():
        row["target"] = TARGETS[name]
        print(f"{name:18s} {row}")
    return rows


def proxy_energy(lab: Lab, planner: Planner, vector: jax.Array, walks: Walks) -> jax.Array:
    """Energy per metre of a whole walk by the proxy [J/m]."""
    planner = with_leaves(planner, MOVED, vector)
    made = build_walk(
        planner, lab.robot, walks.site, stations_of(planner, walks.line, walks.choices.adjust.shape[0]), walks.choices
    )
    seen = evaluate(lab.robot, made)
    return electrical_of(lab, seen.energy) / seen.distance


def simulated_energy(lab: Lab, planner: Planner, vector: jax.Array, walks: Walks) -> jax.Array:
    """Energy of the first cycles of a walk in simulation, from standing to standing [J]."""
    planner = with_leaves(planner, MOVED, vector)
    made = build_walk(planner, lab.robot, walks.site, stations_of(planner, walks.line, 4 * CYCLES), first_cycles(walks.choices))
    meters = simulate(lab.engine, lab.robot, lab.ground, walks.site.terrain, reference(lab.robot, made, SAMPLES), STEPS)
    return electrical_of(lab, meters.energy)


def first_cycles(choices: Choices) -> Choices:
    """The choices of the first `CYCLES` cycles."""
    steps = 4 * CYCLES
    return choices._replace(
        offset=choices.offset[: CYCLES + 1],
        found=choices.found[: CYCLES + 1],
        adjust=choices.adjust[:steps],
        count=jnp.minimum(choices.count, steps),
    )


def gradient_errors(value: Callable[..., jax.Array], vectors: np.ndarray, walks: Walks, step: float = STEP) -> dict[str, Any]:
    """Reverse mode against differences and forward mode, and how often each of the six numbers has an effect."""
    share = layout(len(vectors), 4)
    lanes = over_lanes(value, *share)
    gradient = over_lanes(jax.grad(value), *share)(vectors, walks) * SCALE
    along = over_lanes(lambda v, w, d: jax.jvp(lambda x: value(x, w), (v,), (d,))[1], *share)
    forward = along(vectors, walks, np.broadcast_to(SCALE, vectors.shape))
    columns = []
    for i in range(vectors.shape[1]):
        unit = step * SCALE[i] * np.eye(vectors.shape[1])[i]
        at = [lanes(vectors + h * unit, walks) for h in (1.0, -1.0, 0.5, -0.5)]
        columns.append((4.0 * (at[2] - at[3]) / step - (at[0] - at[1]) / (2.0 * step)) / 3.0)
    difference = np.stack(columns, axis=1)
    scale = np.maximum(np.abs(difference), 1e-2 * np.abs(difference).max(axis=1, keepdims=True))
    error = (np.abs(gradient - difference) / scale).max(axis=1)
    size = np.linalg.norm(gradient, axis=1)
    acts = np.mean(np.abs(gradient[:, : len(SIX)]) > 1e-6 * size[:, None], axis=0)
    return {
        "walks": len(vectors),
        "error_median": float(np.median(error)),
        "error_p95": float(np.percentile(error, 95)),
        "forward_reverse": float(np.max(np.abs(gradient.sum(axis=1) - forward) / size)),
        "not_zero": dict(zip(SIX, acts.tolist())),
    }
