"""A blind swing: the machine driven segment by segment against a terrain profile that only the foot feels. Paper B, IV.A.

`blind_swing` is one swing, `blind_swings` many at once. No reverse mode: the course of a swing is a `while_loop`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.batch import over_queue
from jaxleg.swing.arc import first_touch, length_to, period, point_at, velocity_at
from jaxleg.swing.contact import skin
from jaxleg.swing.machine import Machine, Mode, Sensed, State, Step, begin, segment, transition
from jaxleg.swing.profile import Profile
from jaxleg.swing.status import StepStatus, status_on_profile

SEGMENTS = 2000  # of one swing; then it has stalled
LANES = 64  # swings under way at once


class Swing(NamedTuple):
    """How a swing went."""

    exit: Int[Array, ""]  # Mode.SUPPORTED, RETURNED or STALLED
    status: Int[Array, ""]  # `StepStatus`: a step that cannot be asked for has stalled at once
    point: Float[Array, "2"]  # where it ended
    length: Float[Array, ""]  # of its path, a return included
    time: Float[Array, ""]  # at a peak speed of 1 on every segment
    jump: Float[Array, ""]  # greatest jump of a component of velocity at a segment's begin, on a peak speed of 1; 0 if informed
    adjustments: Int[Array, ""]  # carried out; the return is none
    collisions: Int[Array, ""]  # contacts that were no support
    segments: Int[Array, ""]
    lost: Bool[Array, ""]  # a contact search was given up
    struck: Bool[Array, ""]  # the return, which does not feel, went through terrain


def blind_swing(machine: Machine, step: Step, profile: Profile) -> Swing:
    """Swing from the start of a step until an exit is reached."""
    return jax.lax.while_loop(
        lambda carry: carry[0].mode < Mode.SUPPORTED,
        lambda carry: _advance(machine, lifted(step), profile, carry),
        _begin(machine, lifted(step), profile),
    )[1]


def blind_swings(machine: Machine, step: Step, profiles: Profile) -> Swing:
    """`blind_swing` of one machine and step over many profiles (a leading axis): the swings' lengths differ much."""
    return over_queue(
        lambda profile: _begin(machine, lifted(step), profile),
        lambda profile, carry: _advance(machine, lifted(step), profile, carry),
        lambda carry: carry[0].mode < Mode.SUPPORTED,
        profiles,
        LANES,
    )[1]


def lifted(step: Step) -> Step:
    """The step from just above the ground that its foot stands on."""
    return step._replace(start=jnp.stack([step.start[0], step.start[1] + skin(step.start.dtype)]))


Carry = tuple[State, Swing, Float[Array, "2"]]  # and the velocity at the end of the last segment


def no_swing(step: Step, status: Int[Array, ""]) -> Swing:
    """A swing before it has begun; stalled where its step cannot be asked for."""
    zero, no, still = jnp.zeros((), jnp.int32), jnp.array(False), jnp.zeros((), step.start.dtype)
    mode = jnp.where(status == StepStatus.OK, 0, Mode.STALLED).astype(jnp.int32)
    return Swing(mode, status, step.start, still, still, still, zero, zero, zero, no, no)


def _begin(machine: Machine, step: Step, profile: Profile) -> Carry:
    swing = no_swing(step, status_on_profile(machine, step, profile))
    return begin(step)._replace(mode=swing.exit), swing, jnp.zeros_like(step.start)


def _advance(machine: Machine, step: Step, profile: Profile, carry: Carry) -> Carry:
    """One segment and the transition at its end."""
    state, swing, velocity = carry
    arc = segment(machine, step, state)
    touch = first_touch(arc, profile)
    deaf = state.mode >= Mode.RETURN_UP
    share = jnp.where(deaf, arc.end, touch.share)
    point = point_at(arc, share) + jnp.stack([0.0 * share, jnp.where(touch.hit & ~deaf, skin(share.dtype), 0.0)])
    after = transition(machine, step, state, Sensed(point, touch.hit & ~deaf, touch.slope))
    gives_up = (touch.lost & ~deaf) | ((swing.segments + 1 >= SEGMENTS) & (after.mode < Mode.SUPPORTED))
    after = after._replace(mode=jnp.where(gives_up, Mode.STALLED, after.mode).astype(jnp.int32))
    stops = (touch.hit & ~deaf) | (after.mode >= Mode.SUPPORTED)
    jump = jnp.max(jnp.abs(velocity_at(arc, arc.begin) - velocity))
    swing = Swing(
        after.mode,
        swing.status,
        point,
        swing.length + length_to(arc, share),
        swing.time + (share - arc.begin) * period(arc),
        jnp.maximum(swing.jump, jump),
        after.adjustments,
        swing.collisions + (touch.hit & ~deaf & (after.mode != Mode.SUPPORTED)).astype(jnp.int32),
        swing.segments + 1,
        swing.lost | touch.lost,
        swing.struck | (deaf & touch.hit),
    )
    return after, swing, jnp.where(stops, 0.0, velocity_at(arc, share))
