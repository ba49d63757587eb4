"""Batched rollout of a plan: joint controllers, contact, one semi-implicit step, the meters.

    (M + dt D + dt J^T C J) (v+ - v)/dt = tau - bias + J^T (f - C J v),   v+ = v + dt dv/dt,   q+ = q (+) dt v+

D holds the joints' damping and the controllers' velocity gain, C and f are the feet's contact (`contact.py`). `simulate` is
one lane; `vmap` it over plans and terrains. It is differentiable, forward and reverse, through whole gait cycles.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxleg.energy import Power, motor_power
from jaxleg.gait import stability_margin
from jaxleg.kinematics import rotation_from_quaternion
from jaxleg.numerics import cross, dot, matmul, matvec, norm_safe, solve_block_arrow
from jaxleg.plan import Reference
from jaxleg.robot import Robot
from jaxleg.sim.contact import Ground, foot_contact
from jaxleg.sim.engine import Engine, Terms
from jaxleg.sim.tracking import Tracking, interpolate
from jaxleg.terrain.heightmap import HeightMap, nearest_height

LOADED = 1.0  # a foot counts as loaded above this normal force [N]
FALL_TILT = 0.7071  # cosine of 45 degrees


class State(NamedTuple):
    """Configuration and velocity in MuJoCo's order: position in W, quaternion, joints; linear in W, angular in B, joints."""

    q: Float[Array, "19"]
    v: Float[Array, "18"]


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


class _Step(NamedTuple):
    """Per-step quantities that the meters add up."""

    power: Power
    penetration: Float[Array, "leg"]
    normal_force: Float[Array, "leg"]
    sliding: Float[Array, "leg"]
    com: Float[Array, "3"]
    foot: Float[Array, "leg 3"]


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
        return (after, meters, ok), None

    carry, _ = jax.lax.scan(body, (start, _no_meters(start.q.dtype), jnp.array(True)), (tracking, metered))
    return carry[1]._replace(fell=~carry[2])


def initial_state(robot: Robot, ground: Ground, reference: Reference) -> State:
    """The reference's first pose at rest, lowered by the penetration at which four feet carry the weight."""
    load = robot.mass * 9.81 / 4.0
    depth = ground.softness * jnp.log(jnp.expm1(load / (ground.stiffness * ground.softness)))
    position = reference.trunk_pos[0] - depth * jnp.array([0.0, 0.0, 1.0], reference.time.dtype)
    q = jnp.concatenate([position, reference.trunk_quat[0], reference.joint_pos[0].reshape(-1)])
    return State(q, jnp.zeros(18, q.dtype))


def step(engine: Engine, robot: Robot, ground: Ground, terrain: HeightMap, state: State, now: Tracking) -> tuple[State, _Step]:
    """One semi-implicit step of dt towards the tracked joint reference."""
    dt, terms = now.dt, engine(state.q, state.v)
    angles, trunk_v, leg_v = state.q[7:].reshape(4, 3), state.v[:6], state.v[6:].reshape(4, 3)
    wanted = robot.stiffness * (now.position - angles) + robot.velocity_gain * (now.velocity - leg_v) + now.torque
    torque = jnp.clip(wanted, -robot.torque_limit, robot.torque_limit)
    gain = jnp.where(jnp.abs(wanted) < robot.torque_limit, robot.velocity_gain, 0.0)
    foot_v = matvec(terms.foot_by_trunk, trunk_v) + matvec(terms.foot_by_leg, leg_v)
    touch = jax.vmap(foot_contact, in_axes=(None, None, None, 0, 0, None))
    contact = touch(ground, terrain, robot.contact_radius, terms.foot, foot_v, dt)
    force = contact.force - matvec(contact.resistance, foot_v)
    load = torque - robot.joint_damping * leg_v
    trunk_dv, leg_dv = _solve(terms, contact.resistance, robot.joint_damping + gain, force, load, dt)
    torque = torque - gain * leg_dv
    new_trunk, new_leg = trunk_v + trunk_dv, leg_v + leg_dv
    after = State(_advance(state.q, new_trunk, new_leg, dt), jnp.concatenate([new_trunk, new_leg.reshape(-1)]))
    power = motor_power(robot, torque, 0.5 * (leg_v + new_leg))
    foot_v = foot_v + matvec(terms.foot_by_trunk, trunk_dv) + matvec(terms.foot_by_leg, leg_dv)
    normal_force = dot(contact.force - matvec(contact.resistance, foot_v), contact.normal)
    sliding = norm_safe(foot_v - contact.normal * dot(foot_v, contact.normal)[:, None])
    return after, _Step(power, contact.penetration, normal_force, sliding, terms.com, terms.foot)


def _solve(terms: Terms, resistance, joint_gain, force, load, dt):
    """Velocity change over the step: the equation of the module's docstring, solved block by block."""
    by_trunk, by_leg = terms.foot_by_trunk, terms.foot_by_leg
    from_trunk, from_leg = jnp.swapaxes(by_trunk, -1, -2), jnp.swapaxes(by_leg, -1, -2)
    through_leg = matmul(resistance, by_leg)
    trunk = terms.trunk + dt * jnp.sum(matmul(from_trunk, matmul(resistance, by_trunk)), axis=0)
    coupling = terms.coupling + dt * matmul(from_trunk, through_leg)
    diagonal = joint_gain[..., None] * jnp.eye(3, dtype=load.dtype)
    legs = terms.legs + dt * (diagonal + matmul(from_leg, through_leg))
    trunk_rhs = jnp.sum(matvec(from_trunk, force), axis=0) - terms.trunk_bias
    leg_rhs = load + matvec(from_leg, force) - terms.leg_bias
    return solve_block_arrow(trunk, coupling, legs, dt * trunk_rhs, dt * leg_rhs)


def _advance(q, trunk_v, leg_v, dt):
    """q (+) dt v: the trunk's orientation turns by its angular velocity in B."""
    w, axis, half = q[3], q[4:7], 0.5 * dt * trunk_v[3:]
    turned = jnp.concatenate([(w - dot(axis, half))[None], axis + w * half + cross(axis, half)])
    turned = turned * jax.lax.rsqrt(dot(turned, turned))
    return jnp.concatenate([q[:3] + dt * trunk_v[:3], turned, q[7:] + dt * leg_v.reshape(-1)])


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


def _measure(meters: Meters, seen: _Step, after: State, before: State, weight, dt) -> Meters:
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
