"""Planner A, end to end: nominal stance, cascade of footholds, crawl, reference. One lane; `vmap` outside."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.foothold.cascade import Footholds, Reachable, choose
from jaxleg.foothold.rectangle import Extent, SearchRectangle
from jaxleg.gait.nominal import nominal_stances
from jaxleg.gait.params import GaitParams
from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.numerics import sqrt_safe
from jaxleg.robot import Robot
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.crawl import CrawlSettings, crawl
from jaxleg.walk.data import Walk


class Site(NamedTuple):
    """A terrain as the planner sees it: the map and where a foot may be placed."""

    terrain: HeightMap
    valid: Bool[Array, "nx ny"]


class Choice(NamedTuple):
    """The discrete part of a plan: offsets (x, y) [m] from the nominal footholds and their `FootholdStatus`."""

    offset: Float[Array, "stance leg 2"]
    status: Int[Array, "stance leg"]


def reachable_heights(robot: Robot, params: GaitParams, least_bend: Float[ArrayLike, ""]) -> Reachable:
    """Heights of a foothold over the ground round it that a leg reaches (the "kinematically valid" of paper A, IV.B.3).

    The hips' plane may come down to the thigh's length over the ground (A5, A17), and the foot is at most |L_F2H| + L_Step/2
    before or behind its hip: so deep reaches the leg at its least knee bend. No foot stands higher than H_COG - L2.
    """
    thigh = -robot.link_offset[0, 1, 2]
    ahead = jnp.abs(params.foot_offset) + 0.5 * params.step_length
    deepest = sqrt_safe(reach_for_bend(robot.link_offset[0], least_bend) ** 2 - ahead**2)
    return Reachable(thigh - deepest, params.hip_height - thigh, params.step_length)


def plan_footholds(
    nominal: Float[Array, "stance leg 2"], rectangle: SearchRectangle, reachable: Reachable, site: Site, extent: Extent
) -> Choice:
    """Choose 4, 8, 12, ... footholds: one cascade for each stance of four feet, each from its own nominal footholds."""
    found: Footholds = jax.vmap(choose, in_axes=(0, None, None, None, None, None))(
        nominal, site.valid, site.terrain, rectangle, reachable, extent
    )
    return Choice(found.offset, found.status)


def choose_footholds(
    robot: Robot,
    params: GaitParams,
    least_bend: Float[ArrayLike, ""],
    rectangle: SearchRectangle,
    site: Site,
    extent: Extent,
    cycles: int,
) -> Choice:
    """Choose the footholds of a walk along +x, the stance it begins in included (paper A, IV.B.3); no gradient."""
    params, rectangle, site = jax.lax.stop_gradient((params, rectangle, site))
    nominal = nominal_stances(params, 0, cycles + 1)
    return plan_footholds(nominal, rectangle, reachable_heights(robot, params, least_bend), site, extent)


def no_choice(cycles: int, dtype: jnp.dtype) -> Choice:
    """Every foot at its nominal foothold."""
    return Choice(jnp.zeros((cycles + 1, 4, 2), dtype), jnp.zeros((cycles + 1, 4), jnp.int32))


def plan_walk(
    robot: Robot,
    params: GaitParams,
    settings: CrawlSettings,
    rectangle: SearchRectangle,
    site: Site,
    extent: Extent,
    cycles: int = 2,
) -> Walk:
    """A walk of whole cycles along +x on a site: footholds by the cascade, then the crawl over them."""
    choice = choose_footholds(robot, params, settings.least_knee_bend, rectangle, site, extent, cycles)
    return crawl(robot, params, settings, site.terrain, choice.offset, choice.status)
