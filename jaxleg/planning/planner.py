"""Planner A, end to end: nominal stance, cascade of footholds, crawl, reference. One lane; `vmap` outside."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.plan import GaitParams, Walk
from jaxleg.planning.crawl import CrawlSettings, crawl
from jaxleg.planning.footholds import Footholds, SearchRectangle, choose
from jaxleg.robot import Robot
from jaxleg.stance import nominal_stances
from jaxleg.terrain.heightmap import HeightMap


class Site(NamedTuple):
    """A terrain as the planner sees it: the map and where a foot may be placed."""

    terrain: HeightMap
    valid: Bool[Array, "nx ny"]


class Choice(NamedTuple):
    """The discrete part of a plan: offsets (x, y) [m] from the nominal footholds and their `FootholdStatus`."""

    offset: Float[Array, "stance leg 2"]
    status: Int[Array, "stance leg"]


def choose_footholds(params: GaitParams, rectangle: SearchRectangle, site: Site, cells: tuple[int, int], cycles: int) -> Choice:
    """Choose the footholds of a walk, one cascade for each stance of four feet (paper A, IV.B.3).

    Every stance starts from its own nominal footholds along the path. The choice is piecewise constant: no gradient.
    """
    nominal = jax.lax.stop_gradient(nominal_stances(params, 0, cycles + 1))
    found: Footholds = jax.vmap(choose, in_axes=(0, None, None, None, None))(
        nominal, site.valid, site.terrain, rectangle, cells
    )
    return Choice(jax.lax.stop_gradient(found.offset), found.status)


def no_choice(cycles: int, dtype: jnp.dtype) -> Choice:
    """Every foot at its nominal foothold."""
    return Choice(jnp.zeros((cycles + 1, 4, 2), dtype), jnp.zeros((cycles + 1, 4), jnp.int32))


def plan_walk(
    robot: Robot,
    params: GaitParams,
    settings: CrawlSettings,
    rectangle: SearchRectangle,
    site: Site,
    cells: tuple[int, int],
    cycles: int = 2,
) -> Walk:
    """A walk of whole cycles along +x on a site: footholds by the cascade, then the crawl over them."""
    choice = choose_footholds(params, rectangle, site, cells, cycles)
    return crawl(robot, params, settings, site.terrain, choice.offset, choice.status)
