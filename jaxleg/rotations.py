"""Turns: about an axis, of a quaternion, and of a trunk by pitch, roll and yaw."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.vectors import Rows, Vector, parts


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
    """Rotation B -> W of a turn (pitch, roll, yaw) [rad], see `trunk_rows`."""
    rows = trunk_rows(turn)
    return jnp.stack([row.array() for row in (rows.x, rows.y, rows.z)])


def trunk_rows(turn: Float[Array, "3 *n"]) -> Rows:
    """Rotation B -> W of a turn (pitch, roll, yaw) [rad]: roll to the right about x, then nose-up pitch about -y, then yaw
    to the left about z (paper C, 3.1: yaw, and roll and pitch with the ground)."""
    (cp, cr, cy), (sp, sr, sy) = parts(jnp.cos(turn)), parts(jnp.sin(turn))
    ahead = Vector(cp, -sp * sr, -sp * cr)
    x = Vector(cy * ahead.x, cy * ahead.y - sy * cr, cy * ahead.z + sy * sr)
    y = Vector(sy * ahead.x, sy * ahead.y + cy * cr, sy * ahead.z - cy * sr)
    return Rows(x, y, Vector(sp, cp * sr, cp * cr))


def trunk_quaternion(turn: Float[Array, "3"]) -> Float[Array, "4"]:
    """Unit quaternion (w, x, y, z) of `trunk_rotation`."""
    (cp, cr, cy), (sp, sr, sy) = jnp.cos(0.5 * turn), jnp.sin(0.5 * turn)
    return jnp.stack(
        [
            *(cy * cp * cr - sy * sp * sr, cy * cp * sr + sy * sp * cr),
            *(sy * cp * sr - cy * sp * cr, sy * cp * cr + cy * sp * sr),
        ]
    )


def trunk_spin(turn: Float[Array, "3 *n"], rate: Float[Array, "3 *n"]) -> Float[Array, "3 *n"]:
    """Angular velocity in B [rad/s] of a turn (pitch, roll, yaw) that changes at `rate` [rad/s]."""
    (cp, cr, _), (sp, sr, _) = parts(jnp.cos(turn)), parts(jnp.sin(turn))
    pitch, roll, yaw = parts(rate)
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
