"""An informed swing: the machine with a map, its initial movement and cases 3 and 4 along planned routes. Paper B, III.C.

Cases 1 and 2 and the return are those of the blind machine, and so are cases 3 and 4 where the planner finds no route.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jaxleg.batch import over_queue
from jaxleg.swing.arc import first_touch, length_to, period, point_at
from jaxleg.swing.blind import LANES, SEGMENTS, Swing, lifted, no_swing
from jaxleg.swing.contact import skin
from jaxleg.swing.cycloid import cycloid_share
from jaxleg.swing.localmap import LocalMap
from jaxleg.swing.machine import Machine, Mode, Sensed, State, Step, begin, segment, transition
from jaxleg.swing.planner import RoutePlanner, plan, predicted
from jaxleg.swing.profile import Profile
from jaxleg.swing.route import Route, follow, route_length
from jaxleg.swing.status import status_on_map


class Informed(NamedTuple):
    """How an informed swing went."""

    swing: Swing
    plans: Int[Array, ""]  # routes asked for
    unplanned: Int[Array, ""]  # of these, without an answer: the blind machine's motion instead
    at_first: Bool[Array, ""]  # the initial movement was planned


class Course(NamedTuple):
    """An informed swing under way."""

    state: State
    local: LocalMap
    route: Route
    informed: Informed


def informed_swing(machine: Machine, planner: RoutePlanner, step: Step, profile: Profile, local: LocalMap) -> Informed:
    """Swing over a terrain with a map of it, which may be wrong."""
    return jax.lax.while_loop(
        lambda carry: carry.state.mode < Mode.SUPPORTED,
        lambda carry: informed_segment(machine, planner, lifted(step), profile, carry),
        begin_informed(machine, planner, step, local),
    ).informed


def informed_swings(machine: Machine, planner: RoutePlanner, step: Step, profiles: Profile, local: LocalMap) -> Informed:
    """`informed_swing` of one machine, planner and step over many profiles and their maps (a leading axis)."""
    return over_queue(
        lambda item: begin_informed(machine, planner, step, item[1]),
        lambda item, carry: informed_segment(machine, planner, lifted(step), item[0], carry),
        lambda carry: carry.state.mode < Mode.SUPPORTED,
        (profiles, local),
        LANES,
    ).informed


def begin_informed(machine: Machine, planner: RoutePlanner, step: Step, local: LocalMap) -> Course:
    """An informed swing before its first segment, its first route planned."""
    step = lifted(step)
    yes, zero = jnp.array(True), jnp.zeros((), jnp.int32)
    route = plan(machine, planner, step, local, step.start, yes)
    swing = no_swing(step, status_on_map(machine, step, local))
    mode = jnp.where(swing.exit == Mode.STALLED, Mode.STALLED, jnp.where(route.found, Mode.ROUTE, Mode.INITIAL))
    state = begin(step)._replace(mode=mode.astype(jnp.int32))
    informed = Informed(swing, zero + 1, (~route.found).astype(jnp.int32), route.found)
    return Course(state, local, route, informed)


def informed_segment(machine: Machine, planner: RoutePlanner, step: Step, profile: Profile, carry: Course) -> Course:
    """One segment or route of a `lifted` step, the transition at its end, and a new route where cases 3 and 4 ask for one."""
    state, local, route, informed = carry
    sensed, length, time, lost, struck = _run(machine, step, profile, state, route)
    after = transition(machine, step, state, sensed)
    case = after.mode
    asks = (case == Mode.OVER) | (case == Mode.BACK)
    local = predicted(machine, planner, local, case, sensed)
    route = plan(machine, planner, step, local, sensed.point, jnp.array(False))
    swing = informed.swing
    gives_up = lost | ((swing.segments + 1 >= SEGMENTS) & (case < Mode.SUPPORTED))
    mode = jnp.where(gives_up, Mode.STALLED, jnp.where(asks & route.found, Mode.ROUTE, case)).astype(jnp.int32)
    swing = swing._replace(
        exit=mode,
        point=sensed.point,
        length=swing.length + length,
        time=swing.time + time,
        adjustments=after.adjustments,
        collisions=swing.collisions + (sensed.contact & (mode != Mode.SUPPORTED)).astype(jnp.int32),
        segments=swing.segments + 1,
        lost=swing.lost | lost,
        struck=swing.struck | struck,
    )
    asked, unplanned = asks.astype(jnp.int32), (asks & ~route.found).astype(jnp.int32)
    informed = informed._replace(swing=swing, plans=informed.plans + asked, unplanned=informed.unplanned + unplanned)
    return Course(after._replace(mode=mode), local, route, informed)


def _run(machine, step, profile, state, route):
    """The state's segment, or the route: what the foot felt at its end, length, time, given up, struck deaf."""
    on, deaf = state.mode == Mode.ROUTE, state.mode >= Mode.RETURN_UP
    arc = segment(machine, step, state)
    touch, stop = first_touch(arc, profile), follow(route, profile)
    share = jnp.where(deaf, arc.end, touch.share)
    hit = jnp.where(on, stop.hit, touch.hit & ~deaf)
    point = jnp.where(on, stop.point, point_at(arc, share)).at[1].add(jnp.where(hit, skin(share.dtype), 0.0))
    whole = route_length(route)
    along = 2.0 * whole * cycloid_share(stop.length / jnp.maximum(whole, 1e-12))
    length = jnp.where(on, stop.length, length_to(arc, share))
    time = jnp.where(on, along, (share - arc.begin) * period(arc))
    sensed = Sensed(point, hit, jnp.where(on, stop.slope, touch.slope))
    return sensed, length, time, jnp.where(on, stop.lost, touch.lost & ~deaf), deaf & touch.hit
