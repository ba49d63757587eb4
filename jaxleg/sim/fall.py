"""When a walk has fallen: the one definition for every rollout, and for the referee (`overturned`).

Tilt > 45 deg, the trunk below half its height over the feet, the trunk on the ground, or not finite (as over ground that
nobody has seen). The trunk's lower face is divided into tiles; each meets the ground where its lowest point is under the
highest cell within the tile's reach, looked up on a map that is widened before. So no cell under the box is missed, and one
beside it counts up to half a tile and a cell away. Unseen cells are no obstacle.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.contract import State
from jaxleg.numerics import matvec
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.terrain.heightmap import HeightMap

FALL_TILT = 0.7071  # cosine of 45 degrees
FALL_HEIGHT = 0.5  # share of the trunk's height over the feet at the start
TILES = (8, 2)  # of the trunk's lower face, along and across


class Trunk(NamedTuple):
    """What a fall is judged by, made once before a rollout; no gradient."""

    ground: HeightMap  # the highest cell within a tile's reach
    centre: Float[Array, "tile 3"]  # of the tiles, in B [m]
    half: Float[Array, "2"]  # of a tile, along and across [m]
    stand: Float[Array, ""]  # height of the trunk over the feet at the start [m]


def watch_trunk(robot: Robot, terrain: HeightMap, start: State, feet: Float[Array, "leg 3"]) -> Trunk:
    """What `fallen` needs, from the start of a walk with its feet in W [m]."""
    robot, terrain, start, feet = jax.lax.stop_gradient((robot, terrain, start, feet))
    x, y = ((np.arange(count) + 0.5) / count - 0.5 for count in TILES)
    face = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full(TILES, -0.5)], axis=-1).reshape(-1, 3)
    half = 0.5 * robot.trunk_size[:2] / jnp.array(TILES, start.q.dtype)
    reach = jnp.floor(jnp.sqrt(jnp.sum(half**2)) / terrain.resolution + 0.5).astype(jnp.int32)
    seen = jnp.where(jnp.isnan(terrain.elevation), -jnp.inf, terrain.elevation)
    ground = HeightMap(_widened(seen, reach), terrain.origin, terrain.resolution)
    return Trunk(ground, jnp.asarray(face, start.q.dtype) * robot.trunk_size[None], half, start.q[2] - jnp.mean(feet[:, 2]))


def _widened(elevation: Float[Array, "nx ny"], cells: Int[Array, ""]) -> Float[Array, "nx ny"]:
    """The highest cell within so many cells along x and y."""

    def grow(_, h):
        """Widened by one cell to either side."""
        for axis in (0, 1):
            low = jnp.full_like(jax.lax.slice_in_dim(h, 0, 1, axis=axis), -jnp.inf)
            before = jnp.concatenate([low, jax.lax.slice_in_dim(h, 0, -1, axis=axis)], axis)
            after = jnp.concatenate([jax.lax.slice_in_dim(h, 1, None, axis=axis), low], axis)
            h = jnp.maximum(h, jnp.maximum(before, after))
        return h

    return jax.lax.fori_loop(0, cells, grow, elevation)


def fallen(trunk: Trunk, state: State, foot: Float[Array, "leg 3"]) -> Bool[Array, ""]:
    """Whether a state, its feet in W [m], is a fall."""
    state, foot = jax.lax.stop_gradient((state, foot))
    rotation = rotation_from_quaternion(state.q[3:7])
    down = overturned(rotation[2, 2], state.q[2] - jnp.mean(foot[:, 2]), trunk.stand)
    unknown = ~jnp.isfinite(jnp.sum(state.q) + jnp.sum(state.v))
    return down | touches(trunk, state.q[:3], rotation) | unknown


def overturned(upright, height, stand):
    """Whether a trunk is tilted, or low over its feet: cosine of its tilt, height [m] now and at the start. Any arrays."""
    return (upright < FALL_TILT) | (height < FALL_HEIGHT * stand)


def touches(trunk: Trunk, position: Float[Array, "3"], rotation: Float[Array, "3 3"]) -> Bool[Array, ""]:
    """Whether the trunk's lower face meets the ground, B's origin at `position` in W [m]."""
    place = position[None] + matvec(rotation, trunk.centre)
    lowest = place[:, 2] - jnp.sum(jnp.abs(rotation[2, :2]) * trunk.half)
    ground = trunk.ground
    last = jnp.array([ground.elevation.shape], jnp.int32) - 1
    cell = jnp.round((place[:, :2] - ground.origin[None]) / ground.resolution).astype(jnp.int32)
    cell = jnp.clip(cell, 0, last)
    return jnp.any(lowest < ground.elevation[cell[:, 0], cell[:, 1]])
