"""Numbers of paper C's posture moved by gradients of its walks' energy: a part of `one_planner`."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax

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
    "gait.hip_height": (0.40, 0.55),
    "gait.foot_offset": (-0.12, 0.12),
    "posture.levelling": (-0.01, 1.01),
    "posture.target_weight": (-0.01, 1.01),
    "posture.cog.ratio": (0.2, 0.8),
}


def c_energy_search(study: Study, lab: Lab, train: int, held: int, steps: int) -> dict[str, Any]:
    """Numbers of C's posture moved by gradient over training maps, its choices made anew in each step; the walks of hand-set
    and moved numbers followed in simulation on other maps."""
    navigator = small(study, lab)
    walks, found = planned(navigator, some_maps(train, 0.5))
    walks = take(walks, np.flatnonzero(found))
    low, high = (np.array(x, np.float32) for x in zip(*POSTURE.values()))
    numbers = np.asarray(read_leaves(navigator.planner, tuple(POSTURE)), np.float32)
    free, optimiser = np.log((numbers - low) / (high - numbers)), optax.adam(0.3)
    state, slope, history = optimiser.init(free), over_lanes(jax.value_and_grad(held_cost(lab, navigator)), 8), []
    rechoose = over_lanes(functools.partial(_choices, navigator), 8)
    for step in range(steps):
        batch = take(walks, (16 * step + np.arange(16)) % len(walks.site.valid))
        at = low + (high - low) / (1.0 + np.exp(-free))
        choices, good = rechoose(np.tile(at, (16, 1)), batch.site, batch.line)
        value, gradient = slope(np.tile(at, (16, 1)), batch._replace(choices=choices))
        good = good & np.isfinite(gradient).all(axis=1)
        mean = np.where(good[:, None], gradient, 0.0).sum(axis=0) / max(good.sum(), 1)
        history.append({"cost": float(value[good].mean()), "planned": int(good.sum())} | dict(zip(POSTURE, at.tolist())))
        print(step, history[-1])
        update, state = optimiser.update(mean * (at - low) * (high - at) / (high - low), state)
        free = np.asarray(optax.apply_updates(free, update))
    at = low + (high - low) / (1.0 + np.exp(-free))
    return {"moved": dict(zip(POSTURE, at.tolist())), "history": history} | compared(lab, navigator, at, held)


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
