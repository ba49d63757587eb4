"""Penalty contact of a spherical foot with the ground, linearised for a semi-implicit step.

With penetration d along the ground's normal n and foot velocity w:

    f_e = k_n b softplus(d / b)                              elastic normal force
    C_n = (d_n + dt k_n) sigmoid(d / b)                      normal damping, and the spring's own change over the step
    C_t = mu f_e / sqrt(|w_t|^2 + v_0^2)                     friction: Coulomb beyond v_0, viscous below
    f(w+) = f_e n - C w+,   C = C_n n n^T + C_t (1 - n n^T)   w+ the velocity after the step

Smooth everywhere, so gradients through a whole gait cycle are true; no iteration, no state.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.numerics import dot
from jaxleg.terrain.heightmap import HeightMap, height_and_gradient


class Ground(NamedTuple):
    """Material of ground and foot."""

    stiffness: float = 6e4  # k_n [N/m]
    damping: float = 1e3  # d_n [N s/m]
    softness: float = 5e-4  # b: length over which contact sets in [m]
    friction: float = 0.8  # mu
    creep: float = 3e-3  # v_0: sliding speed at which friction is at 71 % of its limit [m/s]


class FootContact(NamedTuple):
    """Force at the foot as a function of its velocity w after the step: `force` - `resistance` w, in W."""

    force: Float[Array, "3"]  # [N]
    resistance: Float[Array, "3 3"]  # [N s/m]
    penetration: Float[Array, ""]  # [m]
    normal: Float[Array, "3"]


def foot_contact(
    ground: Ground,
    terrain: HeightMap,
    radius: Float[ArrayLike, ""],
    position: Float[Array, "3"],
    velocity: Float[Array, "3"],
    dt: Float[ArrayLike, ""],
) -> FootContact:
    """Linearised contact of one foot sphere (centre `position` [m], `velocity` [m/s], in W) over a step of dt [s]."""
    surface, slope = height_and_gradient(terrain, position[:2])
    normal = jnp.stack([-slope[0], -slope[1], jnp.ones_like(surface)])
    normal = normal * jax.lax.rsqrt(1.0 + dot(slope, slope))
    penetration = jnp.asarray(radius) - (position[2] - surface) * normal[2]
    depth = penetration / ground.softness
    elastic = ground.stiffness * ground.softness * jax.nn.softplus(depth)
    across = (ground.damping + dt * ground.stiffness) * jax.nn.sigmoid(depth)
    tangential = velocity - normal * dot(normal, velocity)
    along = ground.friction * elastic * jax.lax.rsqrt(dot(tangential, tangential) + ground.creep**2)
    identity = jnp.eye(3, dtype=position.dtype)
    resistance = along * identity + (across - along) * normal[:, None] * normal[None, :]
    return FootContact(elastic * normal, resistance, penetration, normal)
