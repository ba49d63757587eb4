"""A walk whose swinging leg feels its way: phases by a clock that waits for the foot. One lane; `vmap` it.

The references of trunk and joints are made tick by tick, because a foot rests where it was felt, not where the map said.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.tracking import Tracking
from jaxleg.gait.order import SHIFT
from jaxleg.numerics import matvec, smoothstep
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.fall import fallen, watch_trunk
from jaxleg.sim.reflex import Feeling, Swinging, bounded, feel_on, foot_at, set_out
from jaxleg.sim.sensing import felt_forces
from jaxleg.sim.step import advance, initial_state
from jaxleg.swing.machine import Machine, Mode
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Walk
from jaxleg.walk.reference import instant_of, phase_instant, pose_at, to_reference
from jaxleg.walk.trajectory import load_weight, trunk_path


class Tick(NamedTuple):
    """What a reactive walk did, tick by tick."""

    phase: Int[Array, "t"]
    mode: Int[Array, "t"]  # of the swinging leg's machine; -1 in a shift and while load is transferred
    adjustments: Int[Array, "t"]
    contact: Bool[Array, "t"]  # felt by the swinging leg
    normal_force: Float[Array, "t leg"]  # true [N]
    felt: Float[Array, "t leg 3"]  # low-passed estimate in W [N]
    foot: Float[Array, "t leg 3"]  # centres in W [m]
    trunk: Float[Array, "t 3"]
    alive: Bool[Array, "t"]
    done: Bool[Array, "t"]  # the walk is over: it stands


class _Orders(NamedTuple):
    """What a walk follows."""

    robot: Robot
    walk: Walk
    machine: Machine
    feel: Feeling


class _Gait(NamedTuple):
    """Where the walk is."""

    phase: Int[Array, ""]
    clock: Float[Array, ""]  # in the phase, standing still while the foot is under way [s]
    held: Float[Array, "leg 3"]  # where the feet stand or last stood
    raised: Float[Array, "2"]  # trunk over its plan before and after the phase: the feet's own heights [m]
    swing: Swinging


def walk_reactively(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    walk: Walk,
    machine: Machine,
    feel: Feeling,
    dt: Float[Array, ""],
    ticks: int,
) -> Tick:
    """Walk a plan on a terrain that its map may have wrong, for so many ticks of dt [s]."""
    orders = _Orders(robot, walk, machine, feel)
    first = phase_instant(robot, jax.tree.map(lambda x: x[0], walk.phases), 0.0, walk.gait.lift_share, walk.load_share)
    start = initial_state(robot, ground, _one(first))
    trunk = watch_trunk(robot, terrain, start, first.feet)

    def body(carry, _):
        """One step of the engine, then of the feet's machines on the forces they feel."""
        state, gait, felt, alive = carry
        leg, moving, now = _command(orders, gait, dt)
        terms = engine(state.q, state.v)
        after, seen = advance(terms, robot, ground, terrain, state, now)
        force = felt_forces(terms, robot, seen.torque, state, after, dt, feel.inertia)
        felt = felt + (force - felt) * dt / (feel.delay + dt)
        ok = alive & ~fallen(trunk, after, seen.foot)
        state = jax.tree.map(lambda a, b: jnp.where(ok, a, b), after, state)
        hips = state.q[None, :3] + matvec(rotation_from_quaternion(state.q[3:7]), robot.hip_position)
        upcoming, contact = _proceed(orders, gait, leg, moving, hips, felt[leg], dt)
        mode = jnp.where(moving, gait.swing.state.mode, -1)
        tick = Tick(
            *(gait.phase, mode, gait.swing.state.adjustments, contact & moving),
            *(seen.normal_force, felt, seen.foot, state.q[:3], ok, upcoming.phase >= _count(walk)),
        )
        return (state, upcoming, felt, ok), tick

    felt = jnp.zeros((4, 3), start.q.dtype)
    return jax.lax.scan(body, (start, _at_first(orders, first), felt, jnp.array(True)), length=ticks)[1]


def _one(at):
    """A reference of one sample."""
    stacked = jax.tree.map(lambda x: x[None], at)
    return to_reference(jnp.zeros(1, at.angles.dtype), stacked)


def _at_first(orders: _Orders, first) -> _Gait:
    robot, walk, feel = orders.robot, orders.walk, orders.feel
    zero = jnp.zeros((), walk.footholds.dtype)
    swing = set_out(robot, feel, first.feet[0], walk.phases.feet_to[0, 0], first.pose[:3] + robot.hip_position[0], zero + 1.0)
    return _Gait(jnp.zeros((), jnp.int32), zero, first.feet, jnp.zeros(2, zero.dtype), swing)


def _now(walk: Walk, gait: _Gait):
    """The phase's plan, its leg, and whether it swings one; after the walk the last pose, standing."""
    count = _count(walk)
    index = jnp.minimum(gait.phase, count - 1)
    leg = jnp.array(walk.legs)[index]
    return jax.tree.map(lambda x: x[index], walk.phases), jnp.maximum(leg, 0), (leg != SHIFT) & (gait.phase < count)


def _count(walk: Walk):
    """Phases of a walk: those that are used come first."""
    return jnp.sum(walk.used, dtype=jnp.int32)


def _command(orders: _Orders, gait: _Gait, dt):
    """The leg under way, whether it moves, and what the joint controllers get."""
    walk, load_share = orders.walk, orders.walk.load_share
    phase, leg, swings = _now(walk, gait)
    moving = swings & (gait.clock >= load_share * phase.duration) & (gait.swing.state.mode < Mode.SUPPORTED)

    def at(later):
        """Trunk (6,) and feet (4, 3) that are wanted so much later [s]."""
        share = jnp.minimum((gait.clock + later) / phase.duration, 1.0)  # the trunk only moves in shifts
        rise = gait.raised[0] + (gait.raised[1] - gait.raised[0]) * smoothstep(share)
        rise = jnp.where(swings | (gait.phase >= _count(walk)), gait.raised[1], rise)
        trunk = trunk_path(phase, share) + jnp.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], rise.dtype) * rise
        foot = _foot(orders, gait, phase, leg, later)
        return trunk, jnp.where(moving, gait.held.at[leg].set(foot), gait.held)

    zero = jnp.zeros((), dt.dtype)
    share = jnp.where(moving, 0.5, gait.clock / phase.duration)
    weight = jnp.where(swings, load_weight(phase, share, load_share), jnp.ones_like(phase.swings))
    now = instant_of(orders.robot, pose_at(at, zero), weight)
    return leg, moving, Tracking(now.angles, now.velocity + dt * now.acceleration, now.torque, dt)


def _moved(orders: _Orders, phase):
    """Time in which the foot of a phase is planned to move [s]."""
    return phase.duration * (1.0 - 2.0 * orders.walk.load_share)


def _foot(orders: _Orders, gait: _Gait, phase, leg, later):
    """The moving foot a little later."""
    machine, lift_share = bounded(orders.machine, gait.swing), orders.walk.gait.lift_share
    return foot_at(machine, orders.feel, gait.swing, phase.apex[leg], lift_share, _moved(orders, phase), later)


def _proceed(orders: _Orders, gait: _Gait, leg, moving, hips, force, dt) -> tuple[_Gait, Array]:
    """The walk a tick later, and whether the leg felt a contact."""
    robot, walk, feel, share = orders.robot, orders.walk, orders.feel, orders.walk.load_share
    phase = _now(walk, gait)[0]
    foot = _foot(orders, gait, phase, leg, dt)
    felt, contact = feel_on(bounded(orders.machine, gait.swing), feel, gait.swing, foot, force, _moved(orders, phase), dt)
    swing = jax.tree.map(lambda a, b: jnp.where(moving, a, b), felt, gait.swing)
    lands = moving & (swing.state.mode >= Mode.SUPPORTED)
    clock = jnp.where(moving, jnp.where(lands, (1.0 - share) * phase.duration, gait.clock), gait.clock + dt)
    held = jnp.where(moving, gait.held.at[leg].set(foot), gait.held)
    over = clock >= phase.duration
    onward = (over & (gait.phase < _count(walk))).astype(jnp.int32)
    after = gait._replace(phase=gait.phase + onward, clock=jnp.where(over, 0.0, clock), held=held)
    upcoming, next_leg, next_swings = _now(walk, after)
    target, time = upcoming.feet_to[next_leg], _moved(orders, upcoming)
    setting = set_out(robot, feel, held[next_leg], target, hips[next_leg], time)
    swing = jax.tree.map(lambda a, b: jnp.where(over & next_swings, a, b), setting, swing)
    higher = jnp.where(feel.reacts, jnp.min(held[:, 2] - upcoming.feet_from[:, 2]), 0.0)  # no leg longer than planned
    shifts = over & ~next_swings
    raised = jnp.where(shifts, jnp.stack([gait.raised[1], higher]), gait.raised)
    return after._replace(swing=swing, raised=raised), contact
