"""A site: a map, where a foot may stand on it, what it costs there, and the ground as obstacles."""

from typing import NamedTuple

from jaxtyping import Array, Bool, Float

from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.obstacles import Obstacles


class Site(NamedTuple):
    """The ground of one lane as planners see it."""

    terrain: HeightMap
    valid: Bool[Array, "nx ny"]  # where a foot may stand
    obstacles: Obstacles = None  # ty: ignore[invalid-assignment]  a choice of cells alone needs none
    cost: Float[Array, "leg heading nx ny"] = None  # ty: ignore[invalid-assignment]  of standing there, in [0, 1] (C6), if asked
