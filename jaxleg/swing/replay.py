"""A blind swing with its branches held, for gradients: the same segments, each ended by the same contact or by none.

The course of a swing is found by the exact machine; along it length and landing are smooth in the machine's numbers,
the step and the terrain. A contact moves with them by the implicit function theorem: one Newton step from where it was
found, whose gap is zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.numerics import select
from jaxleg.swing.arc import first_touch, length_to, point_at, rates
from jaxleg.swing.blind import lifted
from jaxleg.swing.contact import skin
from jaxleg.swing.machine import Machine, Mode, Sensed, State, Step, begin, segment, transition
from jaxleg.swing.profile import Profile, height, slope


class Course(NamedTuple):
    """The branches of a swing, one row a segment; the rows after its exit are of no length."""

    mode: Int[Array, "segment"]
    station: Int[Array, "segment"]
    share: Float[Array, "segment"]  # where the segment ended
    hit: Bool[Array, "segment"]  # by a contact


def course_of(machine: Machine, step: Step, profile: Profile, segments: int) -> Course:
    """The branches that a swing takes, up to so many segments; no gradient."""
    machine, step, profile = jax.lax.stop_gradient((machine, lifted(step), profile))

    def follow(state, _):
        """One segment to its end or touch; an exit stays."""
        arc = segment(machine, step, state)
        touch = first_touch(arc, profile)
        hit = touch.hit & (state.mode < Mode.RETURN_UP)
        share = jnp.where(state.mode < Mode.RETURN_UP, touch.share, arc.end)
        after = transition(machine, step, state, Sensed(_stop(arc, share, hit), hit, touch.slope))
        after = select(state.mode >= Mode.SUPPORTED, state, after)
        return after, Course(state.mode, state.station, share, hit)

    return jax.lax.scan(follow, begin(step), length=segments)[1]


def replay(machine: Machine, step: Step, profile: Profile, course: Course) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """Length of the path along a course, and where it ends; forward and reverse differentiable in all but the course."""
    step = lifted(step)

    def follow(carry, branch):
        state, length = carry
        after, way = moved_on(machine, step, profile, state._replace(mode=branch.mode, station=branch.station), branch)
        return (after, length + way), None

    (state, length), _ = jax.lax.scan(follow, (begin(step), jnp.zeros((), step.start.dtype)), course)
    return length, state.point


def moved_on(machine: Machine, step: Step, profile: Profile, state: State, branch: Course) -> tuple[State, Float[Array, ""]]:
    """The state after one branch of a course from a lifted step, without its mode, and the length of the segment."""
    arc = segment(machine, step, state)
    share = jnp.where(branch.hit, _contact(arc, profile, branch.share), arc.end)
    point = _stop(arc, share, branch.hit)
    after = state._replace(
        point=point,
        stop=jnp.where(branch.hit, point[0], state.stop),
        slope=jnp.where(branch.hit, slope(profile, point[0]), state.slope),
    )
    moves = branch.mode < Mode.SUPPORTED
    after = select(moves, after, state)
    return after, jnp.where(moves, length_to(arc, share), 0.0)


def _contact(arc, profile, share):
    """Share of the contact near `share`, with its derivatives."""
    at = point_at(arc, share)
    x_rate, z_rate = rates(arc, share)
    rate = jax.lax.stop_gradient(z_rate - slope(profile, at[0]) * x_rate)
    gap = at[1] - height(profile, at[0])
    return share - gap / jnp.where(rate == 0.0, 1.0, rate)


def _stop(arc, share, hit):
    return point_at(arc, share) + jnp.stack([0.0 * share, jnp.where(hit, skin(arc.start.dtype), 0.0)])
