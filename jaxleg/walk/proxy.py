"""Energy proxy: electrical energy of the plan's own inverse dynamics, and what constrains the plan.

The integral over a cycle is a Gauss rule on each smooth piece of each phase, so that the phases' shares have true
gradients (a uniform grid aliases them). Differentiable in every continuous parameter; the discrete foothold choice is held.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.conventions import GRAVITY
from jaxleg.foothold.cascade import FootholdStatus
from jaxleg.gait.order import SHIFT, SWING_LEG
from jaxleg.gait.support import stability_margin
from jaxleg.leg.energy import Power, motor_power
from jaxleg.leg.kinematics import Reach
from jaxleg.robot import Robot
from jaxleg.walk.crawl import CrawlSettings
from jaxleg.walk.data import PlanChecks, PlanStatus, Walk
from jaxleg.walk.reference import Instant, instant


class Proxy(NamedTuple):
    """What a walk costs and how near it comes to its constraints."""

    energy: Power  # by joint (leg, joint) [J]
    distance: Float[Array, ""]  # [m]
    time: Float[Array, ""]  # [s]
    checks: PlanChecks


def evaluate(robot: Robot, walk: Walk, settings: CrawlSettings) -> Proxy:
    """Energy and checks over all cycles of a walk; one lane, `vmap` outside."""
    phase, share, weight = _nodes(settings.load_share, walk.cycle_time.shape[0])
    phases = jax.tree.map(lambda x: x[phase], walk.phases)
    at = jax.vmap(lambda p, s: instant(robot, walk, settings, p, s))(phases, share)
    power = motor_power(robot, at.torque, at.velocity)
    seconds = weight * phases.duration
    energy = Power(*(jnp.sum(seconds[:, None, None] * p, axis=0) for p in power))
    advance = walk.waypoints[-1, 0] - walk.waypoints[0, 0]
    return Proxy(energy, advance, jnp.sum(walk.cycle_time), checks(robot, walk, at))


def checks(robot: Robot, walk: Walk, at: Instant) -> PlanChecks:
    """Least knee bend, stability margin and so on over sampled instants (leading axis of `at`)."""
    feet, loaded = at.feet[..., :2], at.weight > 0.01
    margin = jnp.min(jax.vmap(stability_margin)(at.com[:, :2], feet, loaded))
    ratio = jnp.max(jnp.abs(at.torque) / robot.torque_limit[None])
    load = jnp.min(jnp.where(loaded, at.load, jnp.inf)) / (0.25 * robot.mass * GRAVITY)
    status = _status(robot, walk, at, margin + ratio + load)
    return PlanChecks(jnp.min(at.bend), margin, ratio, load, jnp.min(at.room), walk.lowering, status)


def _status(robot, walk, at, numbers):
    low = walk.params.hip_height - walk.lowering <= -robot.link_offset[0, 1, 2]
    outside = low | jnp.any(at.reach != Reach.OK) | jnp.any(walk.cycle_time <= 0.0)
    missing = jnp.any(walk.foothold_status == FootholdStatus.NONE)
    status = jnp.where(outside, PlanStatus.OUT_OF_REACH, PlanStatus.OK)
    status = jnp.where(jnp.isfinite(numbers), status, PlanStatus.NOT_FINITE)
    return jnp.where(missing, PlanStatus.NO_FOOTHOLD, status).astype(jnp.int32)


def _nodes(load_share: Float[Array, ""], cycles: int):
    """Phase index, share and quadrature weight (in shares of the phase) of every node of a walk."""
    phase, share, weight = [], [], []
    for index, leg in enumerate(SWING_LEG * cycles):
        for start, width, order in _pieces(load_share, swing=leg != SHIFT):
            x, w = np.polynomial.legendre.leggauss(order)
            phase.append(np.full(order, index))
            share.append(start + width * jnp.asarray((x + 1.0) / 2.0, dtype=load_share.dtype))
            weight.append(width * jnp.asarray(w / 2.0, dtype=load_share.dtype))
    return np.concatenate(phase), jnp.concatenate(share), jnp.concatenate(weight)


def _pieces(load_share, swing: bool):
    """Smooth pieces (start, width, nodes): load off, foot up, foot down, load on; or two halves of a body shift."""
    if not swing:
        return [(0.0, 0.5, 4), (0.5, 0.5, 4)]
    half = 0.5 - load_share
    return [(0.0, load_share, 2), (load_share, half, 7), (0.5, half, 7), (1.0 - load_share, load_share, 2)]
