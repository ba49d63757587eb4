"""Turns: about an axis, of a quaternion, and of a trunk by pitch, roll and yaw."""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.numerics import cross_matrix


def rotation_about(axis: Float[Array, "3"], angle: Float[ArrayLike, ""]) -> Float[Array, "3 3"]:
    """Rotation matrix by `angle` [rad] about a unit axis (Rodrigues)."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return c * jnp.eye(3, dtype=axis.dtype) + s * cross_matrix(axis) + (1.0 - c) * axis[:, None] * axis[None, :]


def rotation_from_quaternion(quaternion: Float[Array, "4"]) -> Float[Array, "3 3"]:
    """Rotation matrix B -> W of a unit quaternion (w, x, y, z)."""
    w, x, y, z = (quaternion[i] for i in range(4))
    return jnp.stack(
        [
            *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        ]
    ).reshape(3, 3)


def trunk_rotation(turn: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rotation B -> W of a turn (pitch, roll, yaw) [rad]: roll to the right about x, then nose-up pitch about -y, then yaw
    to the left about z (paper C, 3.1: yaw, and roll and pitch with the ground)."""
    (cp, cr, cy), (sp, sr, sy) = jnp.cos(turn), jnp.sin(turn)
    ahead, aside = jnp.stack([cp, -sp * sr, -sp * cr]), jnp.stack([jnp.zeros_like(cr), cr, -sr])
    return jnp.stack([cy * ahead - sy * aside, sy * ahead + cy * aside, jnp.stack([sp, cp * sr, cp * cr])])


def trunk_quaternion(turn: Float[Array, "3"]) -> Float[Array, "4"]:
    """Unit quaternion (w, x, y, z) of `trunk_rotation`."""
    (cp, cr, cy), (sp, sr, sy) = jnp.cos(0.5 * turn), jnp.sin(0.5 * turn)
    return jnp.stack(
        [
            *(cy * cp * cr - sy * sp * sr, cy * cp * sr + sy * sp * cr),
            *(sy * cp * sr - cy * sp * cr, sy * cp * cr + cy * sp * sr),
        ]
    )


def trunk_spin(turn: Float[Array, "3"], rate: Float[Array, "3"]) -> Float[Array, "3"]:
    """Angular velocity in B [rad/s] of a turn (pitch, roll, yaw) that changes at `rate` [rad/s]."""
    (cp, cr), (sp, sr) = jnp.cos(turn[:2]), jnp.sin(turn[:2])
    pitch, roll, yaw = rate[0], rate[1], rate[2]
    return jnp.stack([roll + yaw * sp, yaw * cp * sr - pitch * cr, yaw * cp * cr + pitch * sr])


def turned(point: Float[Array, "*n 2"], yaw: Float[Array, ""]) -> Float[Array, "*n 2"]:
    """(ahead, left) of a heading [rad] as (x, y)."""
    return jnp.cos(yaw) * point + jnp.sin(yaw) * _left_of(point)


def to_heading(point: Float[Array, "*n 2"], yaw: Float[Array, ""]) -> Float[Array, "*n 2"]:
    """(x, y) as (ahead, left) of a heading [rad]: the inverse of `turned`."""
    return jnp.cos(yaw) * point - jnp.sin(yaw) * _left_of(point)


def _left_of(point):
    """A quarter turn to the left."""
    return jnp.stack([-point[..., 1], point[..., 0]], axis=-1)
