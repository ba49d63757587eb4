"""Feet on the ground."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.robot import Robot
from jaxleg.terrain.heightmap import HeightMap, height_and_gradient


def on_ground(robot: Robot, terrain: HeightMap, xy: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
    """Foot centres [m] that rest on the ground at xy: the contact sphere touches the tangent plane there."""
    sample = height_and_gradient
    for _ in xy.shape[:-1]:
        sample = jax.vmap(sample, in_axes=(None, 0))
    ground, slope = sample(terrain, xy)
    return jnp.concatenate([xy, (ground + robot.contact_radius * jnp.sqrt(1.0 + jnp.sum(slope**2, -1)))[..., None]], -1)
