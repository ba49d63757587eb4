"""The terrains of a study: training and held-out ones of each kind, with the cells where a foot may be placed."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.posture.collision import Sizes
from jaxleg.robot import Robot
from jaxleg.search.config import Kind, Study, Terrains
from jaxleg.terrain.footing import FootingRule
from jaxleg.terrain.generators import BATCH, Grid, TerrainSettings, terrain_batch
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
    table, maps = study.kinds[kind], study.terrains
    key = jax.random.fold_in(jax.random.key(study.seed), names.index(kind))
    difficulties = jnp.asarray(_spread(table, count), float)
    first = HELD_OUT if held_out else 0
    sites = _build(table.generator, grid(study), first, terrain_settings(table), Sizes.of(robot), maps, key, difficulties)
    kept = first_of_each(np.asarray(sites.terrain.elevation))
    return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[kept]), sites)


def terrain_settings(kind: Kind) -> TerrainSettings:
    """What a kind's generator makes at difficulty 1."""
    return TerrainSettings(**{field.name: getattr(kind, field.name) for field in dataclasses.fields(TerrainSettings)})


def first_of_each(rows: np.ndarray) -> np.ndarray:
    """Indices of the rows that no earlier row equals; 0 and -0 are equal, as flat ground of no roughness has both."""
    found = {(row + 0.0).tobytes(): i for i, row in reversed(list(enumerate(rows)))}
    return np.array(sorted(found.values()), int)


@functools.partial(jax.jit, static_argnums=range(6))
def _build(generator, grid, first, settings, sizes, maps, key, difficulties):
    terrain = jax.lax.optimization_barrier(
        terrain_batch(generator, grid, key, first, difficulties, settings)
    )  # or XLA folds flat ground
    return sites_on(maps, sizes, terrain)


@functools.partial(jax.jit, static_argnums=range(2))
def sites_on(maps: Terrains, sizes: Sizes, terrain: HeightMap) -> Site:
    """The sites that planners see on maps with a leading axis, for a robot of these sizes."""
    return jax.lax.map(functools.partial(site_of, footing_rule(maps), sizes, maps.resolution), terrain, batch_size=BATCH)


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
