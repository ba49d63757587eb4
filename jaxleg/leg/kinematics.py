"""Kinematics of one leg: forward, exact inverse with both knee branches, Jacobian. Paper A, equation (2).

Positions are in a frame at the hip joint, parallel to B. The inverse assumes what A's legs share with most quadrupeds:
a roll joint followed by two parallel pitch joints; link offsets may have fore-aft and lateral parts. All functions are for
one leg; `vmap` them over the leading leg axis of `Robot`'s fields.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxleg.leg.plane import Angle, Fold, by_joint, chain_of, direction, fold_of, into_plane, less, link_rotation, radians
from jaxleg.numerics import Code, away_from_zero, cross, matvec, sqrt_safe
from jaxleg.vectors import Vector, vector


class LegFrames(NamedTuple):
    """Pose of a leg's links: rotation link -> trunk, joint positions, joint axes and foot, in the hip's frame."""

    rotation: Float[Array, "joint 3 3"]
    origin: Float[Array, "joint 3"]
    axis: Float[Array, "joint 3"]
    foot: Float[Array, "3"]


class Reach(Code):
    """Outcome of the inverse kinematics; anything but `OK` means the angles are those of a clamped target."""

    OK = 0
    TOO_FAR = 1
    TOO_NEAR = 2
    NOT_FINITE = 3


def leg_frames(axis: Float[Array, "joint 3"], offset: Float[Array, "joint 3"], angles: Float[Array, "joint"]) -> LegFrames:
    """Frames of the three links. `axis` and `offset` are one leg's `joint_axis` and `link_offset` (paper A, eq. 2)."""
    roll, thigh, shank = fold_of(axis, angles)
    level = Angle(jnp.ones_like(roll.cos), jnp.zeros_like(roll.cos))
    rotation = jnp.stack([link_rotation(roll, pitch) for pitch in (level, thigh, shank)])
    link = matvec(rotation, offset)
    knee = link[0] + link[1]
    return LegFrames(rotation, jnp.stack([jnp.zeros_like(knee), link[0], knee]), matvec(rotation, axis), knee + link[2])


def foot_position(
    axis: Float[Array, "joint 3"], offset: Float[Array, "joint 3"], angles: Float[Array, "joint"]
) -> Float[Array, "3"]:
    """Foot relative to the hip joint [m], axes of B. Paper A, equation (2)."""
    return leg_frames(axis, offset, angles).foot


def foot_jacobian(frames: LegFrames) -> Float[Array, "3 joint"]:
    """d foot / d angles [m/rad]: column j is axis_j x (foot - origin_j)."""
    return jnp.swapaxes(cross(frames.axis, frames.foot[None] - frames.origin), 0, 1)


def joint_rates(
    axis: Float[Array, "joint 3"],
    offset: Float[Array, "joint 3"],
    fold: Fold,
    velocity: Vector,
    acceleration: Vector,
) -> tuple[Float[Array, "joint *n"], Float[Array, "joint *n"]]:
    """Joint velocities and accelerations that move the foot so in the hip's frame [m/s, m/s^2].

    In P the foot (X, Y, Z) is the end of links (x, z), whose pitch rates are t, and P rolls at w: v = (X', -w Z, Z' + w Y) with
    X' = z_2 t_2 + z_3 t_3 and Z' = -x_2 t_2 - x_3 t_3. Large but finite where that has no solution, as at the stretched leg.
    """
    _, thigh, shank, foot = chain_of(offset, fold)
    v, a = into_plane(fold.roll, velocity), into_plane(fold.roll, acceleration)
    depth, area = away_from_zero(foot.z), away_from_zero(thigh.x * shank.z - thigh.z * shank.x)

    def pitches(ahead, up):
        return -(shank.x * ahead + shank.z * up) / area, (thigh.x * ahead + thigh.z * up) / area

    rolls = -v.y / depth
    rises = v.z - rolls * foot.y
    second, third = pitches(v.x, rises)
    rolls_on = -(a.y + 2.0 * rolls * rises + rolls**2 * foot.y) / depth
    ahead = a.x + second**2 * thigh.x + third**2 * shank.x
    up = a.z - rolls_on * foot.y + rolls**2 * foot.z + second**2 * thigh.z + third**2 * shank.z
    return by_joint(axis, rolls, second, third), by_joint(axis, rolls_on, *pitches(ahead, up))


def carried_sum(x: Float[Array, "joint *n"]) -> Float[Array, "joint *n"]:
    """Sums over each joint and those after it: a joint carries its link and all beyond."""
    second = x[1] + x[2]
    return jnp.stack([x[0] + second, second, x[2]])


class Inverse(NamedTuple):
    """What the inverse kinematics finds."""

    angles: Float[Array, "joint *n"]
    fold: Fold  # the posture at these angles
    reach: Int[Array, "*n"]


def leg_angles(
    axis: Float[Array, "joint 3"],
    offset: Float[Array, "joint 3"],
    knee_sign: Float[ArrayLike, ""],
    foot: Float[Array, "3"],
) -> tuple[Float[Array, "joint"], Int[Array, ""]]:
    """Angles and `Reach` of `leg_inverse`."""
    found = leg_inverse(axis, offset, knee_sign, vector(foot))
    return found.angles, found.reach


def leg_inverse(
    axis: Float[Array, "joint 3"], offset: Float[Array, "joint 3"], knee_sign: Float[ArrayLike, ""], foot: Vector
) -> Inverse:
    """Closed-form inverse of `foot_position` with the foot below the hip, and a `Reach` status.

    `foot` [m] is relative to the hip joint; `knee_sign` +1 puts the knee backward (Pegasus), -1 forward. A target out of
    reach is clamped to the stretched (or fully folded) leg with zero gradient there, and says so in the status.
    """
    lateral = jnp.sum(offset[:, 1])
    depth_squared = foot.y**2 + foot.z**2 - lateral**2
    depth = jnp.sqrt(jnp.maximum(depth_squared, 1e-12))  # the root of 0 has no gradient
    roll = less(direction(foot.y, foot.z), direction(lateral, -depth))
    x, down = foot.x - offset[0, 0], depth + offset[0, 2]
    thigh, shank = (sqrt_safe(offset[j, 0] ** 2 + offset[j, 2] ** 2) for j in (1, 2))
    cosine = (x * x + down * down - thigh**2 - shank**2) / (2.0 * thigh * shank)
    bend = _bend(cosine, knee_sign)
    swing = less(direction(down, x), direction(thigh + shank * bend.cos, shank * bend.sin))
    tilts = [direction(-offset[j, 2], offset[j, 0]) for j in (1, 2)]
    fold = Fold(roll, less(tilts[0], swing), less(less(tilts[1], swing), bend))
    tilt_thigh, tilt_shank = (radians(tilt) for tilt in tilts)
    turned = radians(swing)  # the foot is below: a thigh that far to the knee's other side has come round behind
    turned = turned - jnp.where(knee_sign * turned > 0.5 * jnp.pi, 2.0 * jnp.pi * knee_sign, 0.0)
    angles = by_joint(axis, radians(roll), tilt_thigh - turned, tilt_shank - turned - radians(bend))
    return Inverse(angles, fold, _reach(foot, depth_squared, cosine))


def _bend(cosine, knee_sign) -> Angle:
    """The knee's bend, its cosine clamped."""
    cosine = jnp.clip(cosine, -1.0, 1.0)
    return Angle(cosine, knee_sign * sqrt_safe(1.0 - cosine**2))


def _reach(foot: Vector, depth_squared, cosine):
    too_near = (cosine < -1.0) | (depth_squared < 0.0)
    status = jnp.where(cosine > 1.0, Reach.TOO_FAR, jnp.where(too_near, Reach.TOO_NEAR, Reach.OK))
    known = jnp.isfinite(foot.x + foot.y + foot.z) & ~jnp.isnan(cosine)
    return jnp.where(known, status, Reach.NOT_FINITE).astype(jnp.int32)


def knee_bend(
    axis: Float[Array, "joint 3"], offset: Float[Array, "joint 3"], angles: Float[Array, "joint *n"]
) -> Float[Array, "*n"]:
    """Angle between thigh and shank in the leg's plane [rad], from 0 (stretched straight) to pi."""
    tilt_thigh, tilt_shank = (jnp.arctan2(offset[j, 0], -offset[j, 2]) for j in (1, 2))
    turned = tilt_shank - tilt_thigh - axis[2, 1] * angles[2]
    return jnp.abs(turned - 2.0 * jnp.pi * jnp.round(turned / (2.0 * jnp.pi)))


def range_slack(joint_range: Float[Array, "*m 2"], angles: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Distance of joint angles to the nearer end of their ranges [rad]; negative: beyond it."""
    return jnp.minimum(angles - joint_range[..., 0], joint_range[..., 1] - angles)


def reach_for_bend(offset: Float[Array, "joint 3"], bend: Float[ArrayLike, ""]) -> Float[Array, ""]:
    """Distance thigh joint to foot [m] at a knee bend [rad], by the law of cosines."""
    thigh, shank = (sqrt_safe(offset[j, 0] ** 2 + offset[j, 2] ** 2) for j in (1, 2))
    return sqrt_safe(thigh**2 + shank**2 + 2.0 * thigh * shank * jnp.cos(bend))
