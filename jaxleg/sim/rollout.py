"""The one loop of a simulated walk: engine, controller, step, fall and meters, tick by tick.

`ticker` makes it for any controller (`control`); `follow` and `reactive` run it too. `simulate` and `record` scan it over a
tracking that was computed before: one lane; `vmap` them over plans and terrains. They are differentiable, forward and
reverse, through whole gait cycles.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float

from jaxleg.control.contract import Controller, Reading, State
from jaxleg.control.tracking import OpenLoop, interpolate
from jaxleg.numerics import select
from jaxleg.robot import Robot
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.fall import fallen, watch_trunk
from jaxleg.sim.meters import Meters, Record, Tally, measure, no_tally, read
from jaxleg.sim.step import Measured, advance, initial_state
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference


class World(NamedTuple):
    """A robot and what it walks on."""

    engine: Engine
    robot: Robot
    ground: Ground
    terrain: HeightMap


class Lane(NamedTuple):
    """A walk under way."""

    state: State
    memory: Any  # the controller's
    tally: Tally
    alive: Bool[Array, ""]


class Ticked(NamedTuple):
    """What a tick did; figures of a lane that has fallen have no meaning."""

    measured: Measured
    dt: Float[Array, ""]  # [s]
    counted: Bool[Array, ""]  # the walk was under way, metered, and has not fallen


OneTick = Callable[..., tuple[Lane, Ticked]]


def ticker(world: World, controller: Controller[Any, Any], start: State, feet: Float[Array, "leg 3"]) -> tuple[Lane, OneTick]:
    """A walk that has not begun, its feet in W [m], and the function (lane, row, metered) that takes it on by a tick.

    A lane that falls keeps its last state and its controller's memory, and is measured no more.
    """
    engine, robot, ground, terrain = world
    trunk = watch_trunk(robot, terrain, start, feet)

    def tick(lane: Lane, row: Any, metered: Bool[Array, ""] | bool = True) -> tuple[Lane, Ticked]:
        """Sense, command, step, feel; then meters. `row` as in `Controller.command`."""
        state = select(lane.alive, lane.state, start)  # a fallen lane's steps stay finite
        terms = engine(state.q, state.v)
        sensed = Reading(state, terms.foot, terms.foot_by_leg)
        now, memory = controller.command(lane.memory, sensed, row)
        after, seen = advance(terms, robot, ground, terrain, state, now)
        memory = controller.felt(memory, seen.torque, after)
        alive = checkpoint_name(lane.alive & ~fallen(trunk, after, seen.foot), "alive")  # no fall is looked for twice
        counted = alive & metered & ~controller.over(lane.memory)
        after, memory = select(alive, (after, memory), (lane.state, lane.memory))
        tally = measure(lane.tally, robot, seen, after, lane.state, counted, now.dt)
        return Lane(after, memory, tally, alive), Ticked(seen, now.dt, counted)

    return Lane(start, controller.start(), no_tally(start.q.dtype), jnp.array(True)), tick


def simulate(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    reference: Reference,
    steps: int,
    metered_from: int = 0,
) -> Meters:
    """Follow a reference with so many steps between samples; meter it from sample `metered_from` on.

    A fallen or non-finite lane is frozen and flagged. Reverse mode recomputes each step, so its memory is one state a step.
    """
    return _scanned(World(engine, robot, ground, terrain), reference, steps, metered_from, keep=lambda *_: None)[0]


def record(
    engine: Engine, robot: Robot, ground: Ground, terrain: HeightMap, reference: Reference, steps: int
) -> tuple[Meters, Record]:
    """`simulate` from the first sample on, with every step's torques, speeds and forces."""

    def keep(lane: Lane, ticked: Ticked) -> Record:
        seen = ticked.measured
        return Record(ticked.dt, seen.torque, seen.speed, seen.normal_force, lane.state.q[:3], lane.alive)

    meters, kept = _scanned(World(engine, robot, ground, terrain), reference, steps, 0, keep)
    return meters, kept._replace(time=jnp.cumsum(kept.time))


def _scanned(world: World, reference: Reference, steps: int, metered_from: int, keep):
    """The meters of a rollout, and what `keep` (lane, ticked) takes from each step."""
    tracking = interpolate(reference, steps)
    metered = jnp.arange(tracking.dt.shape[0]) >= metered_from * steps
    start = initial_state(world.robot, world.ground, reference)
    first, tick = ticker(world, OpenLoop(), start, reference.foot_pos[0])

    @functools.partial(jax.checkpoint, policy=jax.checkpoint_policies.save_only_these_names("alive"))
    def body(lane, inputs):
        """One step, recomputed in reverse mode."""
        lane, ticked = tick(lane, *inputs)
        return lane, keep(lane, ticked)

    end, kept = jax.lax.scan(body, first, (tracking, metered))
    return read(end.tally, end.alive), kept
