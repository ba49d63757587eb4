"""Batched rollout of a plan: steps along its reference, and the meters.

`simulate` and `record` are one lane; `vmap` them over plans and terrains. They are differentiable, forward and reverse,
through whole gait cycles.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float

from jaxleg.control.tracking import interpolate
from jaxleg.gait.support import stability_margin
from jaxleg.leg.energy import Power
from jaxleg.numerics import add_exactly
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.fall import fallen, watch_trunk
from jaxleg.sim.step import Measured, State, initial_state, step
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference

LOADED = 1.0  # a foot counts as loaded above this normal force [N]


class Meters(NamedTuple):
    """What a rollout measured over its metered cycles. The one definition of energy, margin, slip and fall."""

    energy: Power  # by joint (leg, joint) [J]: torque the implicit step applied times mid-step speed
    moved: Float[Array, "2"]  # how far the trunk has come (x, y) [m]
    time: Float[Array, ""]  # [s]
    slip: Float[Array, "leg"]  # way of the loaded foot along the ground [m]
    penetration: Float[Array, ""]  # greatest [m]
    margin: Float[Array, ""]  # least stability margin: centre of mass in the hull of the loaded feet [m]
    tilt: Float[Array, ""]  # greatest angle of the trunk's z axis from the vertical [rad]
    fell: Bool[Array, ""]  # see `fall`


class Sums(NamedTuple):
    """What adds up, as in `Meters`."""

    energy: Power
    moved: Float[Array, "2"]
    time: Float[Array, ""]
    slip: Float[Array, "leg"]


class Tally(NamedTuple):
    """Meters under way."""

    sums: Sums
    lost: Sums  # by rounding, see `add_exactly`
    penetration: Float[Array, ""]
    margin: Float[Array, ""]
    tilt: Float[Array, ""]


class Record(NamedTuple):
    """A rollout step by step. A lane that fell goes on with figures of no meaning, marked by `alive`."""

    time: Float[Array, "t"]  # at the end of the step [s]
    torque: Float[Array, "t leg joint"]  # of the motors, as the implicit step applied it [N m]
    speed: Float[Array, "t leg joint"]  # of the joints in mid-step [rad/s]
    normal_force: Float[Array, "t leg"]  # [N]
    trunk_pos: Float[Array, "t 3"]  # B's origin in W [m]
    alive: Bool[Array, "t"]


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
    return _follow(engine, robot, ground, terrain, reference, steps, metered_from, keep=lambda *_: None)[0]


def record(
    engine: Engine, robot: Robot, ground: Ground, terrain: HeightMap, reference: Reference, steps: int
) -> tuple[Meters, Record]:
    """`simulate` from the first sample on, with every step's torques, speeds and forces."""

    def keep(seen: Measured, after: State, dt, ok):
        return Record(dt, seen.torque, seen.speed, seen.normal_force, after.q[:3], ok)

    meters, kept = _follow(engine, robot, ground, terrain, reference, steps, 0, keep)
    return meters, kept._replace(time=jnp.cumsum(kept.time))


def _follow(engine, robot, ground, terrain, reference, steps, metered_from, keep):
    """The meters of a rollout, and what `keep` (measured, state, dt, alive) takes from each step."""
    tracking = interpolate(reference, steps)
    start = initial_state(robot, ground, reference)
    trunk = watch_trunk(robot, terrain, start, reference.foot_pos[0])
    count = tracking.dt.shape[0]
    metered = jnp.arange(count) >= metered_from * steps

    @functools.partial(jax.checkpoint, policy=jax.checkpoint_policies.save_only_these_names("alive"))
    def body(carry, inputs):
        """One step; a lane that falls keeps its last state."""
        state, tally, alive = carry
        now, counts = inputs
        safe = jax.tree.map(lambda a, b: jnp.where(alive, a, b), state, start)
        after, measured = step(engine, robot, ground, terrain, safe, now)
        ok = checkpoint_name(alive & ~fallen(trunk, after, measured.foot), "alive")  # no fall is looked for twice
        after = jax.tree.map(lambda a, b: jnp.where(ok, a, b), after, state)
        tally = measure(tally, measured, after, state, counts & ok, now.dt)
        return (after, tally, ok), keep(measured, after, now.dt, ok)

    carry, kept = jax.lax.scan(body, (start, no_tally(start.q.dtype), jnp.array(True)), (tracking, metered))
    return read(*carry[1:]), kept


def no_tally(dtype) -> Tally:
    """Meters that have seen nothing."""
    zero, joints = jnp.zeros((), dtype), jnp.zeros((4, 3), dtype)
    none = Sums(Power(joints, joints, joints), jnp.zeros(2, dtype), zero, joints[:, 0])
    return Tally(none, none, zero, jnp.full((), jnp.inf, dtype), zero)


def read(tally: Tally, alive: Bool[Array, ""]) -> Meters:
    """The meters of a walk that has ended."""
    return Meters(**tally.sums._asdict(), penetration=tally.penetration, margin=tally.margin, tilt=tally.tilt, fell=~alive)


def measure(tally: Tally, seen: Measured, after: State, before: State, counts: Bool[Array, ""], dt: Float[Array, ""]) -> Tally:
    """Add one step where it counts; the figures that nobody differentiates are cut out of the gradient."""
    held = jax.lax.stop_gradient(seen)
    loaded = held.normal_force > LOADED
    more = Sums(
        energy=jax.tree.map(lambda p: dt * p, seen.power),
        moved=after.q[:2] - before.q[:2],
        time=dt,
        slip=dt * jnp.where(loaded, held.sliding, 0.0),
    )
    more = jax.tree.map(lambda x: jnp.where(counts, x, 0.0), more)
    margin = stability_margin(held.com[:2], held.foot[:, :2], loaded)
    return Tally(
        *add_exactly(tally.sums, tally.lost, more),
        penetration=jnp.where(counts, jnp.maximum(tally.penetration, jnp.max(held.penetration)), tally.penetration),
        margin=jnp.where(counts, jnp.minimum(tally.margin, margin), tally.margin),
        tilt=jnp.where(counts, jnp.maximum(tally.tilt, _tilt(jax.lax.stop_gradient(after.q[3:7]))), tally.tilt),
    )


def _tilt(quaternion):
    rotation = rotation_from_quaternion(quaternion)
    return jnp.arctan2(jnp.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])
