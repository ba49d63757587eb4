"""The terrains of a study: training and held-out ones of each kind, with the cells where a foot may be placed."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.planning.planner import Site
from jaxleg.search.config import Kind, Study
from jaxleg.terrain.features import FeatureSettings, traversability
from jaxleg.terrain.generators import BATCH, Grid, TerrainSettings, terrain_batch
from jaxleg.terrain.validity import valid_cells

HELD_OUT = 1_000_000  # number of the first held-out terrain: training never comes that far


def share(total: int, kinds: int, index: int) -> int:
    """How many of `total` terrains the kind number `index` gets."""
    return total // kinds + (index < total % kinds)


def make_sites(study: Study, foot_radius: float, kind: str, held_out: bool) -> Site:
    """All training or held-out sites of a kind, with a leading axis; difficulties evenly spread over the kind's range."""
    names = list(study.kinds)
    total = study.terrains.held_out if held_out else study.terrains.train
    count = share(total, len(names), names.index(kind))
    table, maps = study.kinds[kind], study.terrains
    key = jax.random.fold_in(jax.random.key(study.seed), names.index(kind))
    settings = TerrainSettings(table.rise, table.run, 0.0, table.amplitude, table.correlation_length)
    difficulties = jnp.asarray(_spread(table, count), float)
    first = HELD_OUT if held_out else 0
    limits = (float(np.deg2rad(maps.slope_limit_deg)), maps.edge_height)
    return _build(
        table.generator, grid(study), first, settings, foot_radius, limits, maps.least_traversability, key, difficulties
    )


@functools.partial(jax.jit, static_argnums=range(7))
def _build(generator, grid, first, settings, foot_radius, limits, least, key, difficulties):
    terrain = terrain_batch(generator, grid, key, first, difficulties, settings)

    def valid(one):
        easy = traversability(one, grid.resolution, FeatureSettings()) >= least
        return valid_cells(one, grid.resolution, foot_radius, *limits, easy)

    return Site(terrain, jax.lax.map(valid, terrain, batch_size=BATCH))


def grid(study: Study) -> Grid:
    """The maps' grid: the walk begins at the origin and goes along +x, two fifths of the map lie behind it."""
    nx, ny = study.terrains.cells
    resolution = study.terrains.resolution
    return Grid(nx, ny, resolution, (-0.4 * nx * resolution, -0.5 * (ny - 1) * resolution))


def _spread(kind: Kind, count: int) -> np.ndarray:
    low, high = kind.difficulty
    return low + (high - low) * (np.arange(count) + 0.5) / count
