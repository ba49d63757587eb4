"""Kinematics of one leg: forward, exact inverse with both knee branches, Jacobian. Paper A, equation (2).

Positions are in a frame at the hip joint, parallel to B. The inverse assumes what A's legs share with most quadrupeds:
a roll joint followed by two parallel pitch joints; link offsets may have fore-aft and lateral parts. All functions are for
one leg; `vmap` them over the leading leg axis of `Robot`'s fields.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxleg.numerics import Code, cross, inverse3_safe, matmul, matvec, sqrt_safe
from jaxleg.rotations import rotation_about


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
    first, second, third = jax.vmap(rotation_about)(axis, angles)
    second = matmul(first, second)
    rotation = jnp.stack([first, second, matmul(second, third)])
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
    frames: LegFrames, velocity: Float[Array, "3"], acceleration: Float[Array, "3"]
) -> tuple[Float[Array, "joint"], Float[Array, "joint"]]:
    """Joint velocities and accelerations that move the foot so in the hip's frame [m/s, m/s^2]: J^-1 v, J^-1 (a - dJ/dt q').

    Large but finite at the stretched leg, where J is singular.
    """
    inverse, still = inverse3_safe(foot_jacobian(frames)), jnp.zeros_like(velocity)
    rates = matvec(inverse, velocity)
    bias = link_motion(frames, rates, still, still, still, still).end[2]
    return rates, matvec(inverse, acceleration - bias)


def accelerated(
    spin: Float[Array, "*n 3"], spin_rate: Float[Array, "*n 3"], acceleration: Float[Array, "*n 3"], arm: Float[Array, "*n 3"]
) -> Float[Array, "*n 3"]:
    """Acceleration [m/s^2] of a point at `arm` [m] from a point of the same rigid body that turns so [rad/s, rad/s^2]."""
    return acceleration + cross(spin_rate, arm) + cross(spin, cross(spin, arm))


class LinkMotion(NamedTuple):
    """Motion of the links of one leg, in the trunk's frame."""

    spin: Float[Array, "joint 3"]  # [rad/s]
    spin_rate: Float[Array, "joint 3"]  # [rad/s^2]
    origin: Float[Array, "joint 3"]  # acceleration of each joint [m/s^2]
    end: Float[Array, "joint 3"]  # and of each link's far end, the last one's is the foot


def link_motion(
    frames: LegFrames,
    velocity: Float[Array, "joint"],
    acceleration: Float[Array, "joint"],
    spin: Float[Array, "3"],
    spin_rate: Float[Array, "3"],
    linear: Float[Array, "3"],
) -> LinkMotion:
    """Motion of the links of a leg on a trunk that turns so [rad/s, rad/s^2], its hip joint accelerated by `linear` [m/s^2].

    All links at once, each the sum of what the joints before it add (Newton-Euler's way out along the leg).
    """
    turn = frames.axis * velocity[:, None]
    spin = spin[None] + running_sum(turn)
    spin_rate = spin_rate[None] + running_sum(frames.axis * acceleration[:, None] + cross(spin, turn))
    ends = jnp.concatenate([frames.origin[1:], frames.foot[None]])
    added = accelerated(spin, spin_rate, jnp.zeros_like(turn), ends - frames.origin)
    end = linear[None] + running_sum(added)
    return LinkMotion(spin, spin_rate, end - added, end)


def running_sum(x: Float[Array, "joint *n"]) -> Float[Array, "joint *n"]:
    """Sums over each joint and those before it."""
    second = x[0] + x[1]
    return jnp.stack([x[0], second, second + x[2]])


def carried_sum(x: Float[Array, "joint *n"]) -> Float[Array, "joint *n"]:
    """Sums over each joint and those after it: a joint carries its link and all beyond."""
    return running_sum(x[::-1])[::-1]


def leg_angles(
    axis: Float[Array, "joint 3"],
    offset: Float[Array, "joint 3"],
    knee_sign: Float[ArrayLike, ""],
    foot: Float[Array, "3"],
) -> tuple[Float[Array, "joint"], Int[Array, ""]]:
    """Closed-form inverse of `foot_position` with the foot below the hip, and a `Reach` status.

    `foot` [m] is relative to the hip joint; `knee_sign` +1 puts the knee backward (Pegasus), -1 forward. A target out of
    reach is clamped to the stretched (or fully folded) leg with zero gradient there, and says so in the status.
    """
    lateral = jnp.sum(offset[:, 1])
    depth_squared = foot[1] ** 2 + foot[2] ** 2 - lateral**2
    depth = jnp.sqrt(jnp.maximum(depth_squared, 1e-12))  # arctan2(0, 0) has no gradient
    roll = jnp.arctan2(foot[2], foot[1]) - jnp.arctan2(-depth, lateral)
    roll = jnp.arctan2(jnp.sin(roll), jnp.cos(roll))
    x, down = foot[0] - offset[0, 0], depth + offset[0, 2]
    thigh, shank = (sqrt_safe(offset[j, 0] ** 2 + offset[j, 2] ** 2) for j in (1, 2))
    cosine = (x * x + down * down - thigh**2 - shank**2) / (2.0 * thigh * shank)
    bend = knee_sign * _arccos_clamped(cosine)
    swing = jnp.arctan2(x, down) - jnp.arctan2(shank * jnp.sin(bend), thigh + shank * jnp.cos(bend))
    tilt_thigh, tilt_shank = (jnp.arctan2(offset[j, 0], -offset[j, 2]) for j in (1, 2))
    angles = jnp.stack([roll, swing - tilt_thigh, bend - tilt_shank + tilt_thigh])
    signs = jnp.stack([axis[0, 0], -axis[1, 1], -axis[2, 1]])
    too_near = (cosine < -1.0) | (depth_squared < 0.0)
    status = jnp.where(cosine > 1.0, Reach.TOO_FAR, jnp.where(too_near, Reach.TOO_NEAR, Reach.OK))
    known = jnp.isfinite(jnp.sum(foot)) & ~jnp.isnan(cosine)
    return angles * signs, jnp.where(known, status, Reach.NOT_FINITE).astype(jnp.int32)


def knee_bend(
    axis: Float[Array, "joint 3"], offset: Float[Array, "joint 3"], angles: Float[Array, "joint"]
) -> Float[Array, ""]:
    """Angle between thigh and shank in the leg's plane [rad], from 0 (stretched straight) to pi."""
    tilt_thigh, tilt_shank = (jnp.arctan2(offset[j, 0], -offset[j, 2]) for j in (1, 2))
    turned = tilt_shank - tilt_thigh - axis[2, 1] * angles[2]
    return jnp.abs(turned - 2.0 * jnp.pi * jnp.round(turned / (2.0 * jnp.pi)))


def range_slack(joint_range: Float[Array, "*n 2"], angles: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Distance of joint angles to the nearer end of their ranges [rad]; negative: beyond it."""
    return jnp.minimum(angles - joint_range[..., 0], joint_range[..., 1] - angles)


def reach_for_bend(offset: Float[Array, "joint 3"], bend: Float[ArrayLike, ""]) -> Float[Array, ""]:
    """Distance thigh joint to foot [m] at a knee bend [rad], by the law of cosines."""
    thigh, shank = (sqrt_safe(offset[j, 0] ** 2 + offset[j, 2] ** 2) for j in (1, 2))
    return sqrt_safe(thigh**2 + shank**2 + 2.0 * thigh * shank * jnp.cos(bend))


def _arccos_clamped(cosine: Float[Array, ""]) -> Float[Array, ""]:
    cosine = jnp.clip(cosine, -1.0, 1.0)
    return jnp.arctan2(sqrt_safe(1.0 - cosine**2), cosine)
