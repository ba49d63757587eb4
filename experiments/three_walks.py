"""Papers A, B and C walk the same map, a part of `one_planner`: A straight ahead, C along its body path, B along C's with a map
that is wrong."""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.felt_walks import DT, ERROR, length_of, react, wrong
from jaxleg.control.swing_leg import feeling
from jaxleg.leg.energy import electrical
from jaxleg.search.config import Study
from jaxleg.search.contestants import contestant
from jaxleg.search.lanes import Lab
from jaxleg.search.navigate import navigate, survey_all
from jaxleg.terrain import Grid, HeightMap
from jaxleg.viz.walks import Seen, draw_walks
from jaxleg.walk.build import build_walk
from jaxleg.walk.choose import choose
from jaxleg.walk.data import Walk
from jaxleg.walk.navigation import Navigator
from jaxleg.walk.proxy import evaluate
from jaxleg.walk.reference import reference

VIEW = (0.2, 3.9, 0.3, 1.8)


def three_walks(
    study: Study, lab: Lab, navigator: Navigator, maps: HeightMap, ends: tuple[np.ndarray, np.ndarray], grid: Grid, path: Path
) -> dict[str, Any]:
    """The three walks over one map (leading axis of length 1), their energy by the proxy, and their picture."""
    true = jax.tree.map(lambda x: x[0], maps)
    ground = survey_all(navigator, maps)
    walks = {
        "A, straight ahead": straight(study, lab, navigator, true, ends),
        "C, along its body path": _first(navigate(navigator, ground, *ends)[0].walk),
    }
    energy = {name: energy_of(lab, walk) for name, walk in walks.items()}
    drawn = [as_planned(lab, f"{name}: {energy[name]:.0f} J/m", walk) for name, walk in walks.items()]
    felt, fell = felt_walk(lab, navigator, maps, ends, grid)
    draw_walks(true, np.asarray(ground.site.valid[0]), [*drawn, felt], VIEW, path)
    return {"energy_j_per_m": energy, "B_fell": fell}


def straight(study: Study, lab: Lab, navigator: Navigator, terrain: HeightMap, ends: tuple[np.ndarray, np.ndarray]) -> Walk:
    """Paper A's walk from the start as far along x as the goal is, in the map's own place."""
    start, goal = (np.asarray(xy[0], float) for xy in ends)
    planner = contestant(study, "rough", "paper")
    cycles = int(np.ceil((goal[0] - start[0]) / float(planner.gait.step_length)))
    moved = dataclasses.replace(terrain, origin=terrain.origin - jnp.asarray(start, terrain.origin.dtype))

    @jax.jit
    def plan(moved):
        site = navigator.site(moved)  # one rule where a foot may stand, for all three
        stations = planner.route.stations(planner.gait, None, 2 * cycles + 2)
        choices, _ = choose(planner, lab.robot, site, stations, 4 * cycles)
        return build_walk(planner, lab.robot, site, stations, choices)

    return shifted(plan(moved), start)


def shifted(walk: Walk, by: np.ndarray) -> Walk:
    """The walk elsewhere on the ground."""

    def move(x):
        return jnp.asarray(x).at[..., :2].add(jnp.asarray(by, x.dtype))

    phases = walk.phases
    places = {name: move(getattr(phases, name)) for name in ("trunk_from", "trunk_to", "feet_from", "feet_to")}
    rest = {name: move(getattr(walk, name)) for name in ("footholds", "poses", "feet")}
    return dataclasses.replace(walk, phases=phases._replace(**places), **rest)


def energy_of(lab: Lab, walk: Walk) -> float:
    """Energy per metre by the proxy [J/m]."""
    seen = jax.jit(evaluate)(lab.robot, walk)
    return float(electrical(jax.tree.map(jnp.sum, seen.energy), lab.convention) / seen.distance)


def as_planned(lab: Lab, title: str, walk: Walk) -> Seen:
    """A walk as it was planned."""
    track = jax.jit(reference, static_argnums=2)(lab.robot, walk, (12, 12))
    return Seen(title, *(np.asarray(x) for x in (track.trunk_pos, track.foot_pos, walk.feet[: int(walk.count) + 1])))


def felt_walk(
    lab: Lab, navigator: Navigator, maps: HeightMap, ends: tuple[np.ndarray, np.ndarray], grid: Grid
) -> tuple[Seen, bool]:
    """C's walk on a wrong map with B's reflexes, in simulation: as it went, and whether it fell."""
    walked, _ = navigate(navigator, survey_all(navigator, wrong(maps, ends[0], grid)), *ends)
    tick = react(lab, length_of(walked.walk), 1)(feeling(lab.robot), maps, walked.walk)
    going, every = int(np.sum(tick.alive[0] & ~tick.done[0])), round(0.05 / DT)
    title = f"B, C's walk felt out with a map that is wrong by {100 * ERROR:.0f} cm"
    stood = tick.foot[0][np.append(np.flatnonzero(np.diff(tick.phase[0][:going])), going - 1)]
    return Seen(title, tick.trunk[0][:going:every], tick.foot[0][:going:every], stood), bool(~tick.alive[0, -1])


def _first(tree):
    return jax.tree.map(lambda x: jnp.asarray(x[0]), tree)
