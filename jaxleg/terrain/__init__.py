"""Height maps, their generators, and where a foot may be placed."""

from jaxleg.terrain.footing import valid_cells as valid_cells
from jaxleg.terrain.generators import KINDS as KINDS
from jaxleg.terrain.generators import Grid as Grid
from jaxleg.terrain.generators import TerrainSettings as TerrainSettings
from jaxleg.terrain.generators import flat as flat
from jaxleg.terrain.generators import rough as rough
from jaxleg.terrain.generators import stairs as stairs
from jaxleg.terrain.generators import terrain as terrain
from jaxleg.terrain.generators import terrain_batch as terrain_batch
from jaxleg.terrain.heightmap import HeightMap as HeightMap
