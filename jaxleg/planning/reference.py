"""From a walk to joint references: inverse kinematics with exact time derivatives and feed-forward torque by inverse dynamics."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.conventions import GRAVITY
from jaxleg.dynamics import Motion, centre_of_mass, torques_on_ground
from jaxleg.gait import PHASES
from jaxleg.kinematics import knee_bend
from jaxleg.numerics import matvec
from jaxleg.plan import Phases, Reference, Walk
from jaxleg.planning.crawl import CrawlSettings, phase_shares
from jaxleg.planning.posture import joint_angles, trunk_rotation
from jaxleg.planning.trajectory import foot_path, load_weight, trunk_path
from jaxleg.robot import Robot


class Instant(NamedTuple):
    """The reference at one instant; see `Reference` for frames and units."""

    angles: Float[Array, "leg joint"]
    velocity: Float[Array, "leg joint"]
    torque: Float[Array, "leg joint"]
    pose: Float[Array, "4"]  # trunk (x, y, z, pitch)
    pose_rate: Float[Array, "4"]
    feet: Float[Array, "leg 3"]  # in W
    weight: Float[Array, "leg"]
    com: Float[Array, "3"]  # in W
    bend: Float[Array, "leg"]  # knee bend [rad]
    reach: jax.Array  # `Reach` a leg


def instant(robot: Robot, walk: Walk, settings: CrawlSettings, phase: Phases, share: Float[ArrayLike, ""]) -> Instant:
    """The reference at a share of one phase: exact first and second time derivatives by forward differentiation."""
    lift, load = walk.params.lift_share, settings.load_share

    def configuration(time):
        at = share + time / phase.duration
        pose, feet = trunk_path(phase, at), foot_path(phase, at, lift, load)
        angles, reach = joint_angles(robot, pose, feet)
        return (angles, pose), (feet, reach)

    def rate(time):
        state, velocity, aux = jax.jvp(configuration, (time,), (jnp.ones_like(time),), has_aux=True)
        return (state, velocity), aux

    zero = jnp.zeros((), walk.footholds.dtype)
    (state, first), (_, second), (feet, reach) = jax.jvp(rate, (zero,), (jnp.ones_like(zero),), has_aux=True)
    (angles, pose), (velocity, pose_rate), (acceleration, pose_acceleration) = state, first, second
    motion = Motion(angles, velocity, acceleration, *_trunk_motion(pose, pose_rate, pose_acceleration))
    weight = load_weight(phase, share, load)
    torque, _, frames = torques_on_ground(robot, motion, weight)
    com = pose[:3] + matvec(trunk_rotation(pose[3]), centre_of_mass(robot, frames))
    bend = jax.vmap(knee_bend)(robot.link_offset, angles)
    return Instant(angles, velocity, torque, pose, pose_rate, feet, weight, com, bend, reach)


def _trunk_motion(pose, rate, acceleration):
    """Angular velocity and acceleration, and linear acceleration less gravity, in B: the trunk only pitches (about -y)."""
    zero = jnp.zeros_like(pose[3])
    spin = jnp.stack([zero, -rate[3], zero])
    spin_rate = jnp.stack([zero, -acceleration[3], zero])
    felt = acceleration[:3] + GRAVITY * jnp.array([0.0, 0.0, 1.0], pose.dtype)
    return spin, spin_rate, matvec(jnp.swapaxes(trunk_rotation(pose[3]), 0, 1), felt)


def reference(robot: Robot, walk: Walk, settings: CrawlSettings, samples_per_cycle: int) -> Reference:
    """Sample a walk uniformly, `samples_per_cycle` a cycle plus the end point."""
    cycles = walk.cycle_time.shape[0]
    local = jnp.arange(samples_per_cycle, dtype=walk.cycle_time.dtype) / samples_per_cycle
    bounds = jnp.cumsum(phase_shares(walk.params))
    phase = jnp.minimum(jnp.sum(local[:, None] >= bounds[None, :], axis=1), PHASES - 1)
    begin = jnp.concatenate([jnp.zeros(1, bounds.dtype), bounds])[phase]
    share = (local - begin) / phase_shares(walk.params)[phase]
    index = (jnp.arange(cycles)[:, None] * PHASES + phase[None, :]).reshape(-1)
    index = jnp.concatenate([index, index[-1:]])
    share = jnp.concatenate([jnp.tile(share, cycles), jnp.ones(1, share.dtype)])
    begin_cycle = jnp.cumsum(walk.cycle_time) - walk.cycle_time
    time = (begin_cycle[:, None] + local * walk.cycle_time[:, None]).reshape(-1)
    time = jnp.concatenate([time, jnp.sum(walk.cycle_time)[None]])
    phases = jax.tree.map(lambda x: x[index], walk.phases)
    at = jax.vmap(lambda p, s: instant(robot, walk, settings, p, s))(phases, share)
    return _to_reference(time, at)


def _to_reference(time, at: Instant) -> Reference:
    zero = jnp.zeros_like(at.pose[:, 3])
    half = 0.5 * at.pose[:, 3]
    quaternion = jnp.stack([jnp.cos(half), zero, -jnp.sin(half), zero], axis=-1)
    spin = jnp.stack([zero, -at.pose_rate[:, 3], zero], axis=-1)
    velocity = jnp.concatenate([at.pose_rate[:, :3], spin], axis=-1)
    return Reference(
        *(time, at.angles, at.velocity, at.torque, at.pose[:, :3], quaternion, velocity, at.feet, at.weight)
    )
