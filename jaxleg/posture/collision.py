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
from jaxleg.terrain.heightmap import HeightMap, nearest_height
from jaxleg.terrain.obstacles import Obstacles, highest_near, obstacles

THIGH = (0.5, 1.0)  # places of the tested points along the thigh ...
SHANK = (0.2, 0.4, 0.6, 0.75)  # ... and along the shank, from the knee
TRUNK = (5, 3)  # points along and across the trunk's lower face


class Sizes(NamedTuple):
    """Radii and trunk of a robot as numbers [m]: they set the windows that a map is widened by, and are static."""

    leg_radius: float
    foot_radius: float
    trunk: tuple[float, ...]

    @classmethod
    def of(cls, robot: Robot) -> "Sizes":
        """Those of a concrete robot."""
        return cls(float(robot.leg_radius), float(robot.foot_radius), tuple(np.asarray(robot.trunk_size).tolist()))

    @property
    def trunk_spacing(self) -> float:
        """Greatest distance between neighbouring points of the trunk's lower face."""
        return max(self.trunk[axis] / (count - 1) for axis, count in enumerate(TRUNK))


def robot_obstacles(sizes: Sizes, terrain: HeightMap, resolution: float) -> Obstacles:
    """A map widened for a robot's legs and trunk; the sizes and the `resolution` [m per cell] are static."""
    return obstacles(terrain, resolution, max(sizes.leg_radius, sizes.foot_radius), sizes.trunk_spacing)


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
