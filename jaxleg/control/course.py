"""Feedback on where the trunk is, so that slip does not add up over a long plan.

A joint reference alone lets every slip and sag move trunk and later footholds off the plan: over a hundred steps by
decimetres. Here the joint controllers get the plan's joint angles plus J^-1 d, d the change of a foot's place in B that takes

    a standing leg  from R*^T (p_foot* - p*) to R*^T (p_foot - p*):   the trunk to its plan, over the feet as they stand,
    a swinging leg  from R*^T (p_foot* - p*) to R^T (p_foot* - p):    the foot to its planned place in the world

(* planned, otherwise as simulated), blended by the planned load while it is transferred. A standing foot's place is the one
it took at touch-down, forgotten slowly: were it the present one, a foot that slips would be pushed on with the same force.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.contract import Controller, Reading, Tracking
from jaxleg.numerics import inverse3_safe, matvec
from jaxleg.pytree import pytree
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.walk.between import at_time
from jaxleg.walk.data import Reference

FORGET = 1.0  # time constant with which a standing foot's place follows its slip [s]


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


def command(low: Reference, high: Reference, time: Float[Array, ""], dt: Float[Array, ""], now: Posture) -> Tracking:
    """What the joint controllers get at a time [s] between two samples for the tick of dt [s] that begins."""
    row, later = at_time(low, high, time), at_time(low, high, time + dt)
    torque = 0.5 * (row.joint_torque + later.joint_torque)
    return Tracking(corrected(row, now), later.joint_vel, torque, dt)


class CourseMemory(NamedTuple):
    """How far a plan has been followed."""

    index: Int[Array, ""]  # sample of the reference that is past
    ticks: Int[Array, ""]  # on the reference: a clock that adds up seconds would lose some
    held: Float[Array, "leg 3"]


@pytree
class Course(Controller[CourseMemory, None]):
    """Follows a plan up to its sample `last` in ticks of `dt` [s]."""

    rows: Rows
    feet: Float[Array, "leg 3"]  # at the plan's start [m]
    last: Int[Array, ""]
    dt: Float[Array, ""]

    def start(self) -> CourseMemory:
        """At the plan's first sample."""
        zero = jnp.zeros((), jnp.int32)
        return CourseMemory(zero, zero, self.feet)

    def command(self, memory: CourseMemory, sensed: Reading, row: None) -> tuple[Tracking, CourseMemory]:
        """The plan's command, corrected; after its last sample that one's pose, standing."""
        state, under_way = sensed.state, memory.index < self.last
        low, high = samples_at(self.rows, memory.index)
        held = held_feet(memory.held, sensed.foot, low.contact, self.dt)
        posture = Posture(state.q[:3], state.q[3:7], held, sensed.foot_by_leg)
        now = command(low, high, self._clock(memory.ticks), self.dt, posture)
        now = now._replace(velocity=jnp.where(under_way, now.velocity, 0.0))
        ticks = memory.ticks + under_way.astype(jnp.int32)
        past = under_way & (self._clock(ticks) >= high.time)
        return now, CourseMemory(memory.index + past.astype(jnp.int32), ticks, held)

    def over(self, memory: CourseMemory) -> Bool[Array, ""]:
        """Whether the last sample is past."""
        return memory.index >= self.last

    def _clock(self, ticks):
        return ticks.astype(self.dt.dtype) * self.dt


def course(reference: Reference, last: Int[Array, ""], dt: Float[Array, ""]) -> Course:
    """The controller that follows a reference up to its sample `last` in ticks of dt [s]."""
    return Course(to_rows(reference), reference.foot_pos[0], last, dt)
