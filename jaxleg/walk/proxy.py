"""Energy proxy: electrical energy of the plan's own inverse dynamics, and what constrains the plan.

The integral over a cycle is that of `quadrature`. Differentiable in every continuous parameter; the discrete foothold choice is
held.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxleg.conventions import GRAVITY
from jaxleg.gait.support import edge_margins
from jaxleg.leg.energy import Power
from jaxleg.leg.kinematics import Reach
from jaxleg.robot import Robot
from jaxleg.status import Status
from jaxleg.walk.data import PlanChecks, Walk
from jaxleg.walk.inside import found_so, stood_in
from jaxleg.walk.quadrature import energy_of, nodes_of, pieces_of
from jaxleg.walk.reference import Instant, at_places, phase_instant

BATCH = 512  # instants of a walk worked out together


class Needs(NamedTuple):
    """What constrains a plan at each of many instants, infinite where it is not used; `PlanChecks` tells the least of each."""

    knee_bend: Float[Array, "leg t"]  # [rad]
    margin: Float[Array, "edge t"]  # of stability, to each edge of the support [m]
    torque: Float[Array, "leg joint t"]  # -|torque| over its limit
    load: Float[Array, "leg t"]  # vertical force of a standing foot over a quarter of the weight
    joint_room: Float[Array, "leg t"]  # distance of a leg's joints to the ends of their ranges [rad]


class Proxy(NamedTuple):
    """What a walk costs and how near it comes to its constraints."""

    energy: Power  # by joint (leg, joint) [J]
    distance: Float[Array, ""]  # [m]
    time: Float[Array, ""]  # [s]
    needs: Needs
    checks: PlanChecks


def evaluate(robot: Robot, walk: Walk) -> Proxy:
    """Energy and checks over all of a walk; one lane, `vmap` outside."""
    pieces = pieces_of(walk)
    phase = np.concatenate([np.repeat(some.phase, some.nodes) for some in pieces])
    share = jnp.concatenate([nodes_of(some) for some in pieces])
    at = over_phases(lambda p, s: phase_instant(robot, p, s, walk.load_share), walk, phase, share)
    used, energy = walk.used[phase], energy_of(robot, walk, pieces, at)
    time = jnp.sum(jnp.where(walk.used, walk.phases.duration, 0.0))
    needs = needs_at(robot, at, used)
    return Proxy(energy, walk.way, time, needs, checks(robot, walk, at, needs, used))


def over_phases(function: Callable[..., Instant], walk: Walk, phase: np.ndarray, share: Float[Array, "n"]) -> Instant:
    """A function (phase, share) at many places of a walk, these in the last axis. Of a long walk some at a time, worked out
    again for the gradient: the memory is that of `BATCH`."""
    if len(phase) <= BATCH:
        return function(*at_places(walk.phases, phase, share))
    chunks = -(-len(phase) // BATCH)
    size = -(-len(phase) // chunks)
    place = np.minimum(np.arange(chunks * size), len(phase) - 1).reshape(chunks, size)  # the last one fills up
    some = jax.checkpoint(lambda x: function(*at_places(walk.phases, *x)))
    at = jax.lax.map(some, (jnp.asarray(phase[place]), share[place]))
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1)[..., : len(phase)], at)


def needs_at(robot: Robot, at: Instant, used: Bool[Array, "t"]) -> Needs:
    """Knee bend, stability margin and so on at sampled instants (last axis of `at`), those that are `used`."""
    loaded = at.weight > 0.01
    margin = edge_margins(at.com[:2], at.feet[:, :2], loaded)
    load = jnp.where(loaded, at.load, jnp.inf) / (0.25 * robot.mass * GRAVITY)
    needs = Needs(at.bend, margin, -jnp.abs(at.torque) / robot.torque_limit[..., None], load, at.room)
    return jax.tree.map(lambda x: jnp.where(jax.lax.broadcast_to_rank(used, x.ndim), x, jnp.inf), needs)


def checks(robot: Robot, walk: Walk, at: Instant, needs: Needs, used: Bool[Array, "t"]) -> PlanChecks:
    """The least of all `needs`, and the status of a walk with these instants."""
    bend, margin, torque, load, room = (jnp.min(x) for x in needs)
    status = _status(robot, walk, jnp.any(used[None] & (at.reach != Reach.OK)), margin - torque + load)
    return PlanChecks(bend, margin, -torque, load, room, walk.lowering, *stood_in(robot, walk), found_so(walk), status)


def _status(robot, walk, beyond, numbers):
    low = walk.gait.workspace.high - walk.lowering <= -robot.link_offset[0, 1, 2]
    outside = low | beyond | jnp.any(walk.phases.duration <= 0.0)
    status = jnp.where(outside, Status.KINEMATICS, Status.OK)
    status = jnp.where(jnp.isfinite(numbers), status, Status.NOT_FINITE)
    return jnp.where(walk.status == Status.OK, status, walk.status).astype(jnp.int32)
