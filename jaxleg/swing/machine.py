"""The swing leg that feels its way: paper B's finite state machine (Fig. 2 and 4) as one transition function.

    initial movement -> (tentative adjustment)* -> support, or -> return

`transition` maps a state and what the foot felt at the end of a segment to the next state; `segment` says which path that state
asks for. Both are plain functions of arrays; `swing/blind.py` drives them segment by segment against a known terrain.
`printed` and `extended` are two sets of `Machine` parameters of the same program.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.numerics import Code
from jaxleg.pytree import pytree
from jaxleg.swing.arc import Arc


class Mode(Code):
    """What the leg is doing; the last three are exits."""

    INITIAL = 0  # (3): whole cycloid to the target
    BACK = 1  # case 4, (7)
    UP = 2  # case 4, (8)
    FORWARD = 3  # case 4, (9)
    OVER = 4  # case 3, (6): whole cycloid to the target
    DOWN = 5  # case 1, (4)
    CORNER = 6  # case 2, (5): down to a corner of the end interval
    LIFT = 7  # extended: straight up to the map's upper bound
    ACROSS = 8  # extended: along it to the next untried station
    PROBE = 9  # extended: straight down there
    ROUTE = 10  # informed: along a planned route
    RETURN_UP = 11  # (10), first part: up to the map's upper bound
    RETURN_ACROSS = 12  # extended: along it to above the start
    RETURN_DOWN = 13  # (10), second part
    SUPPORTED = 14
    RETURNED = 15
    STALLED = 16  # gave up: no station left, or out of segments


@pytree
class Machine:
    """Parameters of the machine; every field a leaf. Lengths in the unit of the map (dimensionless in paper B)."""

    height_share: Float[Array, "*batch"]  # gamma_H
    back: Float[Array, "*batch"]  # l_back
    allowance: Float[Array, "*batch"]  # w: half width of the end interval En
    limit: Float[Array, "*batch"]  # N_limit: the demand for one more adjustment than this is the return
    dominance: Float[Array, "*batch"]  # slope (dz/dx) from which the obstacle component F_x dominates
    low: Float[Array, "*batch"]  # z-: lower bound of the map
    high: Float[Array, "*batch"]  # z+: upper bound
    probing: Bool[Array, "*batch"]  # extended: a jam or a wall met twice is answered by probing stations of En from above
    stations: Float[Array, "station"]  # where to probe, in units of w, in this order; none at inf


class Step(NamedTuple):
    """A step that is asked for: from a start to a target, both (x, z)."""

    start: Float[Array, "2"]
    target: Float[Array, "2"]


class State(NamedTuple):
    """State of the machine; `mode` is what it does next."""

    mode: Int[Array, ""]
    point: Float[Array, "2"]  # where the foot is
    adjustments: Int[Array, ""]  # demanded so far
    station: Int[Array, ""]  # next to probe
    stop: Float[Array, ""]  # x of the last stop by contact
    slope: Float[Array, ""]  # of the terrain felt there


class Sensed(NamedTuple):
    """What the foot feels at the end of a segment."""

    point: Float[Array, "2"]
    contact: Bool[Array, ""]
    slope: Float[Array, ""]  # dT/dx: the force's direction is the terrain's normal (-dT/dx, 1)


def printed(**changes: ArrayLike) -> Machine:
    """The machine as printed, with paper B's Table I and a map from 0 to 7.5 unless changed (by field, e.g. `high`)."""
    return _machine(dict(limit=3.0, probing=False), [0.0], changes)


def extended(stations: int = 257, coarse_to_fine: bool = True, **changes: ArrayLike) -> Machine:
    """The machine repaired where the printed one jams, without a limit of adjustments; see `_extended`.

    An odd number of stations over En, tried from coarse to fine or from the left; `changes` as for `printed`.
    """
    order = _coarse_to_fine(stations) if coarse_to_fine else _uniform(stations)
    return _machine(dict(limit=jnp.inf, probing=True), order, changes)


def _machine(kind, stations, changes) -> Machine:
    numbers = dict(height_share=0.3, back=0.5, allowance=1.0, dominance=1.0, low=0.0, high=7.5) | kind | changes
    check_positive("machine", numbers, ("height_share", "back", "allowance", "limit", "dominance"))
    probing = jnp.asarray(numbers.pop("probing"))
    return Machine(
        **{k: jnp.asarray(v, float) for k, v in numbers.items()}, probing=probing, stations=jnp.asarray(stations, float)
    )


def check_positive(what: str, numbers: dict, names: tuple[str, ...]) -> None:
    """Refuse by name what must be positive; JAX arrays, which may be traced, pass unseen."""
    for name in names:
        value = numbers[name]
        if not isinstance(value, jax.Array) and not np.all(np.asarray(value) > 0.0):
            raise ValueError(f"{what}: {name} = {value} must be positive")


def _uniform(count: int) -> list[float]:
    """From -1 to 1, from the left."""
    return [2.0 * i / (count - 1) - 1.0 for i in range(count)]


def _coarse_to_fine(count: int) -> list[float]:
    """The same stations, each level of halving after the one before it, the middle first."""
    order, step = [0.0, -1.0, 1.0], 1.0
    while len(order) < count:
        order += [x for x in (-1.0 + step * (i + 0.5) for i in range(round(2.0 / step))) if x not in order]
        step *= 0.5
    return order[:count]


def begin(step: Step) -> State:
    """The first state of a step."""
    zero = jnp.zeros((), jnp.int32)
    return State(zero, step.start, zero, zero, jnp.full((), -jnp.inf, step.start.dtype), jnp.zeros((), step.start.dtype))


def segment(machine: Machine, step: Step, state: State) -> Arc:
    """The path that a state asks for (paper B, (3)-(10)); of no length in an exit."""
    (x, z), target, room = state.point, step.target, machine.high - state.point[1]
    back = jnp.where(machine.probing, jnp.clip(x - step.start[0], 0.0, machine.back), machine.back)  # printed: off the map
    up = machine.height_share * room
    corner = target[0] - jnp.where(state.slope > 0.0, 1.0, -1.0) * machine.allowance  # F_x < 0 on a rising slope
    station = target[0] + machine.allowance * machine.stations[jnp.minimum(state.station, machine.stations.size - 1)]
    whole, first, second = (0.0, 1.0), (0.0, 0.5), (0.5, 1.0)
    rows = {
        Mode.INITIAL: (target[0] - x, up, *whole),
        Mode.BACK: (-back, 0.0, *whole),
        Mode.UP: (2.0 * (state.stop - x), up, *first),  # forward again by as far as it went back
        Mode.FORWARD: (2.0 * (target[0] - x), z - target[1], *second),
        Mode.OVER: (target[0] - x, up, *whole),
        Mode.DOWN: (0.0, z - machine.low, *second),
        Mode.CORNER: (2.0 * (corner - x), z - machine.low, *second),
        Mode.LIFT: (0.0, room, *first),
        Mode.ACROSS: (station - x, 0.0, *whole),
        Mode.PROBE: (0.0, z - machine.low, *second),
        Mode.RETURN_UP: (0.0, room, *first),
        Mode.RETURN_ACROSS: (step.start[0] - x, 0.0, *whole),
        Mode.RETURN_DOWN: (2.0 * (step.start[0] - x), z - step.start[1], *second),
    }
    still = (0.0, 0.0, *whole)
    table = jnp.stack([jnp.stack([jnp.asarray(v, z.dtype) for v in rows.get(mode, still)]) for mode in Mode])
    return Arc(state.point, *table[state.mode])


def transition(machine: Machine, step: Step, state: State, sensed: Sensed) -> State:
    """The next state, from the state whose segment has ended and what the foot felt there. Paper B, II, III.B and Fig. 4."""
    contact, steep = sensed.contact, jnp.abs(sensed.slope) > machine.dominance
    inside = jnp.abs(sensed.point[0] - step.target[0]) <= machine.allowance * (1.0 + 1e-6)
    returning = (state.mode >= Mode.RETURN_UP) & (state.mode <= Mode.RETURN_DOWN)
    follow = _follow(machine, state.mode)
    moves_on = (follow >= 0) & (~contact | returning)
    lands = inside & contact & ~steep & ~returning
    demanded = state.adjustments + 1
    case = jnp.where(inside, jnp.where(contact, Mode.CORNER, Mode.DOWN), jnp.where(steep, Mode.BACK, Mode.OVER))
    probed = (state.mode == Mode.ACROSS) | (state.mode == Mode.PROBE)
    case, station = _extended(machine, state, sensed, inside, steep, probed, case)
    case = jnp.where(inside | contact, case, Mode.STALLED)  # a path that ended outside of En without a contact
    case = jnp.where(demanded.astype(machine.limit.dtype) > machine.limit, Mode.RETURN_UP, case)
    mode = jnp.where(lands, Mode.SUPPORTED, jnp.where(moves_on, follow, case))
    adjusts = ~(lands | moves_on | (case == Mode.RETURN_UP))
    return State(
        mode.astype(jnp.int32),
        sensed.point,
        jnp.where(adjusts, demanded, state.adjustments),
        jnp.where(adjusts, station, state.station),
        jnp.where(contact, sensed.point[0], state.stop),
        jnp.where(contact, sensed.slope, state.slope),
    )


def _follow(machine: Machine, mode):
    """The segment that follows one that was not stopped, or -1: then an adjustment is asked for."""
    follow = {
        Mode.BACK: Mode.UP,
        Mode.UP: Mode.FORWARD,
        Mode.LIFT: Mode.ACROSS,
        Mode.ACROSS: Mode.PROBE,
        Mode.RETURN_UP: Mode.RETURN_DOWN,
        Mode.RETURN_ACROSS: Mode.RETURN_DOWN,
        Mode.RETURN_DOWN: Mode.RETURNED,
    }
    then = jnp.array([follow.get(m, -1) for m in Mode], jnp.int32)[mode]
    return jnp.where(machine.probing & (mode == Mode.RETURN_UP), Mode.RETURN_ACROSS, then)


def _extended(machine: Machine, state: State, sensed: Sensed, inside, steep, probed, case):
    """The repairs of the extended machine: where the printed one jams, lift and probe the next station of En from above."""
    station = state.station + probed.astype(jnp.int32)
    stuck = jnp.hypot(*(sensed.point - state.point)) < 1e-3 * machine.allowance
    jammed = inside & ((state.mode == Mode.CORNER) & stuck | (state.mode == Mode.DOWN) & ~sensed.contact)
    again = ~inside & steep & (jnp.abs(sensed.point[0] - state.stop) < machine.back)
    facing_away = ~inside & steep & (sensed.slope < 0.0)  # backing off would run into the wall behind
    upcoming = machine.stations[jnp.minimum(station, machine.stations.size - 1)]
    left = (station < machine.stations.size) & jnp.isfinite(upcoming)
    lift = jnp.where(left, Mode.LIFT, Mode.STALLED)
    better = jnp.where(probed | jammed | again, lift, jnp.where(facing_away, Mode.OVER, case))
    return jnp.where(machine.probing, better, case), jnp.where(machine.probing, station, state.station)
