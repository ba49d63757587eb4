"""Walk a plan in the simulation with a swinging leg that feels its way (`control.reflex`). One lane; `vmap` it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.reflex import reflex, under_way
from jaxleg.control.swing_leg import Feeling
from jaxleg.robot import Robot
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.rollout import Lane, World, ticker
from jaxleg.sim.step import initial_state
from jaxleg.swing.machine import Machine
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Walk
from jaxleg.walk.reference import to_reference


class Tick(NamedTuple):
    """What a reactive walk did, tick by tick; a lane that has fallen stays where it fell."""

    phase: Int[Array, "t"]
    mode: Int[Array, "t"]  # of the swinging leg's machine; -1 in a shift and while load is transferred
    adjustments: Int[Array, "t"]
    contact: Bool[Array, "t"]  # felt by the swinging leg
    normal_force: Float[Array, "t leg"]  # true [N]
    felt: Float[Array, "t leg 3"]  # its low-passed estimate in W [N]
    foot: Float[Array, "t leg 3"]  # centres in W [m]
    trunk: Float[Array, "t 3"]
    alive: Bool[Array, "t"]
    done: Bool[Array, "t"]  # the walk is over: it stands


def walk_reactively(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    walk: Walk,
    machine: Machine,
    feel: Feeling,
    dt: Float[Array, ""],
    ticks: int,
) -> Tick:
    """Walk a plan on a terrain that its map may have wrong, for so many ticks of dt [s]."""
    controller = reflex(robot, walk, machine, feel, dt)
    start = initial_state(robot, ground, _one(controller.first))
    first, tick = ticker(World(engine, robot, ground, terrain), controller, start, controller.first.feet)

    def body(lane: Lane, _):
        """One tick, and its row."""
        before, (lane, ticked) = lane.memory, tick(lane, None)
        after, swing, seen = lane.memory, before.swing.state, ticked.measured
        mode = jnp.where(under_way(controller, before)[1], swing.mode, -1)
        whether = lane.alive, controller.over(after)
        felt = (before.phase, mode, swing.adjustments, after.contact & lane.alive, seen.normal_force, after.force)
        return lane, Tick(*felt, seen.foot, lane.state.q[:3], *whether)

    return jax.lax.scan(body, first, length=ticks)[1]


def _one(at):
    """A reference of one sample."""
    return to_reference(jnp.zeros(1, at.angles.dtype), jax.tree.map(lambda x: x[..., None], at))
