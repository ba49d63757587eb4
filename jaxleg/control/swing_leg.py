"""The swing leg's machine, tick by tick: the driver of `swing.machine` in a walk. Paper B, II and III.B.

Works in the vertical plane of a step (x along it from where the foot stood, z as in W). The initial movement is the walk's own
swing, planned on the map at hand; the machine's reflexes take over where the foot is stopped or finds no ground.
"""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.sensing import Senses
from jaxleg.conventions import GRAVITY
from jaxleg.gait.phases import Flight
from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.numerics import norm_safe, select
from jaxleg.pytree import pytree
from jaxleg.robot import Robot
from jaxleg.rotations import turned
from jaxleg.swing.arc import period, point_at
from jaxleg.swing.bounds import swing_bounds
from jaxleg.swing.flight import fly
from jaxleg.swing.machine import Machine, Mode, Sensed, State, Step, begin, extended, segment, transition

PLACES = 9  # of the step at which its bounds are taken
SETTLE = 0.1  # a contact that lasts so long into the next segment is a new one [s]


@pytree
class Feeling:
    """How contacts are felt; every field a leaf."""

    senses: Senses
    threshold: Float[Array, "*batch"]  # force that is a contact [N]
    least_bend: Float[Array, "*batch"]  # of the knee within the map's bounds (B19) [rad]
    most_bend: Float[Array, "*batch"]
    answers: Float[Array, "*batch answer 2"]  # to a return, in this order (B17): turn to the left [rad], share of the step
    reacts: Bool[Array, "*batch"]  # otherwise the leg moves by the clock, whatever it feels
    sees: Bool[Array, "*batch"]  # the initial movement is the map's swing; otherwise the blind one (3)


def feeling(robot: Robot, reacts: bool = True, sees: bool = True, seed: int = 0, **changes: float) -> Feeling:
    """A robot's settings: a contact is 1.3 times the weight of a leg, felt without noise or error; after a return the step is
    tried to either side, then half of it. `changes` by field, of `Senses`, too."""
    weight = GRAVITY * jnp.sum(robot.link_mass) / 4.0
    numbers = dict(threshold=1.3 * weight, delay=0.005, least_bend=0.2, most_bend=2.6, inertia=1.0)
    numbers |= dict(mass_error=0.0, friction=0.0, angle_noise=0.0, torque_noise=0.0) | changes
    leaves = {k: jnp.asarray(v, float) for k, v in numbers.items()}
    rest = {name: leaves.pop(name) for name in ("threshold", "least_bend", "most_bend")}
    senses = Senses(**leaves, seed=jnp.asarray(seed, jnp.int32))
    answers = jnp.array([[0.5, 1.0], [-0.5, 1.0], [0.0, 0.5]])
    return Feeling(senses, **rest, answers=answers, reacts=jnp.asarray(reacts), sees=jnp.asarray(sees))


def reflexes(robot: Robot, stations: int = 9) -> Machine:
    """The extended machine for a robot's walk, lengths in m by that of its leg: an end interval of a twelfth to either side."""
    leg = reach_for_bend(robot.link_offset[0], jnp.zeros(()))
    return extended(stations, back=leg / 15.0, allowance=leg / 12.0, limit=8.0)


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
    attempt: Int[Array, ""]  # 0 the step as planned, then the answers to its returns


def set_out(
    robot: Robot,
    feel: Feeling,
    foot: Float[Array, "3"],
    target: Float[Array, "3"],
    hip: Float[Array, "3"],
    time: Float[Array, ""],
    attempt: Int[Array, ""],
) -> Swinging:
    """A swing from where a foot stands to where it is to land, planned to take so long [s]; all places in W [m].

    The first attempt is the step itself, the others are answers to its return: in another direction, or shorter.
    """
    way = _answered(feel, target[:2] - foot[:2], attempt)
    stride = jnp.maximum(norm_safe(way), 1e-3)
    heading = way / stride
    place = foot[None, :2] + jnp.linspace(0.0, 1.0, PLACES, dtype=foot.dtype)[:, None] * way[None]
    bounds = swing_bounds(robot, hip, place, feel.least_bend, feel.most_bend)
    zero = jnp.zeros((), foot.dtype)
    step = Step(jnp.stack([zero, foot[2]]), jnp.stack([stride, target[2]]))
    low, high = jnp.max(bounds.low), jnp.min(bounds.high)
    return Swinging(foot, heading, step, low, high, 2.0 * stride / time, begin(step), zero, jnp.array(False), attempt)


def _answered(feel, way, attempt):
    """The way of a step, or of an answer to its return."""
    step = jnp.array([[0.0, 1.0]], way.dtype)
    turn, share = jnp.concatenate([step, feel.answers])[attempt]
    return share * turned(way, turn)


def tries_again(feel: Feeling, swing: Swinging) -> Bool[Array, ""]:
    """Whether a swing has come back and has an answer left."""
    return (swing.state.mode == Mode.RETURNED) & (swing.attempt < feel.answers.shape[0])


def _by_plan(feel, swing):
    """Whether the foot is on the way that was planned on the map: an answer to a return sets out blindly."""
    return (swing.state.mode == Mode.INITIAL) & feel.sees & (swing.attempt == 0)


def bounded(machine: Machine, swing: Swinging) -> Machine:
    """The machine within the bounds of the step's local map."""
    return dataclasses.replace(machine, low=swing.low, high=swing.high)


def foot_at(
    machine: Machine,
    feel: Feeling,
    swing: Swinging,
    flight: Flight,
    time: Float[Array, ""],
    later: Float[Array, ""],
) -> Float[Array, "3"]:
    """Foot in W [m] a little `later` [s]: along the planned swing (`fly`, in `time` [s]) or the machine's segment."""
    planned = fly(swing.origin, _target(swing), flight, jnp.minimum((swing.clock + later) / time, 1.0))
    arc = segment(machine, swing.step, swing.state)
    share = jnp.minimum(arc.begin + (swing.clock + later) / _lasting(arc, swing), arc.end)
    return jnp.where(_by_plan(feel, swing), planned, _in_world(swing, point_at(arc, share)))


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
    lasting = jnp.where(_by_plan(feel, swing), time, _lasting(arc, swing) * (arc.end - arc.begin))
    along, up = jnp.sum(force[:2] * swing.heading), force[2]
    strength = jnp.maximum(up, jnp.abs(along))
    contact = (swing.armed | (swing.clock > SETTLE)) & (strength > feel.threshold) & feel.reacts
    over = swing.clock + dt >= lasting
    slope = -along / jnp.maximum(up, 1e-3)
    at = jnp.stack([jnp.sum((foot[:2] - swing.origin[:2]) * swing.heading), foot[2]])
    after = transition(machine, swing.step, swing.state, Sensed(at, contact, slope))
    clocked = swing.state._replace(mode=jnp.full_like(after.mode, Mode.SUPPORTED))
    after = select(feel.reacts, after, clocked)
    ends = (contact & (swing.state.mode < Mode.RETURN_UP)) | over
    state = select(ends, after, swing.state)
    armed = ~contact & (swing.armed | (strength < 0.5 * feel.threshold))
    return swing._replace(state=state, clock=jnp.where(ends, 0.0, swing.clock + dt), armed=armed), contact


def _target(swing):
    return _in_world(swing, swing.step.target)


def _in_world(swing, point):
    return jnp.concatenate([swing.origin[:2] + swing.heading * point[0], point[1:]])


def _lasting(arc, swing):
    """Time of the arc's whole period at the peak speed [s]."""
    return jnp.maximum(period(arc) / swing.peak, 1e-4)
