"""The plane of a leg: it rolls about the hip joint's axis, and thigh and shank pitch in it.

All that this package knows of a leg rests on this: the hip joint's axis is x or -x of B, those of thigh and knee are y or -y of
the hip's link. In the plane's frame P, at the hip joint, x is B's and y the pitch axis; the hip's link rests in it. Functions
are for one leg (`vmap` them over legs) at an instant, or at many in axes of their own behind all others.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.vectors import Vector, parts, vectors


class Angle(NamedTuple):
    """An angle by cosine and sine."""

    cos: Float[Array, "*n"]
    sin: Float[Array, "*n"]


def direction(x: Float[Array, "*m"], y: Float[Array, "*n"]) -> Angle:
    """The angle of (x, y) from the x axis; zero, with a gradient of zero, at the origin."""
    square = x * x + y * y
    away = square > 0.0
    scale = jax.lax.rsqrt(jnp.where(away, square, 1.0))
    return Angle(jnp.where(away, x * scale, 1.0), y * scale)


def radians(angle: Angle) -> Float[Array, "*n"]:
    """The angle from -pi to pi [rad]."""
    return jnp.arctan2(angle.sin, angle.cos)


def less(a: Angle, b: Angle) -> Angle:
    """The angle a - b."""
    return Angle(a.cos * b.cos + a.sin * b.sin, a.sin * b.cos - a.cos * b.sin)


class Fold(NamedTuple):
    """A leg's posture: roll of its plane about x, and pitch about y, in the plane, of thigh and shank."""

    roll: Angle
    thigh: Angle
    shank: Angle


class Chain(NamedTuple):
    """A leg in P [m]: the hip's link, thigh and shank from joint to joint, and the foot."""

    hip: Vector  # ends in the thigh's joint
    thigh: Vector
    shank: Vector
    foot: Vector


def signed(axis: Float[Array, "joint 3"], joints: Float[Array, "joint *n"]) -> list[Float[Array, "*n"]]:
    """Joint angles (or their rates) as roll, thigh's pitch and shank's pitch about x and y."""
    hip, thigh, knee = parts(joints)
    pitch = axis[1, 1] * thigh
    return [axis[0, 0] * hip, pitch, pitch + axis[2, 1] * knee]


def by_joint(
    axis: Float[Array, "joint 3"], roll: Float[Array, "*n"], thigh: Float[Array, "*n"], shank: Float[Array, "*n"]
) -> Float[Array, "joint *n"]:
    """The inverse of `signed`: an axis' sign is its own inverse."""
    return jnp.stack([axis[0, 0] * roll, axis[1, 1] * thigh, axis[2, 1] * (shank - thigh)])


def fold_of(axis: Float[Array, "joint 3"], angles: Float[Array, "joint *n"]) -> Fold:
    """The posture at joint angles [rad]."""
    return Fold(*(Angle(jnp.cos(angle), jnp.sin(angle)) for angle in signed(axis, angles)))


def into_plane(roll: Angle, v: Vector) -> Vector:
    """A vector of B in P."""
    return Vector(v.x, roll.cos * v.y + roll.sin * v.z, roll.cos * v.z - roll.sin * v.y)


def out_of_plane(roll: Angle, v: Vector) -> Vector:
    """A vector of P in B."""
    return Vector(v.x, roll.cos * v.y - roll.sin * v.z, roll.cos * v.z + roll.sin * v.y)


def pitched(pitch: Angle, v: Vector) -> Vector:
    """A vector of a pitched link in P."""
    return Vector(pitch.cos * v.x + pitch.sin * v.z, v.y, pitch.cos * v.z - pitch.sin * v.x)


def unpitched(pitch: Angle, v: Vector) -> Vector:
    """A vector of P in a pitched link."""
    return Vector(pitch.cos * v.x - pitch.sin * v.z, v.y, pitch.cos * v.z + pitch.sin * v.x)


def link_rotation(roll: Angle, pitch: Angle) -> Float[Array, "3 3"]:
    """Rotation of a pitched link's frame to B."""
    zero = jnp.zeros_like(pitch.cos)
    ahead = jnp.stack([pitch.cos, zero, pitch.sin])
    aside = jnp.stack([roll.sin * pitch.sin, roll.cos, -roll.sin * pitch.cos])
    return jnp.stack([ahead, aside, jnp.stack([-roll.cos * pitch.sin, roll.sin, roll.cos * pitch.cos])])


def chain_of(offset: Float[Array, "joint 3"], fold: Fold) -> Chain:
    """Links and foot in a posture."""
    hip, thigh, shank = vectors(offset)
    thigh, shank = pitched(fold.thigh, thigh), pitched(fold.shank, shank)
    return Chain(hip, thigh, shank, hip + thigh + shank)
