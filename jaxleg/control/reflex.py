"""A walk whose swinging leg feels its way: phases by a clock that waits for the foot. Paper B.

Trunk and joints are commanded tick by tick, because a foot rests where it was felt, not where the map said. As in `course` the
trunk's place and turn are known, so that its plan is followed over the feet as they stand.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.contract import Controller, Reading, State, Tracking
from jaxleg.control.course import held_feet
from jaxleg.control.sensing import Joints, at_rest, felt_forces, measured
from jaxleg.control.swing_leg import Feeling, Swinging, bounded, feel_on, foot_at, set_out, tries_again
from jaxleg.gait.order import SHIFT
from jaxleg.numerics import matvec, select, smoothstep
from jaxleg.pytree import pytree
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.swing.machine import Machine, Mode
from jaxleg.walk.data import Walk
from jaxleg.walk.reference import Instant, instant_of, phase_instant, pose_at
from jaxleg.walk.trajectory import load_weight, trunk_path


class ReflexMemory(NamedTuple):
    """Where the walk is."""

    phase: Int[Array, ""]
    clock: Float[Array, ""]  # in the phase, standing still while the foot is under way [s]
    held: Float[Array, "leg 3"]  # where the feet stand or last stood
    landed: Bool[Array, "leg"]  # in the last tick
    raised: Float[Array, "2"]  # trunk over its plan before and after the phase: the feet's own heights [m]
    swing: Swinging
    joints: Joints  # what has been measured of them
    force: Float[Array, "leg 3"]  # low-passed estimate of the feet's forces in W [N]
    contact: Bool[Array, ""]  # felt by the swinging leg in the last tick


@pytree
class Reflex(Controller[ReflexMemory, None]):
    """Walks a plan in ticks of `dt` [s], its swinging leg by the machine's reflexes."""

    robot: Robot
    walk: Walk
    machine: Machine
    feel: Feeling
    first: Instant  # of the walk
    dt: Float[Array, ""]

    def start(self) -> ReflexMemory:
        """Before the first phase."""
        first, robot, walk = self.first, self.robot, self.walk
        zero = jnp.zeros((), walk.footholds.dtype)
        hip = first.pose[:3] + robot.hip_position[0]
        swing = set_out(robot, self.feel, first.feet[0], walk.phases.feet_to[0, 0], hip, zero + 1.0, jnp.zeros((), jnp.int32))
        raised, force = jnp.zeros(2, zero.dtype), jnp.zeros((4, 3), zero.dtype)
        joints = at_rest(first.angles, first.torque)
        phase, landed = jnp.zeros((), jnp.int32), jnp.zeros(4, bool)
        return ReflexMemory(phase, zero, first.feet, landed, raised, swing, joints, force, jnp.array(False))

    def command(self, memory: ReflexMemory, sensed: Reading, row: None) -> tuple[Tracking, ReflexMemory]:
        """The plan's instant, with the feet where they stand and the foot under way where its machine has it.

        A foot stands where it is when it has landed, not where it was sent: or each landing would leave the legs working
        against each other, and trunk and feet drift apart from step to step.
        """
        load_share = self.walk.load_share
        phase, _, swings = _now(self.walk, memory)
        leg, moving = under_way(self, memory)
        stand = held_feet(memory.held, sensed.foot, 1.0 - memory.landed.astype(self.dt.dtype), self.dt)
        memory = memory._replace(held=jnp.where((moving & (jnp.arange(4) == leg))[:, None], memory.held, stand))
        share = jnp.where(moving, 0.5, memory.clock / phase.duration)
        weight = jnp.where(swings, load_weight(phase, share, load_share), jnp.ones_like(phase.swings))
        now = instant_of(self.robot, pose_at(_wanted(self, memory), jnp.zeros((), self.dt.dtype)), weight)
        return Tracking(now.angles, now.velocity + self.dt * now.acceleration, now.torque, self.dt), memory

    def felt(self, memory: ReflexMemory, torque: Float[Array, "leg joint"], after: State) -> ReflexMemory:
        """The walk a tick later, by the forces that the feet feel."""
        joints, senses = measured(self.feel.senses, memory.joints, torque, after, self.dt), self.feel.senses
        trunk = _trunk(self, memory, self.dt)
        force = felt_forces(self.robot, senses, joints, trunk[3:])
        return _proceed(self, memory._replace(joints=joints, force=force), after)

    def over(self, memory: ReflexMemory) -> Bool[Array, ""]:
        """Whether every phase is past."""
        return memory.phase >= _count(self.walk)


def reflex(robot: Robot, walk: Walk, machine: Machine, feel: Feeling, dt: Float[Array, ""]) -> Reflex:
    """The controller that walks a plan with a feeling leg in ticks of dt [s]."""
    phase = jax.tree.map(lambda x: x[0], walk.phases)
    return Reflex(robot, walk, machine, feel, phase_instant(robot, phase, 0.0, walk.load_share), dt)


def under_way(reflex: Reflex, at: ReflexMemory) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """The leg of the phase, and whether its foot is on its way."""
    phase, leg, swings = _now(reflex.walk, at)
    unloaded = at.clock >= reflex.walk.load_share * phase.duration
    return leg, swings & unloaded & (at.swing.state.mode < Mode.SUPPORTED)


def _wanted(reflex: Reflex, now: ReflexMemory):
    """The function of how much later [s] that gives the trunk (6,) and the feet (4, 3) that are wanted then."""
    phase, leg, _ = _now(reflex.walk, now)
    moving = under_way(reflex, now)[1]

    def at(later):
        foot = _foot(reflex, now, phase, leg, later)
        return _trunk(reflex, now, later), jnp.where(moving, now.held.at[leg].set(foot), now.held)

    return at


def _trunk(reflex: Reflex, now: ReflexMemory, later):
    """The trunk's pose that is wanted a little later: it only moves in shifts, and not after the walk."""
    phase, _, swings = _now(reflex.walk, now)
    share = jnp.where(reflex.over(now), 1.0, jnp.minimum((now.clock + later) / phase.duration, 1.0))
    rise = now.raised[0] + (now.raised[1] - now.raised[0]) * smoothstep(share)
    rise = jnp.where(swings | reflex.over(now), now.raised[1], rise)
    return trunk_path(phase, share) + jnp.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], rise.dtype) * rise


def _now(walk: Walk, at: ReflexMemory):
    """The phase's plan, its leg, and whether it swings one; after the walk the last pose, standing."""
    count = _count(walk)
    index = jnp.minimum(at.phase, count - 1)
    leg = jnp.array(walk.legs)[index]
    return jax.tree.map(lambda x: x[index], walk.phases), jnp.maximum(leg, 0), (leg != SHIFT) & (at.phase < count)


def _count(walk: Walk):
    """Phases of a walk: those that are used come first."""
    return jnp.sum(walk.used, dtype=jnp.int32)


def _moved(reflex: Reflex, phase):
    """Time in which the foot of a phase is planned to move [s]."""
    return phase.duration * (1.0 - 2.0 * reflex.walk.load_share)


def _foot(reflex: Reflex, at: ReflexMemory, phase, leg, later):
    """The moving foot a little later."""
    return foot_at(bounded(reflex.machine, at.swing), reflex.feel, at.swing, phase.flight, _moved(reflex, phase), later)


def _proceed(reflex: Reflex, at: ReflexMemory, state: State) -> ReflexMemory:
    """The walk a tick later: the swing goes on, or the clock; a phase that is over makes way for the next."""
    share, dt, (leg, moving) = reflex.walk.load_share, reflex.dt, under_way(reflex, at)
    phase = _now(reflex.walk, at)[0]
    foot = _foot(reflex, at, phase, leg, dt)
    machine, time = bounded(reflex.machine, at.swing), _moved(reflex, phase)
    felt, contact = feel_on(machine, reflex.feel, at.swing, foot, at.force[leg], time, dt)
    swing = select(moving, felt, at.swing)
    again = moving & tries_again(reflex.feel, swing)
    lands = moving & (swing.state.mode >= Mode.SUPPORTED) & ~again
    clock = jnp.where(moving, jnp.where(lands, (1.0 - share) * phase.duration, at.clock), at.clock + dt)
    held = jnp.where(moving, at.held.at[leg].set(foot), at.held)
    over = clock >= phase.duration
    onward = (over & ~reflex.over(at)).astype(jnp.int32)
    clock = jnp.where(over, 0.0, clock)
    landed = lands & (jnp.arange(4) == leg)
    after = at._replace(phase=at.phase + onward, clock=clock, held=held, landed=landed, swing=swing, contact=contact & moving)
    return _set_out(reflex, after, over, again, state)


def _set_out(reflex: Reflex, at: ReflexMemory, begins, again, state: State) -> ReflexMemory:
    """Where a phase begins: its foot's swing from where the foot stands, or how far the trunk is to rise in its shift. A swing
    that has come back sets out `again`, elsewhere (B17)."""
    feel, (phase, leg, swings) = reflex.feel, _now(reflex.walk, at)
    hips = state.q[None, :3] + matvec(rotation_from_quaternion(state.q[3:7]), reflex.robot.hip_position)
    attempt = jnp.where(again, at.swing.attempt + 1, 0)
    setting = set_out(reflex.robot, feel, at.held[leg], phase.feet_to[leg], hips[leg], _moved(reflex, phase), attempt)
    swing = select((begins & swings) | again, setting, at.swing)
    higher = jnp.where(feel.reacts, jnp.min(at.held[:, 2] - phase.feet_from[:, 2]), 0.0)  # no leg longer than planned
    raised = jnp.where(begins & ~swings, jnp.stack([at.raised[1], higher]), at.raised)
    return at._replace(swing=swing, raised=raised)
