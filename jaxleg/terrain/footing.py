"""Where a foot may stand: the one rule of all planners. Papers A, IV.B.1 and C, 2.2 (A9). The foot is a disc, not a point."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxleg.terrain.features import FeatureSettings, traversability
from jaxleg.terrain.heightmap import HeightMap, mean_slope
from jaxleg.terrain.window import disc, over_disc

SURFACE = tuple((i, j) for i in range(-2, 3) for j in range(-2, 3) if abs(i) + abs(j) < 4)  # it changes at a cell's centre


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


def valid_cells(
    terrain: HeightMap,
    resolution: float,
    foot_radius: float,
    slope_limit: Float[ArrayLike, ""] = 0.6,
    edge_height: Float[ArrayLike, ""] = 0.03,
    easy: Bool[Array, "nx ny"] | None = None,
) -> Bool[Array, "nx ny"]:
    """Whether a foot may stand with its centre on each cell.

    Valid: the sampled surface is at most as steep as `slope_limit` [rad] there, all cells that it is made of about the centre
    are seen (`SURFACE`), and no unseen cell and no edge lies within `foot_radius` [m]. An edge is a pair of neighbouring cells
    more than `edge_height` [m] apart; it takes up both cells, so the radius is measured to the cells' borders (half a cell is
    added). `easy` marks the cells whose traversability is high enough (A9); every cell within `foot_radius` must be. Outside
    the map the ground goes on as at its border. An infinite elevation is unseen with an edge round it. `resolution` is the
    map's [m per cell] and static, like the radius: they set the windows.
    """
    ahead, aside = _differences(terrain.elevation), _differences(terrain.elevation.T).T
    jump = [jnp.abs(difference) > edge_height for difference in (ahead, aside)]
    unseen = ~jnp.isfinite(terrain.elevation)
    bad = unseen | jump[0][1:] | jump[0][:-1] | jump[1][:, 1:] | jump[1][:, :-1]
    steepness = mean_slope(ahead[:-1], ahead[1:]) ** 2 + mean_slope(aside[:, :-1], aside[:, 1:]) ** 2
    gentle = steepness <= (jnp.tan(slope_limit) * resolution) ** 2  # false for NaN
    clear = gentle & ~over_disc(bad, False, jax.lax.bitwise_or, disc(foot_radius + 0.5 * resolution, resolution))
    clear = clear & ~over_disc(unseen, False, jax.lax.bitwise_or, SURFACE)
    return clear if easy is None else clear & ~over_disc(~easy, False, jax.lax.bitwise_or, disc(foot_radius, resolution))


def steepest_side(terrain: HeightMap) -> Float[Array, "nx ny"]:
    """Slope [rad] of the steepest way from each cell's centre to one of its four neighbours; NaN if one is unseen.

    The surface's own slope at a ridge is 0 though both of its sides may be steep: a foot that stands there slides off.
    """
    steps = [_differences(terrain.elevation), _differences(terrain.elevation.T).T]
    sides = jnp.stack([steps[0][1:], steps[0][:-1], steps[1][:, 1:], steps[1][:, :-1]])
    return jnp.arctan2(jnp.max(jnp.abs(sides), axis=0), terrain.resolution)


def _differences(elevation):
    """Height differences along axis 0 before and after each cell; 0 beyond the border."""
    return jnp.pad(elevation[1:] - elevation[:-1], ((1, 1), (0, 0)))
