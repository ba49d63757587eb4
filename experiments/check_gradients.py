"""Is the gradient of simulated energy per metre true? One full cycle of a crawl in simulation with contact, float64.

At random feasible gaits, the chosen cells held fixed, reverse-mode AD against Richardson-extrapolated central differences
(steps 1e-5 and 5e-6 of each parameter's range). Error of a gait: the largest over the parameters, each scaled by its
range, of |AD - FD| / max(|FD|, 1e-2 max |FD|). Exit status 1 where a target is missed.

    python -m experiments.check_gradients [--quick]
"""

import dataclasses
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, training, write
from jaxleg.batch import over_lanes
from jaxleg.foothold.soft import Softness, soft_stance
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search import agreement
from jaxleg.search.config import Study
from jaxleg.search.contestants import bounds
from jaxleg.search.lanes import Lab, Setting, per_metre
from jaxleg.search.training import Lanes
from jaxleg.sim.rollout import simulate
from jaxleg.terrain.site import Site
from jaxleg.walk.choices import Choices
from jaxleg.walk.reference import reference

STEP = 1e-5  # of a parameter's range
TARGETS = {"flat": 1e-3, "rough": 1e-2}  # of the error's 95th percentile, by kind of terrain
FORWARD_REVERSE, FLOAT32, SOFT = 1e-9, 0.05, 1e-4  # most that the two modes, the two precisions and the soft choice differ


def main(gaits: int = 32, out: Path | None = None, quick: bool = False) -> bool:
    """Check `gaits` gaits, half of them on rough ground (8 with `quick`); returns whether every error is on target."""
    jax.config.update("jax_enable_x64", True)
    study, lab = setup()
    lab = dataclasses.replace(lab, chunk=4)
    count = (8 if quick else gaits) // 2
    parts = [draw(study, lab, kind, count) for kind in TARGETS]
    errors = check(lab, *jax.tree.map(lambda *x: jnp.concatenate(x), *parts))
    starts = np.cumsum([0] + [len(vectors) for vectors, _, _ in parts])
    result = {}
    for kind, start, end in zip(TARGETS, starts, starts[1:]):
        result[kind] = summary({name: error[start:end] for name, error in errors.items()}, TARGETS[kind])
        print(kind, {key: f"{value:.2e}" if isinstance(value, float) else value for key, value in result[kind].items()})
    result["soft_choice"] = soft_choice(lab, training(study, lab, "stairs"))
    print("soft foothold choice, AD against central differences:", f"{result['soft_choice']:.2e}")
    write("check_gradients", out, result)
    holds = result["soft_choice"] <= SOFT and all(true(result[kind]) for kind in TARGETS)
    print("all within their targets" if holds else "a target is missed")
    return holds


def draw(study: Study, lab: Lab, kind: str, count: int) -> tuple[jax.Array, Lanes, jax.Array]:
    """Random feasible gaits on a kind of terrain, their lanes, and the parameters' ranges once for each."""
    span = bounds(study, kind, "best")
    vectors, lanes = agreement.random_gaits(lab, jax.random.key(2), training(study, lab, kind), span, count)
    return jnp.asarray(vectors), lanes, jnp.tile(jnp.asarray(span[:, 1] - span[:, 0]), (len(vectors), 1))


def summary(errors: dict[str, np.ndarray], target: float) -> dict[str, float | int]:
    """The errors of the gaits on one kind of terrain in figures."""
    against = errors["differences"]
    return {
        "gaits": len(against),
        "error_median": float(np.median(against)),
        "error_p95": float(np.percentile(against, 95)),
        "forward_reverse": float(errors["forward_reverse"].max()),
        "float32": float(errors["float32"].max()),
        "target": target,
    }


def true(row: dict[str, float | int]) -> bool:
    """Whether the gradients on one kind of terrain are true."""
    within = row["error_p95"] <= row["target"] and row["forward_reverse"] <= FORWARD_REVERSE and row["float32"] <= FLOAT32
    return row["gaits"] > 0 and within


def cycle_energy(lab: Lab, vector: jax.Array, site: Site, choice: Choices, setting: Setting) -> jax.Array:
    """Energy per metre [J/m] of one simulated cycle from rest, the footholds given."""
    track = reference(lab.robot, lab.walk(vector, site, choice, setting), lab.samples)
    meters = simulate(lab.engine, lab.robot, lab.ground, site.terrain, track, lab.steps)
    return per_metre(meters.energy, meters.moved[0])[CONVENTIONS.index(lab.convention)]


def check(lab: Lab, vectors: jax.Array, lanes: Lanes, width: jax.Array) -> dict[str, np.ndarray]:
    """Errors of reverse mode against differences, forward mode and float32, by gait."""
    lab.engine  # noqa: B018  built outside of any tracing
    choose_all = jax.jit(jax.vmap(lambda v, s, b: lab.choose(v, s, b, 1)))
    choices = choose_all(vectors, lanes.site, lanes.setting)
    lane = lambda v, s, c, b: cycle_energy(lab, v, s, c, b)  # noqa: E731
    arguments = (lanes.site, choices, lanes.setting)
    gradient = over_lanes(jax.grad(lane), lab.chunk // 2)(vectors, *arguments) * width
    value = over_lanes(lane, lab.chunk)
    difference = richardson(lambda v: value(v, *arguments), vectors, width)
    forward = over_lanes(lambda v, s, c, b, d: jax.jvp(lambda x: lane(x, s, c, b), (v,), (d,))[1], lab.chunk)
    along = forward(vectors, *arguments, width)
    single = single_precision(lab, vectors, arguments) * width
    scale = np.maximum(np.abs(difference), 1e-2 * np.abs(difference).max(axis=1, keepdims=True))
    size = np.linalg.norm(gradient, axis=1)
    return {
        "differences": (np.abs(gradient - difference) / scale).max(axis=1),
        "forward_reverse": np.abs(gradient.sum(axis=1) - along) / size,
        "float32": np.linalg.norm(single - gradient, axis=1) / size,
    }


def richardson(value, vectors: jax.Array, width: jax.Array) -> np.ndarray:
    """Central differences at two steps, extrapolated; gradient scaled by the ranges (gait, parameter)."""
    columns = []
    for i in range(vectors.shape[1]):
        at = [value(vectors.at[:, i].add(h * STEP * width[:, i])) for h in (1.0, -1.0, 0.5, -0.5)]
        wide, narrow = (at[0] - at[1]) / (2.0 * STEP), (at[2] - at[3]) / STEP
        columns.append((4.0 * narrow - wide) / 3.0)
    return np.stack(columns, axis=1)


def single_precision(lab: Lab, vectors: jax.Array, arguments) -> np.ndarray:
    """The same gradient computed in float32."""
    single = lambda tree: jax.tree.map(lambda x: x.astype(jnp.float32) if x.dtype == jnp.float64 else x, tree)  # noqa: E731
    with jax.enable_x64(False):
        small = dataclasses.replace(lab, robot=single(lab.robot))
        small.engine  # noqa: B018
        lane = jax.grad(lambda v, s, c, b: cycle_energy(small, v, s, c, b))
        return np.asarray(over_lanes(lane, lab.chunk // 2)(*single((vectors, *arguments))), np.float64)


def soft_choice(lab: Lab, lanes: Lanes) -> float:
    """Largest relative error of the soft foothold choice's gradient in w1 over stair terrains, temperature 0.05."""
    nominal = jnp.array([[0.3, 0.18], [0.25, -0.18], [-0.3, 0.18], [-0.35, -0.18]])
    planner = jax.tree.map(lambda x: jnp.asarray(x[0]), lanes.setting.planner)

    def ahead(weight, site):
        rectangle = dataclasses.replace(planner.foothold.rectangle, nominal_weight=weight)
        cascade, softness = dataclasses.replace(planner.foothold, rectangle=rectangle), Softness(0.05, 0.01)
        return soft_stance(cascade, softness, lab.robot, planner.gait, site, nominal, rectangle.heading).offset[0, 0]

    slope = jax.vmap(jax.grad(ahead), in_axes=(None, 0))(jnp.asarray(0.6), lanes.site)
    at = [jax.vmap(ahead, in_axes=(None, 0))(jnp.asarray(0.6 + h), lanes.site) for h in (1e-5, -1e-5)]
    difference = (at[0] - at[1]) / 2e-5
    return float(jnp.max(jnp.abs(slope - difference)) / jnp.max(jnp.abs(difference)))


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
