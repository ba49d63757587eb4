"""Compound cycloid of a swinging foot. Paper B, equation (2)."""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float


def cycloid_advance(share: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """Horizontal part of the way covered, x/S = s - sin(2 pi s)/(2 pi), at share s in [0, 1] of the time (B, eq. 2)."""
    return jnp.asarray(share) - jnp.sin(2.0 * jnp.pi * share) / (2.0 * jnp.pi)


def cycloid_share(advance: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """Share of the time at which a part of the way in [0, 1] is covered: the inverse of `cycloid_advance`, by bisection."""
    low = jnp.zeros_like(jnp.asarray(advance))
    width = jnp.ones_like(low)
    for _ in range(24):
        width = 0.5 * width
        low = jnp.where(cycloid_advance(low + width) <= advance, low + width, low)
    return low + 0.5 * width


def cycloid_lift(share: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """Height over the start, z/H = (1 - cos(2 pi s))/2, at share s in [0, 1] of the time (B, eq. 2)."""
    return 0.5 * (1.0 - jnp.cos(2.0 * jnp.pi * share))


def swing_foot(
    start: Float[Array, "3 *n"],
    end: Float[Array, "3 *n"],
    apex: Float[ArrayLike, "*n"],
    share: Float[ArrayLike, "*n"],
    lift_share: Float[ArrayLike, "*n"],
) -> Float[Array, "3 *n"]:
    """Foot [m] at share of a swing from `start` to `end`: a rising half cycloid, then a falling one.

    The top lies `apex` above the higher end. In the first and last `lift_share` of the time the foot moves only up or
    down, which clears a riser right ahead of it; 0 is the plain compound cycloid. Speed is zero at both ends.
    """
    share = jnp.asarray(share)
    advance = cycloid_advance(jnp.clip((share - lift_share) / (1.0 - 2.0 * lift_share), 0.0, 1.0))
    top = jnp.maximum(start[2], end[2]) + apex
    base = jnp.where(share < 0.5, start[2], end[2])
    height = base + (top - base) * cycloid_lift(share)
    return jnp.concatenate([start[:2] + (end[:2] - start[:2]) * advance[None], height[None]])
