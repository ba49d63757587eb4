"""The swing leg's machine, tick by tick: the driver of `swing.machine` in a walk. Paper B, II and III.B.

Works in the vertical plane of a step (x along it from where the foot stood, z as in W). The initial movement is the walk's own
swing, planned on the map at hand; the machine's reflexes take over where the foot is stopped or finds no ground.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxleg.numerics import norm_safe
from jaxleg.pytree import pytree
from jaxleg.robot import Robot
from jaxleg.swing.arc import period, point_at
from jaxleg.swing.bounds import swing_bounds
from jaxleg.swing.cycloid import swing_foot
from jaxleg.swing.machine import Machine, Mode, Sensed, State, Step, begin, segment, transition

PLACES = 9  # of the step at which its bounds are taken
SETTLE = 0.1  # a contact that lasts so long into the next segment is a new one [s]


@pytree
class Feeling:
    """How contacts are felt; every field a leaf."""

    threshold: Float[Array, "*batch"]  # force that is a contact [N]
    delay: Float[Array, "*batch"]  # time constant of the force's low pass [s]
    least_bend: Float[Array, "*batch"]  # of the knee within the map's bounds (B19) [rad]
    most_bend: Float[Array, "*batch"]
    inertia: Float[Array, "*batch"]  # share of the inertial load that the estimate takes account of: 0 or 1
    reacts: Bool[Array, "*batch"]  # otherwise the leg moves by the clock, whatever it feels
    sees: Bool[Array, "*batch"]  # the initial movement is the map's swing; otherwise the blind one (3)


def feeling(reacts: bool = True, sees: bool = True, **changes: float) -> Feeling:
    """Settings fit for Pegasus (`experiments.reactive_climb`), whose legs weigh 30 N each; `changes` by field."""
    numbers = dict(threshold=40.0, delay=0.005, least_bend=0.2, most_bend=2.6, inertia=1.0) | changes
    leaves = {k: jnp.asarray(v, float) for k, v in numbers.items()}
    return Feeling(**leaves, reacts=jnp.asarray(reacts), sees=jnp.asarray(sees))


class Swinging(NamedTuple):
    """A swing under way."""

    origin: Float[Array, "3"]  # where the foot stood, in W
    heading: Float[Array, "2"]  # of the step
    step: Step  # in its plane
    low: Float[Array, ""]  # bounds of the map there
    high: Float[Array, ""]
    peak: Float[Array, ""]  # peak speed of the reflexes: the planned swing's [m/s]
    state: State
    clock: Float[Array, ""]  # since the segment began [s]
    armed: Bool[Array, ""]  # the last contact is over, so that a new one can be felt


def set_out(
    robot: Robot,
    feel: Feeling,
    foot: Float[Array, "3"],
    target: Float[Array, "3"],
    hip: Float[Array, "3"],
    time: Float[Array, ""],
) -> Swinging:
    """A swing from where a foot stands to where it is to land, planned to take so long [s]; all places in W [m]."""
    way = target[:2] - foot[:2]
    stride = jnp.maximum(norm_safe(way), 1e-3)
    heading = way / stride
    place = foot[None, :2] + jnp.linspace(0.0, 1.0, PLACES, dtype=foot.dtype)[:, None] * way[None]
    bounds = swing_bounds(robot, hip, place, feel.least_bend, feel.most_bend)
    zero = jnp.zeros((), foot.dtype)
    step = Step(jnp.stack([zero, foot[2]]), jnp.stack([stride, target[2]]))
    low, high = jnp.max(bounds.low), jnp.min(bounds.high)
    return Swinging(foot, heading, step, low, high, 2.0 * stride / time, begin(step), zero, jnp.array(False))


def bounded(machine: Machine, swing: Swinging) -> Machine:
    """The machine within the bounds of the step's local map."""
    return dataclasses.replace(machine, low=swing.low, high=swing.high)


def foot_at(
    machine: Machine,
    feel: Feeling,
    swing: Swinging,
    apex: Float[Array, ""],
    lift_share: Float[Array, ""],
    time: Float[Array, ""],
    later: Float[Array, ""],
) -> Float[Array, "3"]:
    """Foot in W [m] a little `later` [s]: along the planned swing (`swing_foot`, in `time` [s]) or the machine's segment."""
    planned = swing_foot(swing.origin, _target(swing), apex, jnp.minimum((swing.clock + later) / time, 1.0), lift_share)
    arc = segment(machine, swing.step, swing.state)
    share = jnp.minimum(arc.begin + (swing.clock + later) / _lasting(arc, swing), arc.end)
    return jnp.where((swing.state.mode == Mode.INITIAL) & feel.sees, planned, _in_world(swing, point_at(arc, share)))


def feel_on(
    machine: Machine,
    feel: Feeling,
    swing: Swinging,
    foot: Float[Array, "3"],
    force: Float[Array, "3"],
    time: Float[Array, ""],
    dt: Float[Array, ""],
) -> tuple[Swinging, Bool[Array, ""]]:
    """The swing a tick later, and whether a contact was felt: the foot has got to `foot` and feels `force` [N], in W."""
    arc = segment(machine, swing.step, swing.state)
    lasting = jnp.where((swing.state.mode == Mode.INITIAL) & feel.sees, time, _lasting(arc, swing) * (arc.end - arc.begin))
    along, up = jnp.sum(force[:2] * swing.heading), force[2]
    strength = jnp.maximum(up, jnp.abs(along))
    contact = (swing.armed | (swing.clock > SETTLE)) & (strength > feel.threshold) & feel.reacts
    over = swing.clock + dt >= lasting
    slope = -along / jnp.maximum(up, 1e-3)
    at = jnp.stack([jnp.sum((foot[:2] - swing.origin[:2]) * swing.heading), foot[2]])
    after = transition(machine, swing.step, swing.state, Sensed(at, contact, slope))
    clocked = swing.state._replace(mode=jnp.full_like(after.mode, Mode.SUPPORTED))
    after = jax.tree.map(lambda a, b: jnp.where(feel.reacts, a, b), after, clocked)
    ends = (contact & (swing.state.mode < Mode.RETURN_UP)) | over
    state = jax.tree.map(lambda new, old: jnp.where(ends, new, old), after, swing.state)
    armed = ~contact & (swing.armed | (strength < 0.5 * feel.threshold))
    return swing._replace(state=state, clock=jnp.where(ends, 0.0, swing.clock + dt), armed=armed), contact


def _target(swing):
    return _in_world(swing, swing.step.target)


def _in_world(swing, point):
    return jnp.concatenate([swing.origin[:2] + swing.heading * point[0], point[1:]])


def _lasting(arc, swing):
    """Time of the arc's whole period at the peak speed [s]."""
    return jnp.maximum(period(arc) / swing.peak, 1e-4)
