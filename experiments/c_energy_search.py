"""Numbers of paper C's posture moved by gradients of its walks' energy: a part of `one_planner`."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.c_walks import (
    Walks,
    electrical_of,
    ends_on,
    planned,
    small,
    some_maps,
    stations_of,
    take,
)
from jaxleg.batch import over_lanes
from jaxleg.route.stations import Line
from jaxleg.search.config import Study
from jaxleg.search.contest import saving
from jaxleg.search.lanes import Lab
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.search.navigate import navigate, simulate_all, survey_all
from jaxleg.status import Status
from jaxleg.terrain.site import Site
from jaxleg.walk.build import build_walk
from jaxleg.walk.choose import choose
from jaxleg.walk.navigation import Navigator
from jaxleg.walk.proxy import evaluate

POSTURE = {  # numbers of C's posture that its energy search moves, and their bounds
    "gait.workspace.high": (0.40, 0.55),
    "gait.foot_offset": (-0.12, 0.12),
    "posture.levelling": (0.0, 1.0),
    "posture.target_weight": (0.0, 1.0),
    "posture.cog.ratio": (0.2, 0.8),
}
FIRST = 0.1  # step of the descent, of the bounds' widths
KEPT = 0.9  # of the walks must still be found: numbers that save energy where there is a walk may leave few of them


def c_energy_search(study: Study, lab: Lab, train: int, held: int, steps: int) -> dict[str, Any]:
    """Numbers of C's posture moved down the mean gradient over training maps, the choices made anew in each step; a step that
    costs walks or saves nothing is halved. The walks of hand-set and moved numbers are followed in simulation on other maps."""
    navigator = small(study, lab)
    walks, found = planned(navigator, some_maps(train, 0.5))
    judge = judged(lab, navigator, take(walks, np.flatnonzero(found)))
    low, width = (np.array(x, np.float32) for x in zip(*((low, high - low) for low, high in POSTURE.values())))
    at, rate, history = np.asarray(read_leaves(navigator.planner, tuple(POSTURE)), np.float32), FIRST, []
    value, gradient, good = judge(at)
    for step in range(steps):
        slope = np.mean(gradient[good], axis=0) * width
        trial = np.clip((at - low) / width - rate * slope / max(np.linalg.norm(slope), 1e-12), 0.0, 1.0) * width + low
        there = judge(trial)
        both = good & there[2]
        better = there[2].sum() >= KEPT * found.sum() and there[0][both].mean() < value[both].mean()
        if better:
            at, (value, gradient, good) = trial, there
        rate = rate if better else 0.5 * rate
        row = {"cost": float(value[good].mean()), "planned": int(good.sum()), "tried": int(there[2].sum()), "rate": rate}
        history.append(row | dict(zip(POSTURE, at.tolist())))
        print(step, history[-1], flush=True)
    return {"moved": dict(zip(POSTURE, at.tolist())), "history": history} | compared(lab, navigator, at, held)


def judged(lab: Lab, navigator: Navigator, walks: Walks) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The function of the numbers that gives cost and gradient of each walk, and whether there is one."""
    slope = over_lanes(jax.value_and_grad(held_cost(lab, navigator)), 8)
    rechoose, count = over_lanes(functools.partial(_choices, navigator), 8), len(walks.site.valid)

    def judge(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Cost, gradient and whether there is a walk, by map."""
        rows = np.tile(numbers, (count, 1))
        choices, good = rechoose(rows, walks.site, walks.line)
        value, gradient = slope(rows, walks._replace(choices=choices))
        return value, gradient, good & np.isfinite(gradient).all(axis=1) & np.isfinite(value)

    return judge


def held_cost(lab: Lab, navigator: Navigator) -> Callable[[jax.Array, Walks], jax.Array]:
    """Energy per metre by the proxy over 1000 J/m, and what knee bend and margin lack; the choices held."""

    def cost(numbers: jax.Array, walks: Walks) -> jax.Array:
        planner = with_leaves(navigator.planner, tuple(POSTURE), numbers)
        stations = stations_of(planner, walks.line, walks.choices.adjust.shape[0])
        seen = evaluate(lab.robot, build_walk(planner, lab.robot, walks.site, stations, walks.choices))
        bend = jax.nn.relu(planner.limits.knee_bend - seen.checks.knee_bend) / 0.02
        margin = jax.nn.relu(planner.limits.margin - seen.checks.margin) / 0.01
        return electrical_of(lab, seen.energy) / seen.distance / 1000.0 + 0.1 * (bend + margin)

    return cost


def _choices(navigator: Navigator, numbers: jax.Array, site: Site, line: Line):
    """The choices along a line with these numbers, and whether there are any."""
    planner = with_leaves(navigator.planner, tuple(POSTURE), numbers)
    stations = stations_of(planner, line, navigator.steps)
    choices, _ = choose(planner, navigator.robot, site, stations, navigator.steps)
    return choices, choices.status == Status.OK


def compared(lab: Lab, navigator: Navigator, numbers: np.ndarray, held: int) -> dict[str, Any]:
    """Energy of the walks with hand-set and with moved numbers on maps that no search has seen; pairs that both walk."""
    maps = some_maps(2 * held, 0.5)
    maps = jax.tree.map(lambda x: x[held:], maps)
    ends, surveys, energy, walked = ends_on(maps), survey_all(navigator, maps), [], []
    for planner in (navigator.planner, with_leaves(navigator.planner, tuple(POSTURE), jnp.asarray(numbers))):
        other = dataclasses.replace(navigator, planner=planner)
        made, _ = navigate(other, surveys, *ends)
        seen = simulate_all(other, lab.engine, lab.ground, surveys, made, ends[1])
        joints = seen.followed.meters.energy
        energy.append((joints.mechanical_positive + joints.joule).sum(axis=(1, 2)) / made.walk.way)
        walked.append((made.status == Status.OK) & seen.finished)
    both = walked[0] & walked[1]
    saved = saving(energy[1][both], energy[0][both], 2000, 0)
    print(f"C, moved against hand-set: {saved} over {both.sum()} of {held} maps")
    return {"saving": saved, "maps": held, "walked": [int(w.sum()) for w in walked]}
