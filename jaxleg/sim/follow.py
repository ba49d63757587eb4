"""Follow a long plan in the simulation with feedback on where the trunk is (`control.course`). One lane; `vmap` it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.control.course import course
from jaxleg.robot import Robot
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.meters import Meters, read
from jaxleg.sim.rollout import Lane, World, ticker
from jaxleg.sim.step import initial_state
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference


class Followed(NamedTuple):
    """What following a plan measured."""

    meters: Meters
    feet: Float[Array, "step leg 3"]  # foot centres in W at the end of each step [m]
    trunk: Float[Array, "step 7"]  # position and quaternion there
    reached: Int[Array, ""]  # the plan's sample at which it ended or fell
    finished: Bool[Array, ""]  # whether that is its last one, and it stands


class _Walk(NamedTuple):
    """A walk under way, and what it has left of each step."""

    lane: Lane
    feet: Float[Array, "step leg 3"]
    trunk: Float[Array, "step 7"]


def follow(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    reference: Reference,
    last: Int[Array, ""],
    per_step: int,
    dt: Float[Array, ""],
    ticks: Int[Array, ""],
) -> Followed:
    """Follow a reference up to its sample `last`, `per_step` samples a step of the plan, in ticks of dt [s].

    `ticks` must cover the longest lane (not batched: it bounds the loop); a lane that has ended stands. A fallen lane is
    frozen. Forward only: the loop's length is not known before.
    """
    first, tick = _walker(World(engine, robot, ground, terrain), reference, last, per_step, dt)
    end = jax.lax.fori_loop(0, ticks, lambda _, walk: tick(walk), first)
    return _followed(end, last)


def film(
    engine: Engine,
    robot: Robot,
    ground: Ground,
    terrain: HeightMap,
    reference: Reference,
    last: Int[Array, ""],
    per_step: int,
    dt: Float[Array, ""],
    frames: tuple[int, int],
) -> tuple[Followed, Float[Array, "frame 19"]]:
    """`follow` for so many (frames, ticks each), static; also the configuration q at the start of every frame."""
    first, tick = _walker(World(engine, robot, ground, terrain), reference, last, per_step, dt)

    def frame(walk: _Walk, _):
        return jax.lax.fori_loop(0, frames[1], lambda _, walk: tick(walk), walk), walk.lane.state.q

    end, shots = jax.lax.scan(frame, first, length=frames[0])
    return _followed(end, last), shots


def _walker(world: World, reference: Reference, last, per_step: int, dt):
    """A walk that has not begun, and the function that takes it on by a tick."""
    start = initial_state(world.robot, world.ground, reference)
    lane, tick = ticker(world, course(reference, last, dt), start, reference.foot_pos[0])
    steps, dtype = -(-(reference.time.shape[0] - 1) // per_step), start.q.dtype

    def onward(walk: _Walk) -> _Walk:
        """Keeps the feet and the trunk of the step under way."""
        lane, seen = tick(walk.lane, None)
        place = jnp.where(seen.counted, walk.lane.memory.index // per_step, steps)
        feet = walk.feet.at[place].set(seen.measured.foot, mode="drop")
        return _Walk(lane, feet, walk.trunk.at[place].set(lane.state.q[:7], mode="drop"))

    return _Walk(lane, jnp.zeros((steps, 4, 3), dtype), jnp.zeros((steps, 7), dtype)), onward


def _followed(end: _Walk, last: Int[Array, ""]) -> Followed:
    lane, reached = end.lane, end.lane.memory.index
    return Followed(read(lane.tally, lane.alive), end.feet, end.trunk, reached, lane.alive & (reached >= last))


def landing_errors(reference: Reference, followed: Followed, per_step: int, legs: tuple[int, ...]) -> Float[Array, "step"]:
    """Horizontal distance [m] of the foot that has swung from its planned place, at the end of each step."""
    steps = followed.feet.shape[0]
    end = jnp.minimum((jnp.arange(steps) + 1) * per_step, reference.time.shape[0] - 1)
    leg = jnp.array(legs)[jnp.arange(steps) % len(legs)]
    apart = followed.feet[jnp.arange(steps), leg] - reference.foot_pos[end, leg]
    return jnp.linalg.norm(apart[:, :2], axis=-1)
