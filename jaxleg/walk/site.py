"""A map as planners see it: where feet may stand, and what legs, trunk and swings must clear."""

from jaxleg.posture.collision import Sizes, robot_obstacles
from jaxleg.terrain.footing import FootingRule, footing
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.site import Site


def site_of(rule: FootingRule, sizes: Sizes, resolution: float, terrain: HeightMap) -> Site:
    """The site of a map of a resolution [m per cell] for a robot of these sizes; all but the map is static."""
    valid = footing(rule, sizes.foot_radius, resolution, terrain)
    return Site(terrain, valid, robot_obstacles(sizes, terrain, resolution))
