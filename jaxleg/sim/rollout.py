"""Batched rollout of a plan: steps along its reference, and the meters.

`simulate` and `record` are one lane; `vmap` them over plans and terrains. They are differentiable, forward and reverse,
through whole gait cycles.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxleg.energy import Power
from jaxleg.gait import stability_margin
from jaxleg.kinematics import rotation_from_quaternion
from jaxleg.numerics import matvec
from jaxleg.plan import Reference
from jaxleg.robot import Robot
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.step import Measured, State, initial_state, step
from jaxleg.sim.tracking import interpolate
from jaxleg.terrain.heightmap import HeightMap, nearest_height

LOADED = 1.0  # a foot counts as loaded above this normal force [N]
FALL_TILT = 0.7071  # cosine of 45 degrees


class Meters(NamedTuple):
    """What a rollout measured over its metered cycles. The one definition of energy, margin, slip and fall."""

    energy: Power  # by joint (leg, joint) [J]: torque the implicit step applied times mid-step speed
    distance: Float[Array, ""]  # forward way of the trunk [m]
    time: Float[Array, ""]  # [s]
    slip: Float[Array, "leg"]  # way of the loaded foot along the ground [m]
    penetration: Float[Array, ""]  # greatest [m]
    margin: Float[Array, ""]  # least stability margin: centre of mass in the hull of the loaded feet [m]
    tilt: Float[Array, ""]  # greatest angle of the trunk's z axis from the vertical [rad]
    fell: Bool[Array, ""]  # tilt > 45 deg, trunk below half its height, trunk contact, or not finite


class Record(NamedTuple):
    """A rollout step by step. A lane that fell goes on with figures of no meaning, marked by `alive`."""

    time: Float[Array, "t"]  # at the end of the step [s]
    torque: Float[Array, "t leg joint"]  # of the motors, as the implicit step applied it [N m]
    speed: Float[Array, "t leg joint"]  # of the joints in mid-step [rad/s]
    normal_force: Float[Array, "t leg"]  # [N]
    trunk_pos: Float[Array, "t 3"]  # B's origin in W [m]
    alive: Bool[Array, "t"]


def simulate(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    reference: Reference,
    steps: int,
    metered_from: int = 0,
) -> Meters:
    """Follow a reference with so many steps between samples; meter it from sample `metered_from` on.

    A fallen or non-finite lane is frozen and flagged. Reverse mode recomputes each step, so its memory is one state a step.
    """
    return _follow(engine, robot, ground, terrain, reference, steps, metered_from, keep=lambda *_: None)[0]


def record(
    engine: Engine, robot: Robot, ground: Ground, terrain: HeightMap, reference: Reference, steps: int
) -> tuple[Meters, Record]:
    """`simulate` from the first sample on, with every step's torques, speeds and forces."""

    def keep(seen: Measured, after: State, dt, ok):
        return Record(dt, seen.torque, seen.speed, seen.normal_force, after.q[:3], ok)

    meters, kept = _follow(engine, robot, ground, terrain, reference, steps, 0, keep)
    return meters, kept._replace(time=jnp.cumsum(kept.time))


def _follow(engine, robot, ground, terrain, reference, steps, metered_from, keep):
    """The meters of a rollout, and what `keep` (measured, state, dt, alive) takes from each step."""
    tracking = interpolate(reference, steps)
    start = initial_state(robot, ground, reference)
    count = tracking.dt.shape[0]
    metered = (jnp.arange(count) >= metered_from * steps).astype(start.q.dtype)
    stand = start.q[2] - jnp.mean(reference.foot_pos[0, :, 2])

    @jax.checkpoint
    def body(carry, inputs):
        state, meters, alive = carry
        now, weight = inputs
        safe = jax.tree.map(lambda a, b: jnp.where(alive, a, b), state, start)
        after, measured = step(engine, robot, ground, terrain, safe, now)
        ok = alive & _finite(after) & ~fallen(robot, terrain, after, measured.foot, stand)
        after = jax.tree.map(lambda a, b: jnp.where(ok, a, b), after, state)
        meters = _measure(meters, measured, after, state, weight * ok, now.dt)
        return (after, meters, ok), keep(measured, after, now.dt, ok)

    carry, kept = jax.lax.scan(body, (start, _no_meters(start.q.dtype), jnp.array(True)), (tracking, metered))
    return carry[1]._replace(fell=~carry[2]), kept


def fallen(
    robot: Robot, terrain: HeightMap, state: State, foot: Float[Array, "leg 3"], stand: Float[Array, ""]
) -> Bool[Array, ""]:
    """Fall: tilt > 45 deg, trunk below half its height over the feet, or a lower corner of the trunk on the ground."""
    rotation = rotation_from_quaternion(state.q[3:7])
    corner = jnp.array([[1, 1, -1], [1, -1, -1], [-1, 1, -1], [-1, -1, -1]], state.q.dtype) * 0.5 * robot.trunk_size
    corner = state.q[:3] + matvec(rotation, corner)
    ground = jax.vmap(nearest_height, in_axes=(None, 0))(terrain, corner[:, :2])
    low = state.q[2] - jnp.mean(foot[:, 2]) < 0.5 * stand
    return (rotation[2, 2] < FALL_TILT) | low | jnp.any(corner[:, 2] < ground)


def _finite(state: State) -> Bool[Array, ""]:
    return jnp.all(jnp.isfinite(state.q)) & jnp.all(jnp.isfinite(state.v))


def _no_meters(dtype) -> Meters:
    zero, joints = jnp.zeros((), dtype), jnp.zeros((4, 3), dtype)
    far = jnp.full((), jnp.inf, dtype)
    return Meters(Power(joints, joints, joints), zero, zero, joints[:, 0], zero, far, zero, jnp.array(False))


def _measure(meters: Meters, seen: Measured, after: State, before: State, weight, dt) -> Meters:
    """Add one step; the figures that nobody differentiates are cut out of the gradient."""
    held = jax.lax.stop_gradient(seen)
    loaded = held.normal_force > LOADED
    margin = stability_margin(held.com[:2], held.foot[:, :2], loaded)
    tilt = _tilt(jax.lax.stop_gradient(after.q[3:7]))
    return Meters(
        energy=jax.tree.map(lambda total, p: total + weight * dt * p, meters.energy, seen.power),
        distance=meters.distance + weight * (after.q[0] - before.q[0]),
        time=meters.time + weight * dt,
        slip=meters.slip + weight * dt * jnp.where(loaded, held.sliding, 0.0),
        penetration=jnp.maximum(meters.penetration, weight * jnp.max(held.penetration)),
        margin=jnp.where(weight > 0, jnp.minimum(meters.margin, margin), meters.margin),
        tilt=jnp.maximum(meters.tilt, weight * tilt),
        fell=meters.fell,
    )


def _tilt(quaternion):
    rotation = rotation_from_quaternion(quaternion)
    return jnp.arctan2(jnp.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])
