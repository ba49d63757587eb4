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
from jaxleg.leg.dynamics import Motion, centre_of_mass, torques_on_ground
from jaxleg.leg.kinematics import joint_rates, knee_bend, leg_inverse, range_slack
from jaxleg.leg.moving import Moving
from jaxleg.leg.plane import chain_of, out_of_plane
from jaxleg.numerics import apart
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_quaternion, trunk_rows, trunk_spin
from jaxleg.vectors import Rows, Vector, parts, vector
from jaxleg.walk.data import Reference, Walk
from jaxleg.walk.trajectory import foot_path, load_weight, trunk_path


class Pose(NamedTuple):
    """Trunk (x, y, z, pitch, roll, yaw) and feet in W, with their first and second time derivatives."""

    trunk: Float[Array, "6 *n"]
    feet: Float[Array, "leg 3 *n"]
    trunk_rate: Float[Array, "6 *n"]
    feet_rate: Float[Array, "leg 3 *n"]
    trunk_acceleration: Float[Array, "6 *n"]
    feet_acceleration: Float[Array, "leg 3 *n"]


class Instant(NamedTuple):
    """The reference at one instant, or at many in an axis behind all others; see `Reference` for frames and units."""

    angles: Float[Array, "leg joint *n"]
    velocity: Float[Array, "leg joint *n"]
    acceleration: Float[Array, "leg joint *n"]
    torque: Float[Array, "leg joint *n"]
    pose: Float[Array, "6 *n"]  # trunk (x, y, z, pitch, roll, yaw)
    pose_rate: Float[Array, "6 *n"]
    feet: Float[Array, "leg 3 *n"]  # in W
    weight: Float[Array, "leg *n"]
    load: Float[Array, "leg *n"]  # vertical contact force over its weight's share of the load [N]; negative would pull
    com: Float[Array, "3 *n"]  # in W
    bend: Float[Array, "leg *n"]  # knee bend [rad]
    room: Float[Array, "leg *n"]  # least distance of a joint to the end of its range [rad]; negative: beyond it
    reach: jax.Array  # `Reach` a leg


def phase_instant(robot: Robot, phase: Phases, share: Float[ArrayLike, "*n"], load_share: Float[ArrayLike, ""]) -> Instant:
    """The reference at a share of one phase, with exact time derivatives: of trunk and feet by forward differentiation,
    of the joints through the legs' Jacobians. Shares as in `trajectory.foot_path`; for many instants at once `phase` has
    each one's numbers in a last axis."""

    def at(time):
        now = share + time / phase.duration
        return trunk_path(phase, now), foot_path(phase, now, load_share)

    pose = apart(lambda time: pose_at(at, time))(jnp.zeros_like(phase.duration))
    return instant_of(robot, pose, load_weight(phase, share, load_share))


def pose_at(path: Callable[[Array], tuple[Array, Array]], time: Float[Array, "*n"]) -> Pose:
    """Trunk and feet along a path of time [s], with exact time derivatives by forward differentiation."""

    def with_rate(time):
        return jax.jvp(path, (time,), (jnp.ones_like(time),))

    ((trunk, feet), rate), (_, acceleration) = jax.jvp(with_rate, (time,), (jnp.ones_like(time),))
    return Pose(trunk, feet, *rate, *acceleration)


def instant_of(robot: Robot, at: Pose, weight: Float[Array, "leg *n"]) -> Instant:
    """The reference of a pose, its feet loaded by `weight` (1 standing, 0 in the air)."""
    to_world, trunk = _trunk_moving(at)
    place, rate, rate_on = (vector(x[:3]) for x in (at.trunk, at.trunk_rate, at.trunk_acceleration))

    def leg(axis, offset, hip, joint_range, foot, foot_rate, foot_rate_on):
        """One leg: its posture, and the rates at which its joints keep the foot on its path."""
        relative, v, a = (
            to_world.turned_round_times(vector(x) - of_trunk)
            for x, of_trunk in ((foot, place), (foot_rate, rate), (foot_rate_on, rate_on))
        )
        found = apart(leg_inverse)(axis, offset, robot.knee_sign, relative - vector(hip))
        arm = vector(hip) + out_of_plane(found.fold.roll, chain_of(offset, found.fold).foot)
        v = v - trunk.spin.cross(arm)
        a = a - Moving(trunk.spin, trunk.spin_rate, trunk.spin.cross(v + v)).at(arm)
        rates = apart(joint_rates)(axis, offset, found.fold, v, a)
        slack = jax.vmap(range_slack)(joint_range, found.angles)
        return found, rates, knee_bend(axis, offset, found.angles), jnp.min(slack, axis=0)

    fixed = robot.joint_axis, robot.link_offset, robot.hip_position, robot.joint_range
    found, rates, bend, room = jax.vmap(leg)(*fixed, at.feet, at.feet_rate, at.feet_acceleration)
    torque, force = torques_on_ground(robot, found.fold, Motion(*rates, trunk), weight, to_world)
    com = place + to_world.times(centre_of_mass(robot, found.fold))
    load = force.z / jnp.maximum(weight, 1e-3)
    return Instant(
        *(found.angles, *rates, torque, at.trunk, at.trunk_rate, at.feet),
        *(weight, load, com.array(), bend, room, found.reach),
    )


@apart
def _trunk_moving(at: Pose) -> tuple[Rows, Moving]:
    """The trunk's rotation, and its motion in B, the acceleration less that of gravity."""
    to_world = trunk_rows(at.trunk[3:])
    spin, spin_rate = jax.jvp(trunk_spin, (at.trunk[3:], at.trunk_rate[3:]), (at.trunk_rate[3:], at.trunk_acceleration[3:]))
    x, y, z = parts(at.trunk_acceleration[:3])
    felt = to_world.turned_round_times(Vector(x, y, z + GRAVITY))
    return to_world, Moving(vector(spin), vector(spin_rate), felt)


def reference(robot: Robot, walk: Walk, samples: tuple[int, int]) -> Reference:
    """Sample a walk: so many samples a body shift and a swing (the same in every one), plus the end point.

    The samples keep their place in the phase whatever its duration, so none crosses a phase's border when parameters
    change: everything that follows the reference stays differentiable in the phases' durations.
    """
    return to_reference(*instants(robot, walk, samples))


def instants(robot: Robot, walk: Walk, samples: tuple[int, int]) -> tuple[Float[Array, "t"], Instant]:
    """Times [s] of the samples of `reference`, and everything about the plan at them, time in the last axis."""
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
    places, share = at_places(phases, phase, jnp.asarray(share, phases.start.dtype))
    return places.start + share * places.duration, phase_instant(robot, places, share, load_share)


def at_places(
    phases: Phases, phase: np.ndarray | Int[Array, "t"], share: Float[Array, "t"]
) -> tuple[Phases, Float[Array, "t"]]:
    """What `phase_instant` takes for many places (index of the phase, share), which lie in the last axis."""
    return jax.tree.map(lambda x: jnp.moveaxis(x[phase], 0, -1), phases), share


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
    at = jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), at)
    turn, rate = at.pose[:, 3:], at.pose_rate[:, 3:]
    quaternion, spin = jax.vmap(trunk_quaternion)(turn), jax.vmap(trunk_spin)(turn, rate)
    velocity = jnp.concatenate([at.pose_rate[:, :3], spin], axis=-1)
    return Reference(*(time, at.angles, at.velocity, at.torque, at.pose[:, :3], quaternion, velocity, at.feet, at.weight))
