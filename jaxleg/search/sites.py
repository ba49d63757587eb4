"""The terrains of a study: training and held-out ones of each kind, with the cells where a foot may be placed."""

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.batch import over_lanes
from jaxleg.posture.collision import Sizes
from jaxleg.robot import Robot
from jaxleg.search.config import Kind, Study, Terrains
from jaxleg.terrain.footing import FootingRule
from jaxleg.terrain.generators import BATCH, Grid, TerrainSettings, terrain, terrain_keys
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.site import Site
from jaxleg.walk.site import site_of

HELD_OUT = 1_000_000  # number of the first held-out terrain: training never comes that far


def share(total: int, kinds: int, index: int) -> int:
    """How many of `total` terrains the kind number `index` gets."""
    return total // kinds + (index < total % kinds)


def make_sites(study: Study, robot: Robot, kind: str, held_out: bool) -> Site:
    """All training or held-out sites of a kind, with a leading axis; difficulties evenly spread over the kind's range.

    Copies of one ground, as of a kind that nothing is random in, are left out: they would be counted as so many.
    """
    names = list(study.kinds)
    total = study.terrains.held_out if held_out else study.terrains.train
    count = share(total, len(names), names.index(kind))
    table = study.kinds[kind]
    key = jax.random.fold_in(jax.random.key(study.seed), names.index(kind))
    keys = terrain_keys(key, HELD_OUT if held_out else 0, count)
    make = _maker(table.generator, grid(study), terrain_settings(table))
    made = make(np.asarray(jax.random.key_data(keys)), _spread(table, count))
    kept = first_of_each(made.elevation)
    return sites_on(study.terrains, Sizes.of(robot), jax.tree.map(lambda x: x[kept], made))


@functools.lru_cache
def _maker(generator: str, grid: Grid, settings: TerrainSettings) -> Callable[..., HeightMap]:
    """Terrains of a kind from the data of their keys and their difficulties: one program, however many there are."""
    return over_lanes(lambda data, hard: terrain(generator, grid, jax.random.wrap_key_data(data), hard, settings), BATCH)


def terrain_settings(kind: Kind) -> TerrainSettings:
    """What a kind's generator makes at difficulty 1."""
    return TerrainSettings(**{field.name: getattr(kind, field.name) for field in dataclasses.fields(TerrainSettings)})


def first_of_each(rows: np.ndarray) -> np.ndarray:
    """Indices of the rows that no earlier row equals; 0 and -0 are equal, as flat ground of no roughness has both."""
    found = {(row + 0.0).tobytes(): i for i, row in reversed(list(enumerate(rows)))}
    return np.array(sorted(found.values()), int)


def sites_on(maps: Terrains, sizes: Sizes, terrain: HeightMap) -> Site:
    """The sites that planners see on maps with a leading axis, for a robot of these sizes."""
    return jax.tree.map(jnp.asarray, _surveyor(footing_rule(maps), sizes, maps.resolution)(terrain))


@functools.lru_cache
def _surveyor(rule: FootingRule, sizes: Sizes, resolution: float) -> Callable[..., Site]:
    """Sites of maps: one program for all kinds of terrain."""
    return over_lanes(functools.partial(site_of, rule, sizes, resolution), BATCH)


def footing_rule(maps: Terrains) -> FootingRule:
    """Where a study lets a foot be placed."""
    return FootingRule(maps.slope_limit_deg, maps.edge_height, maps.least_traversability)


def grid(study: Study) -> Grid:
    """The maps' grid: the walk begins at the origin and goes along +x, two fifths of the map lie behind it."""
    nx, ny = study.terrains.cells
    resolution = study.terrains.resolution
    return Grid(nx, ny, resolution, (-0.4 * nx * resolution, -0.5 * (ny - 1) * resolution))


def _spread(kind: Kind, count: int) -> np.ndarray:
    low, high = kind.difficulty
    return low + (high - low) * (np.arange(count) + 0.5) / count
