"""One semi-implicit step of the robot on its feet, with joint controllers and contact.

    (M + dt D + dt J^T C J) (v+ - v)/dt = tau - bias + J^T (f - C J v),   v+ = v + dt dv/dt,   q+ = q (+) dt v+

D holds the joints' damping and the controllers' velocity gain, C and f are the feet's contact (`contact.py`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.control.contract import State, Tracking
from jaxleg.conventions import GRAVITY
from jaxleg.leg.energy import Power, motor_power
from jaxleg.numerics import cross, dot, matmul, matvec, norm_safe, solve_block_arrow
from jaxleg.robot import Robot
from jaxleg.sim.contact import Ground, foot_contact
from jaxleg.sim.engine import Engine, Terms
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference


class Measured(NamedTuple):
    """What one step measured."""

    power: Power
    torque: Float[Array, "leg joint"]  # as the implicit step applied it [N m]
    speed: Float[Array, "leg joint"]  # of the joints in mid-step [rad/s]
    penetration: Float[Array, "leg"]
    normal_force: Float[Array, "leg"]
    sliding: Float[Array, "leg"]
    com: Float[Array, "3"]
    foot: Float[Array, "leg 3"]


def initial_state(robot: Robot, ground: Ground, reference: Reference) -> State:
    """The reference's first pose at rest, lowered by the penetration at which four feet carry the weight."""
    load = robot.mass * GRAVITY / 4.0 / (ground.stiffness * ground.softness)
    depth = ground.softness * (load + jnp.log(-jnp.expm1(-load)))  # softplus^-1, which a heavy robot does not overflow
    position = reference.trunk_pos[0] - depth * jnp.array([0.0, 0.0, 1.0], reference.time.dtype)
    q = jnp.concatenate([position, reference.trunk_quat[0], reference.joint_pos[0].reshape(-1)])
    return State(q, jnp.zeros(18, q.dtype))


def step(
    engine: Engine, robot: Robot, ground: Ground, terrain: HeightMap, state: State, now: Tracking
) -> tuple[State, Measured]:
    """One semi-implicit step of dt towards the tracked joint reference."""
    return advance(engine(state.q, state.v), robot, ground, terrain, state, now)


def advance(
    terms: Terms, robot: Robot, ground: Ground, terrain: HeightMap, state: State, now: Tracking
) -> tuple[State, Measured]:
    """`step` with the engine's terms of the state at hand."""
    dt = now.dt
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
    speed = 0.5 * (leg_v + new_leg)
    power = motor_power(robot, torque, speed)
    foot_v = foot_v + matvec(terms.foot_by_trunk, trunk_dv) + matvec(terms.foot_by_leg, leg_dv)
    normal_force = dot(contact.force - matvec(contact.resistance, foot_v), contact.normal)
    sliding = norm_safe(foot_v - contact.normal * dot(foot_v, contact.normal)[:, None])
    return after, Measured(power, torque, speed, contact.penetration, normal_force, sliding, terms.com, terms.foot)


def _solve(terms: Terms, resistance, joint_gain, force, load, dt):
    """Velocity change over the step: the equation of the module's docstring, solved block by block."""
    by_trunk, by_leg = terms.foot_by_trunk, terms.foot_by_leg
    from_trunk, from_leg = jnp.swapaxes(by_trunk, -1, -2), jnp.swapaxes(by_leg, -1, -2)
    through_leg = matmul(resistance, by_leg)
    trunk = terms.trunk + dt * jnp.sum(matmul(from_trunk, matmul(resistance, by_trunk)), axis=0)
    coupling = terms.coupling + dt * matmul(from_trunk, through_leg)
    diagonal = joint_gain[..., None] * jnp.eye(3, dtype=load.dtype)[None]
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
