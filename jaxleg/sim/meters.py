"""What a walk is measured by: the one definition of energy, distance, slip, margin and tilt."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxleg.control.contract import State
from jaxleg.conventions import GRAVITY
from jaxleg.gait.support import stability_margin
from jaxleg.leg.energy import Power
from jaxleg.numerics import add_exactly
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.step import Measured

LOADED = 0.01  # a foot counts as loaded above this share of the weight


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


def least_load(robot: Robot) -> Float[Array, "*batch"]:
    """Normal force above which a foot counts as loaded [N]."""
    return LOADED * GRAVITY * robot.mass


def no_tally(dtype) -> Tally:
    """Meters that have seen nothing."""
    zero, joints = jnp.zeros((), dtype), jnp.zeros((4, 3), dtype)
    none = Sums(Power(joints, joints, joints), jnp.zeros(2, dtype), zero, joints[:, 0])
    return Tally(none, none, zero, jnp.full((), jnp.inf, dtype), zero)


def read(tally: Tally, alive: Bool[Array, ""]) -> Meters:
    """The meters of a walk that has ended."""
    return Meters(**tally.sums._asdict(), penetration=tally.penetration, margin=tally.margin, tilt=tally.tilt, fell=~alive)


def measure(
    tally: Tally, robot: Robot, seen: Measured, after: State, before: State, counts: Bool[Array, ""], dt: Float[Array, ""]
) -> Tally:
    """Add one step where it counts; the figures that nobody differentiates are cut out of the gradient."""
    held = jax.lax.stop_gradient(seen)
    loaded = held.normal_force > least_load(jax.lax.stop_gradient(robot))
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
