"""What randomised lanes are truly walked with and on: robots and grounds that differ from what their planners know.

A planner has the study's robot and a noisy map, of which it takes the median about each cell; the controllers have the gains of
the lane's robot, the feed-forward torques are the plan's. A lane's draw depends on the study's seed, the kind of terrain and
the lane's number: all contestants meet the same, and so they do in a study of more lanes.
"""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxleg.posture.collision import Sizes
from jaxleg.robot import Robot
from jaxleg.search.config import Randomise, Study
from jaxleg.search.sites import make_sites, share, sites_on
from jaxleg.sim.contact import Ground
from jaxleg.terrain.generators import terrain_keys
from jaxleg.terrain.heightmap import HeightMap, height
from jaxleg.terrain.site import Site
from jaxleg.terrain.window import Disc, disc, median
from jaxleg.walk.data import Reference

MASSES = ("trunk_mass", "trunk_inertia", "link_mass", "link_inertia")
FIRST_KEY = 300  # of the first kind's lanes: below it are those of terrains, starts and random gaits


class Truth(NamedTuple):
    """What a lane is walked with and on; planners need not know it."""

    robot: Robot
    ground: Ground
    terrain: HeightMap


def make_worlds(study: Study, robot: Robot, ground: Ground, kind: str) -> tuple[Site, Truth]:
    """The randomised lanes of a kind, leading axis lane: as planners see them, and as they are.

    Their terrains are held-out ones, spread evenly over them; a kind that has fewer has them again, in other worlds.
    """
    number = list(study.kinds).index(kind)
    count = share(study.randomise.lanes, len(study.kinds), number)
    terrain = make_sites(study, robot, kind, held_out=True).terrain
    pick = np.arange(count) * terrain.elevation.shape[0] // count
    terrain = jax.tree.map(lambda x: np.asarray(x)[pick], terrain)
    keys = terrain_keys(jax.random.fold_in(jax.random.key(study.seed), FIRST_KEY + number), 0, count)
    truth, seen = worlds(study.randomise, robot, ground, terrain, keys)
    seen = _filtered(disc(study.randomise.map_filter * float(robot.foot_radius), study.terrains.resolution), seen)
    return sites_on(study.terrains, Sizes.of(robot), seen), truth


@functools.partial(jax.jit, static_argnums=0)
def _filtered(window: Disc, seen: HeightMap) -> HeightMap:
    return dataclasses.replace(seen, elevation=jax.vmap(functools.partial(median, window=window))(seen.elevation))


@functools.partial(jax.jit, static_argnums=0)
def worlds(ranges: Randomise, robot: Robot, ground: Ground, terrain: HeightMap, keys: Array) -> tuple[Truth, HeightMap]:
    """A world for each key, on terrains with a leading axis, and the map of it that planners see."""
    return jax.vmap(functools.partial(_world, ranges, robot, ground))(terrain, keys)


def _world(ranges: Randomise, robot: Robot, ground: Ground, terrain: HeightMap, key: Array) -> tuple[Truth, HeightMap]:
    of_robot, of_ground, of_map = jax.random.split(key, 3)
    material = Ground(*(jnp.asarray(x, float) for x in ground))
    material = material._replace(friction=jax.random.uniform(of_ground, (), float, *ranges.friction))
    noise = ranges.map_noise * jax.random.uniform(of_map, terrain.elevation.shape, float, -1.0, 1.0)
    truth = Truth(_robot(ranges, robot, of_robot), material, terrain)
    return truth, dataclasses.replace(terrain, elevation=terrain.elevation + noise)


def _robot(ranges: Randomise, robot: Robot, key: Array) -> Robot:
    """The robot with its masses, its trunk's centre of mass and its gains off by what is drawn uniformly from the ranges."""
    mass, stiffness, velocity_gain, *com = jax.random.uniform(key, (6,), float, -1.0, 1.0)
    changed = {name: (1.0 + ranges.mass * mass) * getattr(robot, name) for name in MASSES}
    changed["trunk_com"] = robot.trunk_com + ranges.com * jnp.stack(com)
    changed["stiffness"] = (1.0 + ranges.gains * stiffness) * robot.stiffness
    changed["velocity_gain"] = (1.0 + ranges.gains * velocity_gain) * robot.velocity_gain
    return dataclasses.replace(robot, **changed)


def set_down(reference: Reference, seen: HeightMap, true: HeightMap) -> Reference:
    """A reference of one lane, planned on the map as seen, its start so high that the first foot just touches the true ground:
    one that began inside the ground would be thrown out of it."""
    feet = reference.foot_pos[0, :, :2]
    above = jax.vmap(height, in_axes=(None, 0))
    lift = jnp.max(above(true, feet) - above(seen, feet))
    up = lift * jnp.array([0.0, 0.0, 1.0], lift.dtype)
    return reference._replace(trunk_pos=reference.trunk_pos.at[0].add(up))
