"""The path of a swing, segment by segment, for pictures and tables; one swing, no gradient."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.numerics import select
from jaxleg.swing.arc import point_at
from jaxleg.swing.blind import lifted
from jaxleg.swing.informed import begin_informed, informed_segment
from jaxleg.swing.localmap import LocalMap
from jaxleg.swing.machine import Machine, Mode, Step, begin, segment
from jaxleg.swing.planner import RoutePlanner
from jaxleg.swing.profile import Profile
from jaxleg.swing.replay import course_of, moved_on
from jaxleg.swing.route import corners_to, follow

POINTS = 64  # of a segment


class Trace(NamedTuple):
    """Segments of a swing in order."""

    mode: Int[np.ndarray, "segment"]
    point: Float[np.ndarray, "segment point 2"]
    hit: np.ndarray  # whether the segment ended by a contact
    ground: np.ndarray | None  # believed by then (segment, point of the map), for an informed swing


def blind_trace(machine: Machine, step: Step, profile: Profile, segments: int = 64) -> Trace:
    """The path of a blind swing, up to so many segments."""
    return _kept(*_blind(machine, step, profile, segments), None)


@functools.partial(jax.jit, static_argnames="segments")
def _blind(machine: Machine, step: Step, profile: Profile, segments: int):
    course = course_of(machine, step, profile, segments)
    step = lifted(step)

    def draw(state, branch):
        state = state._replace(mode=branch.mode, station=branch.station)
        arc = segment(machine, step, state)
        share = arc.begin + (branch.share - arc.begin) * jnp.linspace(0.0, 1.0, POINTS)
        return moved_on(machine, step, profile, state, branch)[0], point_at(arc, share)

    point = jax.lax.scan(draw, begin(step), course)[1]
    return course.mode, point, course.hit


def informed_trace(
    machine: Machine, planner: RoutePlanner, step: Step, profile: Profile, local: LocalMap, segments: int = 24
) -> Trace:
    """The path of an informed swing with what it believed of the ground, up to so many segments."""
    return _kept(*_informed(machine, planner, step, profile, local, segments))


@functools.partial(jax.jit, static_argnames="segments")
def _informed(machine, planner, step, profile, local, segments):
    def draw(carry, _):
        """One segment of the swing as points, and the route believed in."""
        state, route = carry.state, carry.route
        arc, stop = segment(machine, lifted(step), state), follow(route, profile)
        after = informed_segment(machine, planner, lifted(step), profile, carry)
        along = jnp.linspace(0.0, 1.0, POINTS)
        flown = point_at(arc, arc.begin + (_share(arc, after.informed.swing.point) - arc.begin) * along)
        routed = corners_to(route, stop, POINTS)
        point = jnp.where(state.mode == Mode.ROUTE, routed, flown)
        hit = after.informed.swing.collisions > carry.informed.swing.collisions
        hit = hit | (after.state.mode == Mode.SUPPORTED)
        after = select(state.mode >= Mode.SUPPORTED, carry, after)
        return after, (state.mode, point, hit, carry.local.ground)

    return jax.lax.scan(draw, begin_informed(machine, planner, step, local), length=segments)[1]


def _share(arc, end):
    """Share of the period at which an arc comes nearest to a point."""
    share = arc.begin + (arc.end - arc.begin) * jnp.linspace(0.0, 1.0, 2001)
    return share[jnp.argmin(jnp.sum((point_at(arc, share) - end[None]) ** 2, axis=-1))]


def _kept(mode: Array, point: Array, hit: Array, ground: Array | None) -> Trace:
    kept = np.asarray(mode) < Mode.SUPPORTED
    return Trace(*(np.asarray(x)[kept] for x in (mode, point, hit)), None if ground is None else np.asarray(ground)[kept])
