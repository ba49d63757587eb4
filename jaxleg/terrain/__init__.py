"""Height maps, their generators, and where a foot may be placed."""

from jaxleg.terrain.generators import (
    KINDS,
    Grid,
    TerrainSettings,
    cuboids,
    flat,
    fractal,
    rough,
    stairs,
    terrain,
    terrain_batch,
    terrain_keys,
)
from jaxleg.terrain.heightmap import HeightMap, height, height_and_gradient, nearest_height, normal
from jaxleg.terrain.validity import valid_cells

__all__ = [
    "KINDS",
    "Grid",
    "HeightMap",
    "TerrainSettings",
    "cuboids",
    "flat",
    "fractal",
    "height",
    "height_and_gradient",
    "nearest_height",
    "normal",
    "rough",
    "stairs",
    "terrain",
    "terrain_batch",
    "terrain_keys",
    "valid_cells",
]
