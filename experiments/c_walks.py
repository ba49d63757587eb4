"""Small maps and paper C's walks over them: what the parts of `one_planner` share."""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.batch import layout, over_lanes
from jaxleg.leg.energy import Power, electrical
from jaxleg.planner import Planner
from jaxleg.route.stations import Line, Stations
from jaxleg.search.config import Gait, Study, Workspace
from jaxleg.search.lanes import Lab
from jaxleg.search.navigate import navigator_of, survey_all
from jaxleg.status import Status
from jaxleg.terrain import Grid, HeightMap, TerrainSettings, terrain
from jaxleg.terrain.site import Site
from jaxleg.walk.choices import Choices
from jaxleg.walk.navigation import Navigator

GRID, START, GOAL, NEAR = Grid(100, 50, 0.04, (0.02, 0.02)), (0.8, 1.0), (3.2, 1.1), (2.3, 1.05)
GAIT = Gait(workspace=Workspace(high=0.46))
CYCLES, SAMPLES, STEPS = 2, (60, 50), 3  # of a walk in simulation


class Walks(NamedTuple):
    """Planned walks of paper C's planner: what its walk is a function of; leading axis lane."""

    site: Site
    line: Line
    choices: Choices


def small(study: Study, lab: Lab) -> Navigator:
    """Paper C's planner for the small maps."""
    path = dataclasses.replace(study.navigation.path, steps=96, cells=120)
    study = dataclasses.replace(study, navigation=dataclasses.replace(study.navigation, path=path))
    return navigator_of(study, lab.robot, GAIT, GRID.resolution)


def planned(navigator: Navigator, maps: HeightMap) -> tuple[Walks, np.ndarray]:
    """Walks over maps, and which maps have one."""

    def lane(survey, start, goal):
        found = navigator.walk(survey, start, goal, jnp.zeros(survey.site.valid.shape, bool))
        return Walks(survey.site, navigator.line(survey.site.terrain, found.path), found.choices), found.status

    walks, status = over_lanes(lane, *layout(len(maps.elevation), 8))(survey_all(navigator, maps), *ends_on(maps))
    return walks, status == Status.OK


def some_maps(count: int, hardest: float) -> HeightMap:
    """Cuboids and fractal ground in turn, difficulty rising to the hardest."""
    make = jax.jit(lambda kind, seed, d: terrain(kind, GRID, jax.random.key(seed), d, TerrainSettings()), static_argnums=0)
    maps = [make(("cuboids", "fractal")[i % 2], 500 + i, hardest * (i + 0.5) / count) for i in range(count)]
    return jax.tree.map(lambda *x: np.stack(x), *maps)


def ends_on(maps: HeightMap, goal: tuple[float, float] = GOAL) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal on each map [m]."""
    count = len(maps.elevation)
    start, end = (np.tile(np.asarray(xy, np.float32), (count, 1)) for xy in (START, goal))
    return start, end


def take(tree: Any, lanes: np.ndarray) -> Any:
    """Some lanes."""
    return jax.tree.map(lambda x: np.asarray(x)[lanes], tree)


def stations_of(planner: Planner, line: Line, steps: int) -> Stations:
    """As many as a walk of so many steps needs."""
    return planner.route.stations(planner.gait, line, steps // 2 + 3)


def electrical_of(lab: Lab, energy: Power) -> jax.Array:
    return electrical(jax.tree.map(jnp.sum, energy), lab.convention)
