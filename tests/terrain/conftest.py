"""One compiled cost map for all tests of costs: its windows are small, and so is the map."""

import jax
import jax.numpy as jnp
import pytest

from jaxleg.terrain import HeightMap
from jaxleg.terrain.body_cost import BodySettings
from jaxleg.terrain.cost_map import Windows, total_cost
from jaxleg.terrain.foothold_cost import FeetSettings
from jaxleg.terrain.foothold_features import foothold_features

SIZE = 0.04  # [m]
STANCE = ((0.12, 0.10), (0.12, -0.10), (-0.14, 0.10), (-0.14, -0.10))
FEET = FeetSettings(length=0.16, width=0.08)


@pytest.fixture(scope="session")
def windows():
    return Windows(BodySettings(radius=0.14, critical_count=6), feet=FEET)


@pytest.fixture(scope="session")
def costs(windows):
    """Foothold features and cost map of an elevation of 18 x 18 cells and weights."""

    @jax.jit
    def compute(elevation, weights):
        terrain = HeightMap(elevation, jnp.zeros(2, elevation.dtype), jnp.array(SIZE, elevation.dtype))
        footholds = foothold_features(terrain, SIZE, windows.foothold)
        weights = jax.tree.map(lambda x: jnp.asarray(x, elevation.dtype), weights)
        return footholds, total_cost(terrain, footholds, SIZE, windows, STANCE, weights)

    return compute
