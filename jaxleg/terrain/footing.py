"""Where a foot may stand: the one rule of all planners. Papers A, IV.B.1 and C, 2.2 (A9)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool

from jaxleg.terrain.features import FeatureSettings, traversability
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.validity import steepest_side, valid_cells


class FootingRule(NamedTuple):
    """What ground bears a foot; static."""

    slope_limit_deg: float = 35.0  # steepest valid foothold
    edge_height: float = 0.03  # a jump between cells that counts as an edge [m]
    least_traversability: float = 0.6  # of every cell under a foot, 1 = easy
    side_slope_limit_deg: float = 90.0  # of the ground to any neighbour


def footing(rule: FootingRule, foot_radius: float, resolution: float, terrain: HeightMap) -> Bool[Array, "nx ny"]:
    """Where a foot of this radius [m] may stand on a map of a resolution [m per cell]; all but the map is static."""
    easy = traversability(terrain, resolution, FeatureSettings()) >= rule.least_traversability
    slope = float(np.deg2rad(rule.slope_limit_deg))
    valid = valid_cells(terrain, resolution, foot_radius, slope, rule.edge_height, easy)
    if rule.side_slope_limit_deg >= 90.0:
        return valid
    return valid & (steepest_side(terrain) <= float(np.deg2rad(rule.side_slope_limit_deg)))
