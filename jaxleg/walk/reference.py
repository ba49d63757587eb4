"""From a walk to joint references: inverse kinematics with exact rates, feed-forward torque by inverse dynamics."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxleg.conventions import GRAVITY
from jaxleg.gait.order import SHIFT
from jaxleg.gait.phases import Phases
from jaxleg.leg.dynamics import Motion, all_leg_frames, centre_of_mass, torques_on_ground
from jaxleg.leg.kinematics import accelerated, joint_rates, knee_bend, range_slack
from jaxleg.numerics import cross, dot, matvec
from jaxleg.posture.body import joint_angles
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_quaternion, trunk_rotation, trunk_spin
from jaxleg.walk.data import Reference, Walk
from jaxleg.walk.trajectory import foot_path, load_weight, trunk_path


class Pose(NamedTuple):
    """Trunk (x, y, z, pitch, roll, yaw) and feet in W, with their first and second time derivatives."""

    trunk: Float[Array, "6"]
    feet: Float[Array, "leg 3"]
    trunk_rate: Float[Array, "6"]
    feet_rate: Float[Array, "leg 3"]
    trunk_acceleration: Float[Array, "6"]
    feet_acceleration: Float[Array, "leg 3"]


class Instant(NamedTuple):
    """The reference at one instant; see `Reference` for frames and units."""

    angles: Float[Array, "leg joint"]
    velocity: Float[Array, "leg joint"]
    acceleration: Float[Array, "leg joint"]
    torque: Float[Array, "leg joint"]
    pose: Float[Array, "6"]  # trunk (x, y, z, pitch, roll, yaw)
    pose_rate: Float[Array, "6"]
    feet: Float[Array, "leg 3"]  # in W
    weight: Float[Array, "leg"]
    load: Float[Array, "leg"]  # vertical contact force over its weight's share of the load [N]; negative would pull
    com: Float[Array, "3"]  # in W
    bend: Float[Array, "leg"]  # knee bend [rad]
    room: Float[Array, "leg"]  # least distance of a joint to the end of its range [rad]; negative: beyond it
    reach: jax.Array  # `Reach` a leg


def phase_instant(robot: Robot, phase: Phases, share: Float[ArrayLike, ""], load_share: Float[ArrayLike, ""]) -> Instant:
    """The reference at a share of one phase, with exact time derivatives: of trunk and feet by forward differentiation,
    of the joints through the legs' Jacobians. Shares as in `trajectory.foot_path`."""

    def at(time):
        now = share + time / phase.duration
        return trunk_path(phase, now), foot_path(phase, now, load_share)

    return instant_of(robot, pose_at(at, jnp.zeros((), phase.duration.dtype)), load_weight(phase, share, load_share))


def pose_at(path: Callable[[Array], tuple[Array, Array]], time: Float[Array, ""]) -> Pose:
    """Trunk and feet along a path of time [s], with exact time derivatives by forward differentiation."""

    def with_rate(time):
        return jax.jvp(path, (time,), (jnp.ones_like(time),))

    ((trunk, feet), rate), (_, acceleration) = jax.jvp(with_rate, (time,), (jnp.ones_like(time),))
    return Pose(trunk, feet, *rate, *acceleration)


def instant_of(robot: Robot, at: Pose, weight: Float[Array, "leg"]) -> Instant:
    """The reference of a pose, its feet loaded by `weight` (1 standing, 0 in the air)."""
    to_trunk = jnp.swapaxes(trunk_rotation(at.trunk[3:]), 0, 1)
    spin, spin_rate = jax.jvp(trunk_spin, (at.trunk[3:], at.trunk_rate[3:]), (at.trunk_rate[3:], at.trunk_acceleration[3:]))
    felt = matvec(to_trunk, at.trunk_acceleration[:3] + GRAVITY * jnp.array([0.0, 0.0, 1.0], at.trunk.dtype))
    angles, reach = joint_angles(robot, at.trunk, at.feet)
    frames = all_leg_frames(robot, angles)
    arm = robot.hip_position + frames.foot
    foot_v = matvec(to_trunk, at.feet_rate - at.trunk_rate[None, :3]) - cross(jnp.broadcast_to(spin, arm.shape), arm)
    foot_a = matvec(to_trunk, at.feet_acceleration - at.trunk_acceleration[None, :3])
    coriolis = 2.0 * cross(jnp.broadcast_to(spin, arm.shape), foot_v)
    foot_a = foot_a - jax.vmap(accelerated, in_axes=(None, None, 0, 0))(spin, spin_rate, coriolis, arm)
    velocity, acceleration = jax.vmap(joint_rates)(frames, foot_v, foot_a)
    torque, force = torques_on_ground(
        robot, frames, Motion(velocity, acceleration, spin, spin_rate, felt), weight, to_trunk[:, 2]
    )
    load = dot(force, to_trunk[:, 2]) / jnp.maximum(weight, 1e-3)
    com = at.trunk[:3] + matvec(to_trunk.T, centre_of_mass(robot, frames))
    bend = jax.vmap(knee_bend)(robot.joint_axis, robot.link_offset, angles)
    return Instant(
        *(angles, velocity, acceleration, torque, at.trunk, at.trunk_rate, at.feet),
        *(weight, load, com, bend, jnp.min(range_slack(robot.joint_range, angles), axis=-1), reach),
    )


def reference(robot: Robot, walk: Walk, samples: tuple[int, int]) -> Reference:
    """Sample a walk: so many samples a body shift and a swing (the same in every one), plus the end point.

    The samples keep their place in the phase whatever its duration, so none crosses a phase's border when parameters
    change: everything that follows the reference stays differentiable in the phases' durations.
    """
    return to_reference(*instants(robot, walk, samples))


def instants(robot: Robot, walk: Walk, samples: tuple[int, int]) -> tuple[Float[Array, "t"], Instant]:
    """Times [s] of the samples of `reference`, and everything about the plan at them."""
    return phase_instants(robot, walk.phases, walk.legs, walk.load_share, samples)


def phase_instants(
    robot: Robot,
    phases: Phases,
    legs: tuple[int, ...],
    load_share: Float[ArrayLike, ""],
    samples: tuple[int, int],
) -> tuple[Float[Array, "t"], Instant]:
    """Times [s] and instants of any phases, `legs` their swinging leg or `SHIFT`; so many samples a shift and a swing."""
    phase, share = phase_samples(samples, legs)
    phases, share = jax.tree.map(lambda x: x[phase], phases), jnp.asarray(share, phases.start.dtype)
    at = jax.vmap(lambda p, s: phase_instant(robot, p, s, load_share))(phases, share)
    return phases.start + share * phases.duration, at


def phase_samples(samples: tuple[int, int], legs: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Phase index and share of every sample of `instants`."""
    counts = [samples[0] if leg == SHIFT else samples[1] for leg in legs]
    phase = np.repeat(np.arange(len(legs)), counts)
    share = np.concatenate([np.arange(count) / count for count in counts])
    return np.append(phase, phase[-1]), np.append(share, 1.0)


def last_sample(walk: Walk, samples: tuple[int, int]) -> Int[Array, ""]:
    """The last sample of `instants` that takes part: the end of the last phase that is used."""
    ends = np.cumsum([samples[0] if leg == SHIFT else samples[1] for leg in walk.legs])
    return jnp.max(jnp.where(walk.used, jnp.asarray(ends, jnp.int32), 0))


def to_reference(time: Float[Array, "t"], at: Instant) -> Reference:
    """The part of the instants that controllers and simulators follow."""
    turn, rate = at.pose[:, 3:], at.pose_rate[:, 3:]
    quaternion, spin = jax.vmap(trunk_quaternion)(turn), jax.vmap(trunk_spin)(turn, rate)
    velocity = jnp.concatenate([at.pose_rate[:, :3], spin], axis=-1)
    return Reference(*(time, at.angles, at.velocity, at.torque, at.pose[:, :3], quaternion, velocity, at.feet, at.weight))
