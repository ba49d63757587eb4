"""Follow a long plan with feedback on where the trunk is, so that slip does not add up. One lane; `vmap` it.

A joint reference alone lets every slip and sag move trunk and later footholds off the plan: over a hundred steps by
decimetres. Here the joint controllers get the plan's joint angles plus J^-1 d, d the change of a foot's place in B that takes

    a standing leg  from R*^T (p_foot* - p*) to R*^T (p_foot - p*):   the trunk to its plan, over the feet as they stand,
    a swinging leg  from R*^T (p_foot* - p*) to R^T (p_foot* - p):    the foot to its planned place in the world

(* planned, otherwise as simulated), blended by the planned load while it is transferred. A standing foot's place is the one
it took at touch-down, forgotten slowly: were it the present one, a foot that slips would be pushed on with the same force.
MJX and the referee use the same law.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.tracking import Tracking
from jaxleg.numerics import inverse3_safe, matvec
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.fall import fallen, watch_trunk
from jaxleg.sim.rollout import Meters, Tally, measure, no_tally, read
from jaxleg.sim.step import State, advance, initial_state
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference

FORGET = 1.0  # time constant with which a standing foot's place follows its slip [s]


class Followed(NamedTuple):
    """What following a plan measured."""

    meters: Meters
    feet: Float[Array, "step leg 3"]  # foot centres in W at the end of each step [m]
    trunk: Float[Array, "step 7"]  # position and quaternion there
    reached: Int[Array, ""]  # the plan's sample at which it ended or fell
    finished: Bool[Array, ""]  # whether that is its last one, and it stands


class Posture(NamedTuple):
    """Trunk and feet as they are."""

    trunk_pos: Float[Array, "3"]
    trunk_quat: Float[Array, "4"]
    feet: Float[Array, "leg 3"]  # where they stand, see `held_feet`
    jacobian: Float[Array, "leg 3 joint"]  # of each foot by its own joints, in W [m/rad]


class Rows(NamedTuple):
    """A reference as one matrix: a lane's look-up of two neighbouring samples is then a single gather."""

    values: Float[Array, "t column"]
    like: Reference  # one sample, for the columns' shapes


def to_rows(reference: Reference) -> Rows:
    """Pack a reference, sample by sample."""
    flat = [x.reshape(x.shape[0], -1) for x in reference]
    return Rows(jnp.concatenate(flat, axis=1), jax.tree.map(lambda x: x[0], reference))


def samples_at(rows: Rows, index: Int[Array, ""]) -> tuple[Reference, Reference]:
    """Sample `index` and the next one."""
    pair = jax.lax.dynamic_slice_in_dim(rows.values, index, 2)
    ends = np.cumsum([x.size for x in rows.like])[:-1]
    low, high = ([part.reshape(x.shape) for part, x in zip(jnp.split(row, ends), rows.like)] for row in pair)
    return Reference(*low), Reference(*high)


def between(low: Reference, high: Reference, time: Float[Array, ""]) -> Reference:
    """The reference at a time [s] between two samples: linear, joint angles by cubic Hermite; outside, the nearer one."""
    interval = jnp.maximum(high.time - low.time, 1e-6)
    s = jnp.clip((time - low.time) / interval, 0.0, 1.0)
    row = jax.tree.map(lambda a, b: a + s * (b - a), low, high)
    bow = s * (1.0 - s) * interval * ((1.0 - s) * low.joint_vel - s * high.joint_vel)
    blend = s * s * (3.0 - 2.0 * s)
    return row._replace(joint_pos=low.joint_pos + blend * (high.joint_pos - low.joint_pos) + bow)


def corrected(row: Reference, now: Posture) -> Float[Array, "leg joint"]:
    """Joint angles [rad] of the law above for the planned `row` and the posture as it is."""
    wanted, actual = rotation_from_quaternion(_unit(row.trunk_quat)), rotation_from_quaternion(now.trunk_quat)
    standing = matvec(wanted.T, now.feet - row.foot_pos)
    swinging = matvec(actual.T, row.foot_pos - now.trunk_pos[None]) - matvec(wanted.T, row.foot_pos - row.trunk_pos[None])
    load = row.contact[:, None]
    change = matvec(actual, load * standing + (1.0 - load) * swinging)
    return row.joint_pos + matvec(inverse3_safe(now.jacobian), change)


def held_feet(
    held: Float[Array, "leg 3"], feet: Float[Array, "leg 3"], load: Float[Array, "leg"], dt: Float[Array, ""]
) -> Float[Array, "leg 3"]:
    """Where the feet stand a tick later: a flying foot's place is its own, a standing one's follows it slowly."""
    rate = jnp.where(load < 0.5, 1.0, dt / FORGET)
    return held + rate[:, None] * (feet - held)


def _unit(quaternion):
    return quaternion * jax.lax.rsqrt(jnp.sum(quaternion**2))


class _Walk(NamedTuple):
    """A walk under way."""

    state: State
    tally: Tally
    alive: Bool[Array, ""]
    index: Int[Array, ""]  # sample of the reference that is past
    ticks: Int[Array, ""]  # on the reference: a clock that adds up seconds would lose some
    held: Float[Array, "leg 3"]
    feet: Float[Array, "step leg 3"]
    trunk: Float[Array, "step 7"]


def command(low: Reference, high: Reference, time: Float[Array, ""], dt: Float[Array, ""], now: Posture) -> Tracking:
    """What the joint controllers get at a time [s] between two samples for the tick of dt [s] that begins."""
    row, later = between(low, high, time), between(low, high, time + dt)
    torque = 0.5 * (row.joint_torque + later.joint_torque)
    return Tracking(corrected(row, now), later.joint_vel, torque, dt)


def _walker(engine: Engine, robot: Robot, ground: Ground, terrain: HeightMap, reference: Reference, last, per_step: int, dt):
    """A walk that has not begun, and the function that takes it on by a tick."""
    start, rows = initial_state(robot, ground, reference), to_rows(reference)
    trunk = watch_trunk(robot, terrain, start, reference.foot_pos[0])
    steps, dtype = -(-(reference.time.shape[0] - 1) // per_step), start.q.dtype
    zero = jnp.zeros((), jnp.int32)
    kept = jnp.zeros((steps, 4, 3), dtype), jnp.zeros((steps, 7), dtype)
    first = _Walk(start, no_tally(dtype), jnp.array(True), zero, zero, reference.foot_pos[0], *kept)

    def tick(walk: _Walk) -> _Walk:
        """One step of the engine, the trunk's place fed back; a walk that has ended stays as it is."""
        state, going = walk.state, walk.alive & (walk.index < last)
        terms = engine(state.q, state.v)
        low, high = samples_at(rows, walk.index)
        time = walk.ticks.astype(dtype) * dt
        held = held_feet(walk.held, terms.foot, low.contact, dt)
        now = command(low, high, time, dt, Posture(state.q[:3], state.q[3:7], held, terms.foot_by_leg))
        now = now._replace(velocity=jnp.where(walk.index < last, now.velocity, 0.0))
        after, seen = advance(terms, robot, ground, terrain, state, now)
        alive = walk.alive & ~fallen(trunk, after, seen.foot)
        after = jax.tree.map(lambda a, b: jnp.where(alive, a, b), after, state)
        going = going & alive
        place = jnp.where(going, walk.index // per_step, steps)
        ticks = walk.ticks + going.astype(jnp.int32)
        return _Walk(
            state=after,
            tally=measure(walk.tally, seen, after, state, going, dt),
            alive=alive,
            index=walk.index + (going & (ticks.astype(dtype) * dt >= high.time)).astype(jnp.int32),
            ticks=ticks,
            held=held,
            feet=walk.feet.at[place].set(terms.foot, mode="drop"),
            trunk=walk.trunk.at[place].set(after.q[:7], mode="drop"),
        )

    return first, tick


def follow(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    reference: Reference,
    last: Int[Array, ""],
    per_step: int,
    dt: Float[Array, ""],
    ticks: Int[Array, ""],
) -> Followed:
    """Follow a reference up to its sample `last`, `per_step` samples a step of the plan, in ticks of dt [s].

    `ticks` must cover the longest lane (not batched: it bounds the loop); a lane that has ended stands. A fallen lane is
    frozen. Forward only: the loop's length is not known before.
    """
    first, tick = _walker(engine, robot, ground, terrain, reference, last, per_step, dt)
    end = jax.lax.fori_loop(0, ticks, lambda _, walk: tick(walk), first)
    return _followed(end, last)


def film(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    reference: Reference,
    last: Int[Array, ""],
    per_step: int,
    dt: Float[Array, ""],
    frames: tuple[int, int],
) -> tuple[Followed, Float[Array, "frame 19"]]:
    """`follow` for so many (frames, ticks each), static; also the configuration q at the start of every frame."""
    first, tick = _walker(engine, robot, ground, terrain, reference, last, per_step, dt)

    def frame(walk: _Walk, _):
        return jax.lax.fori_loop(0, frames[1], lambda _, walk: tick(walk), walk), walk.state.q

    end, shots = jax.lax.scan(frame, first, length=frames[0])
    return _followed(end, last), shots


def _followed(end: _Walk, last: Int[Array, ""]) -> Followed:
    finished = end.alive & (end.index >= last)
    return Followed(read(end.tally, end.alive), end.feet, end.trunk, end.index, finished)


def landing_errors(reference: Reference, followed: Followed, per_step: int, legs: tuple[int, ...]) -> Float[Array, "step"]:
    """Horizontal distance [m] of the foot that has swung from its planned place, at the end of each step."""
    steps = followed.feet.shape[0]
    end = jnp.minimum((jnp.arange(steps) + 1) * per_step, reference.time.shape[0] - 1)
    leg = jnp.array(legs)[jnp.arange(steps) % len(legs)]
    apart = followed.feet[jnp.arange(steps), leg] - reference.foot_pos[end, leg]
    return jnp.linalg.norm(apart[:, :2], axis=-1)
