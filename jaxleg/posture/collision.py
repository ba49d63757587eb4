"""Collisions of legs and trunk with the ground. Paper C, 3.2 (C12).

Legs are capsules round thigh and shank, the trunk is a box; the ground is the height map as columns, one a cell. Both are
tested at points, each against the highest column within the capsule's radius, or within the distance that the trunk's points
leave untested. So a clearance is never greater than the true one but for the points' spacing along a capsule. The shank's
lower end is left out: there it stands on the ground.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.leg.dynamics import all_leg_frames
from jaxleg.numerics import matvec
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_rotation
from jaxleg.terrain.features import Disc, over_disc
from jaxleg.terrain.heightmap import HeightMap, nearest_height

THIGH = (0.5, 1.0)  # places of the tested points along the thigh ...
SHANK = (0.2, 0.4, 0.6, 0.75)  # ... and along the shank, from the knee
TRUNK = (5, 3)  # points along and across the trunk's lower face


class Obstacles(NamedTuple):
    """The ground as columns, widened for a look at one point of a leg or trunk; no obstacle (-inf) where unseen."""

    leg: HeightMap  # by whole cells
    rest: Float[Array, ""]  # what is left of a leg's radius beyond them [m]
    trunk: HeightMap  # by what the trunk's points leave between them


def obstacles(terrain: HeightMap, resolution: float, leg_radius: float, trunk_spacing: float) -> Obstacles:
    """Widen a map; lengths [m] and the map's `resolution` are static."""
    seen = jnp.where(jnp.isfinite(terrain.elevation), terrain.elevation, -jnp.inf)

    def widened(window: Disc) -> HeightMap:
        return HeightMap(over_disc(seen, -jnp.inf, jax.lax.max, window), terrain.origin, terrain.resolution)

    cells = max(int(np.ceil(leg_radius / resolution - 0.5 - 1e-6)), 0)
    square = tuple((i, j) for i in range(-cells, cells + 1) for j in range(-cells, cells + 1))
    rest = jnp.asarray(max(leg_radius - cells * resolution, 0.0), seen.dtype)
    return Obstacles(widened(square), rest, widened(columns_within(trunk_spacing / np.sqrt(2.0), resolution)))


def highest_near(ground: Obstacles, xy: Float[Array, "2"]) -> Float[Array, ""]:
    """Highest column [m] within a leg's radius of xy along x and y: the corners of that square, on the widened map."""
    corners = xy[None] + ground.rest * jnp.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]], xy.dtype)
    return jnp.max(jax.vmap(nearest_height, in_axes=(None, 0))(ground.leg, corners))


def columns_within(radius: float, resolution: float) -> Disc:
    """Offsets of the cells whose square columns come within a radius [m] of some point of the middle cell; static."""
    reach = int(np.ceil(radius / resolution)) + 1
    gap = np.maximum(np.abs(np.arange(-reach, reach + 1)) - 1, 0) * resolution
    near = np.hypot(gap[:, None], gap[None]) < radius
    return tuple((int(i), int(j)) for i, j in np.argwhere(near) - reach)


def trunk_spacing(trunk_size: np.ndarray) -> float:
    """Greatest distance [m] between neighbouring points of a trunk's lower face, of its length, width and height [m]."""
    return float(max(trunk_size[axis] / (count - 1) for axis, count in enumerate(TRUNK)))


def leg_points(robot: Robot, pose: Float[Array, "6"], angles: Float[Array, "leg joint"]) -> Float[Array, "leg point 3"]:
    """Points on the axes of thighs and shanks, in W [m]."""
    frames = all_leg_frames(robot, angles)
    knee, ankle = frames.origin[:, 2], frames.foot
    thigh, shank = (jnp.asarray(places, knee.dtype)[None, :, None] for places in (THIGH, SHANK))
    hip = frames.origin[:, 1, None]
    points = jnp.concatenate([hip + thigh * (knee[:, None] - hip), knee[:, None] + shank * (ankle - knee)[:, None]], axis=1)
    return pose[None, None, :3] + matvec(trunk_rotation(pose[3:]), robot.hip_position[:, None] + points)


def leg_clearance(
    robot: Robot, ground: Obstacles, pose: Float[Array, "6"], angles: Float[Array, "leg joint"]
) -> Float[Array, "leg"]:
    """Least height [m] of each leg's capsules over the ground; negative: they touch it."""
    points = leg_points(robot, pose, angles)
    under = jax.vmap(jax.vmap(highest_near, in_axes=(None, 0)), in_axes=(None, 0))(ground, points[..., :2])
    return jnp.min(points[..., 2] - robot.leg_radius - under, axis=1)


def trunk_clearance(robot: Robot, ground: Obstacles, pose: Float[Array, "6"]) -> Float[Array, ""]:
    """Least height [m] of the trunk's lower face over the ground; negative: it touches it."""
    x, y = (np.linspace(-0.5, 0.5, count) for count in TRUNK)
    face = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full(TRUNK, -0.5)], axis=-1).reshape(-1, 3)
    points = pose[None, :3] + matvec(trunk_rotation(pose[3:]), jnp.asarray(face, pose.dtype) * robot.trunk_size[None])
    return jnp.min(points[:, 2] - jax.vmap(nearest_height, in_axes=(None, 0))(ground.trunk, points[:, :2]))
