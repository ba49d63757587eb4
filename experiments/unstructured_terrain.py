"""Paper C, 4.3 (Fig. 11-14): from the features of unstructured ground to a walk over it.

One fractal map. Fig. 11, 12: slope, roughness, step height and the cost made of them. Fig. 13: the body's path for two
weightings of way and cost, and what each is worth. Fig. 14: the walked trajectory, simulated and refereed by C MuJoCo,
as a picture and as an animation.

    python -m experiments.unstructured_terrain [--quick]
"""

import dataclasses
import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, write
from experiments.walk_maps import GAIT, GRID, world
from jaxleg.conventions import HEADINGS
from jaxleg.route.path import BodyPath
from jaxleg.search.lanes import Lab
from jaxleg.search.navigate import navigate, navigator_of, survey_all
from jaxleg.sim.follow import film
from jaxleg.sim.referee_feedback import follow_all
from jaxleg.status import Status
from jaxleg.terrain import HeightMap
from jaxleg.terrain.body_cost import body_features
from jaxleg.viz.animation import animate
from jaxleg.viz.cost_maps import cost_maps
from jaxleg.viz.navigation import draw_walk, trail
from jaxleg.walk.navigation import Navigator, Planned, Survey, Walked

MAP, EASY = 119, 39  # of the 200 of `walk_maps`: difficulty 0.6; with `quick` an easier one
WEIGHTS = (0.1, 0.9)  # mu_2 of the two paths
FRAME = 0.5  # between the pictures of the animation [s]


def main(out: Path | None = None, quick: bool = False) -> None:
    """Draw, plan, walk; `quick` takes an easier map and leaves the referee out."""
    study, lab = setup()
    folder = out or Path("runs/unstructured_terrain")
    number = EASY if quick else MAP
    there = jax.tree.map(lambda x: x[[number]], world(200)._asdict())
    maps, start, goal = there["maps"], there["start"], there["goal"]
    navigator = navigator_of(study, lab.robot, GAIT, GRID.resolution)
    surveys = survey_all(navigator, maps)
    survey = jax.tree.map(lambda x: x[0], surveys)
    paths = {mu: body_path(navigator, survey, start[0], goal[0], mu) for mu in WEIGHTS}
    draw_costs(navigator, survey, paths, folder / "cost_maps.png")
    rows = {f"mu_2 = {mu}": path_row(survey, path) for mu, path in paths.items()}
    for name, row in rows.items():
        print(f"{name}: {row}")
    walked, detours = navigate(navigator, surveys, start, goal)
    status = Status(walked.status[0]).name.lower()
    result: dict[str, Any] = {"map": number, "paths": rows, "status": status, "detours": int(detours[0])}
    if status == "ok":
        result |= walk(lab, navigator, survey, jax.tree.map(lambda x: x[0], walked), goal[0], folder, referee=not quick)
    print({k: v for k, v in result.items() if k != "paths"})
    write("unstructured_terrain", out, result)


def body_path(navigator: Navigator, survey: Survey, start: np.ndarray, goal: np.ndarray, mu: float) -> BodyPath:
    """The path with a weight mu_2 of the cost."""
    weights = dataclasses.replace(navigator.settings.path, mu_cost=mu, mu_distance=1.0 - mu)
    other = dataclasses.replace(navigator, settings=dataclasses.replace(navigator.settings, path=weights))
    return jax.jit(other.path)(survey.site.terrain, survey.cost.total, jnp.asarray(start), jnp.asarray(goal))


def on_map(terrain: HeightMap, path: BodyPath) -> np.ndarray:
    """A path's points (x, y) in W [m]."""
    return np.asarray(terrain.origin) + float(terrain.resolution) * np.asarray(path.cells)[: int(path.length)]


def path_row(survey: Survey, path: BodyPath) -> dict[str, float]:
    """Way, and mean cost of the cells entered."""
    cells, heading = (np.asarray(x)[: int(path.length)] for x in (path.cells, path.heading))
    entered = np.asarray(survey.cost.total)[heading[:-1], cells[1:, 0], cells[1:, 1]]
    way = np.linalg.norm(np.array(HEADINGS)[heading[:-1]], axis=1).sum() * float(survey.site.terrain.resolution)
    return {"way_m": float(way), "cost_mean": float(entered.mean()), "cost_greatest": float(entered.max())}


def draw_costs(navigator: Navigator, survey: Survey, paths: dict[float, BodyPath], path: Path) -> None:
    """Fig. 11 to 13 in one: features, costs and the two paths."""
    terrain = survey.site.terrain
    body = navigator.settings.cost.windows.body
    features = jax.jit(lambda t: body_features(t, navigator.resolution, body))(terrain)
    lines = [(f"mu_2 = {mu}", on_map(terrain, p)) for mu, p in paths.items()]
    cost_maps(terrain, features, survey.cost, 0, path, lines)


def walk(
    lab: Lab, navigator: Navigator, survey: Survey, walked: Walked, goal: np.ndarray, folder: Path, referee: bool
) -> dict[str, Any]:
    """Fig. 14: walk it in simulation, draw it, and again in C MuJoCo."""
    planned = jax.jit(navigator.planned)(walked)
    seen, shots = filmed(lab, navigator, survey.site.terrain, planned)
    last = int(planned.last)
    steps = trail(survey.site.terrain, walked, shots, walked.walk.poses[0, :2], goal)
    draw_walk(survey.site.terrain, survey.site.valid, steps, folder / "walk.png")
    ground = survey.site.terrain
    animate(folder / "walk.gif", ground, shots, lab.robot, FRAME, speed=4.0, route=on_map(ground, walked.path), goal=goal)
    energy = seen.meters.energy
    joules = float(jnp.sum(energy.mechanical_positive + energy.joule))
    result: dict[str, Any] = {
        "steps": int(walked.choices.count),
        "seconds": float(planned.reference.time[last]),
        "fell": bool(seen.meters.fell),
        "energy_j": joules,
        "margin_m": float(seen.meters.margin),
        "left_m": float(np.linalg.norm(shots[-1, :2] - goal)),
    }
    if referee:
        track = jax.tree.map(lambda x: np.asarray(x)[: last + 1], planned.reference)
        judged = follow_all(lab.robot, [ground], [track], float(lab.ground.friction)).verdict
        theirs = float(judged.energy.mechanical_positive[0] + judged.energy.joule[0])
        result |= {"referee_fell": bool(judged.fell[0]), "referee_energy_over_mjx": theirs / joules}
    return result


def filmed(lab: Lab, navigator: Navigator, terrain: HeightMap, planned: Planned):
    """The walk in simulation with its pictures."""
    tick = navigator.settings.pace.tick
    each, last = round(FRAME / tick), int(planned.last)
    count = int(np.ceil(float(planned.reference.time[last]) / (each * tick))) + 2
    engine = lab.engine
    run = functools.partial(film, engine, lab.robot, lab.ground)

    @jax.jit
    def go(terrain, reference):
        return run(terrain, reference, last, sum(navigator.samples), jnp.asarray(tick, float), (count, each))

    seen, shots = go(terrain, planned.reference)
    return seen, np.asarray(shots)


if __name__ == "__main__":
    tyro.cli(main)
