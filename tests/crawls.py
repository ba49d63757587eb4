"""Crawls that tests plan: gaits, settings, terrains."""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.foothold.contract import FootholdStatus
from jaxleg.foothold.rectangle import Extent, SearchRectangle
from jaxleg.gait.nominal import nominal_stances
from jaxleg.gait.params import GaitParams
from jaxleg.gait.support import CogRule
from jaxleg.leg.workspace import UNBOUND, Workspace
from jaxleg.posture.collision import Sizes, robot_obstacles
from jaxleg.route.stations import Straight
from jaxleg.status import Status
from jaxleg.terrain import Grid, flat, rough, stairs
from jaxleg.terrain.site import Site
from jaxleg.walk.build import build_walk
from jaxleg.walk.choices import no_choice
from jaxleg.walk.presets import paper_a

GRID = Grid(112, 52, 0.02, (-0.9, -0.51))
TERRAINS = {
    "flat": flat,
    "stairs": lambda g: stairs(g, 0.08, 0.30, 0.1),
    "rough": lambda g: rough(g, jax.random.key(1), 0.05, 0.25),
}


@functools.partial(jax.jit, static_argnums=0)
def terrain_of(kind):
    return TERRAINS[kind](GRID)


def up_to(high):
    """The workspace that bounds nothing but the hips' height [m]."""
    return Workspace(*(jnp.full_like(high, bound) for bound in UNBOUND[:3]), high)


def gait(height=0.5, offset=-0.1, skew=0.1, step=0.2, length=0.62, width=0.36, swing=0.08, shift=0.45, hind=0.5, lift=0.1):
    others = (offset, skew, step, length, width, swing, shift, hind, lift)
    return GaitParams(up_to(jnp.asarray(height, float)), *(jnp.asarray(x, float) for x in others))


class Options(NamedTuple):
    """What paper A's planner is told besides the gait."""

    speed: jax.Array
    bend: jax.Array
    clearance: jax.Array
    load_share: jax.Array
    cog: CogRule
    threshold: jax.Array


def settings(bend=20.0, threshold=0.0, rule="overlap", ratio=0.5):
    numbers = (jnp.asarray(x, float) for x in (0.05, np.deg2rad(bend), 0.02, 0.1))
    return Options(*numbers, CogRule(jnp.asarray(ratio), rule), jnp.asarray(threshold))


SIZES = Sizes(0.02, 0.02, (0.8, 0.24, 0.15))


def crawl(robot, params, options, terrain, offsets, status, sizes=SIZES):
    """Paper A's walk along +x from the nominal footholds plus offsets (x, y)."""
    cycles, dtype = offsets.shape[0] - 1, terrain.elevation.dtype
    planner = planner_of(params, options, dtype)
    missing = jnp.where(jnp.any(status == FootholdStatus.NONE), Status.NO_FOOTHOLD, Status.OK).astype(jnp.int32)
    choices = no_choice(cycles, dtype)._replace(offset=offsets, found=status, status=missing)
    stations = planner.route.stations(planner.gait, None, 2 * cycles + 2)
    return build_walk(planner, robot, open_site(terrain, sizes), stations, choices)


def planner_of(params, options, dtype=float):
    """Paper A's, that searches no footholds."""
    speed, bend, clearance, load_share, cog, threshold = options
    no_search = SearchRectangle(*(jnp.zeros((), dtype) for _ in range(5)))
    return paper_a(params, no_search, Extent((0, 0), 0), cog, speed, bend, clearance, load_share, threshold)


def open_site(terrain, sizes=SIZES):
    """A terrain on which a foot may stand everywhere."""
    return Site(terrain, jnp.ones(terrain.elevation.shape, bool), robot_obstacles(sizes, terrain, 0.02))


def way_points(walk):
    """Trunk poses before the first shift, and after each."""
    return walk.poses[np.r_[0, 1 : walk.steps : 2]]


def in_numpy(walk):
    """Its arrays NumPy's, but for the gait's."""
    return dataclasses.replace(jax.tree.map(np.asarray, walk), gait=walk.gait)


def nominal_along_x(params, count):
    """Nominal footholds (x, y) of the first stances of a straight walk."""
    zero = jnp.zeros_like(params.step_length)
    return nominal_stances(params, Straight(zero).stations(params, None, 2 * count), count)[0]
