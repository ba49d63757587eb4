"""Whether a step can be asked for at all: a status a lane inside, one clear sentence at the edge."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.numerics import Code
from jaxleg.swing.localmap import LocalMap, points
from jaxleg.swing.machine import Machine, Step
from jaxleg.swing.profile import Profile

SUNK = 1e-3  # so far under the ground a start still counts as on it


class StepStatus(Code):
    """Why a step cannot be swung; the first that holds."""

    OK = 0
    BOUNDS_CROSSED = 1  # z- is not below z+
    NO_INTERVAL = 2  # the end interval En is empty: w is not positive
    GOAL_OFF_MAP = 3  # a part of En lies beyond the map
    UNSEEN = 4  # nobody has seen some of the ground between the start and the end of En
    START_IN_GROUND = 5
    NOT_FINITE = 6  # start, target or allowance


@jax.jit
def status_on_profile(machine: Machine, step: Step, profile: Profile) -> Int[Array, ""]:
    """`StepStatus` on a terrain profile."""
    count = profile.coefficients.shape[0]
    x = profile.start + profile.spacing * jnp.arange(count + 1, dtype=profile.coefficients.dtype)
    end = jnp.sum(profile.coefficients[-1])
    return _status(machine, step, x, jnp.append(profile.coefficients[:, 0], end))


@jax.jit
def status_on_map(machine: Machine, step: Step, local: LocalMap) -> Int[Array, ""]:
    """`StepStatus` on a local map; NaN marks ground that nobody has seen."""
    return _status(machine, step, points(local), local.ground)


def _status(machine: Machine, step: Step, x: Float[Array, "n"], ground: Float[Array, "n"]) -> Int[Array, ""]:
    far = step.target[0] + machine.allowance
    spacing = x[1] - x[0]
    needed = (x > jnp.minimum(step.start[0], far) - spacing) & (x < jnp.maximum(step.start[0], far) + spacing)
    at_start = jnp.interp(step.start[0], x, jnp.where(jnp.isnan(ground), -jnp.inf, ground))
    reasons = {
        StepStatus.START_IN_GROUND: step.start[1] < at_start - SUNK,
        StepStatus.UNSEEN: jnp.any(needed & jnp.isnan(ground)),
        StepStatus.GOAL_OFF_MAP: (step.target[0] - machine.allowance < x[0]) | (far > x[-1]) | (step.start[0] < x[0]),
        StepStatus.NO_INTERVAL: ~(machine.allowance > 0.0),
        StepStatus.BOUNDS_CROSSED: ~(machine.low < machine.high),
        StepStatus.NOT_FINITE: ~jnp.isfinite(jnp.sum(step.start) + jnp.sum(step.target) + machine.allowance),
    }
    status = jnp.asarray(StepStatus.OK, jnp.int32)
    for reason, holds in reasons.items():
        status = jnp.where(holds, reason, status)
    return status.astype(jnp.int32)


def check_step(machine: Machine, step: Step, ground: Profile | LocalMap) -> None:
    """Refuse one concrete step that cannot be swung: a ValueError that names the value and what is allowed."""
    on_map = isinstance(ground, LocalMap)
    status = int(status_on_map(machine, step, ground) if on_map else status_on_profile(machine, step, ground))
    start, target = (tuple(round(float(v), 4) for v in np.asarray(p)) for p in (step.start, step.target))
    sentence = {
        StepStatus.NOT_FINITE: f"step.start = {start}, step.target = {target} and machine.allowance must be finite",
        StepStatus.BOUNDS_CROSSED: f"machine.low = {float(machine.low)} must be below machine.high = {float(machine.high)}",
        StepStatus.NO_INTERVAL: f"machine.allowance = {float(machine.allowance)} must be positive: the end interval is empty",
        StepStatus.GOAL_OFF_MAP: f"step.target = {target} with its end interval, and step.start = {start}, must lie on the map",
        StepStatus.UNSEEN: f"the ground from step.start = {start} to the end interval round {target} is in part unseen (NaN)",
        StepStatus.START_IN_GROUND: f"step.start = {start} lies in the ground; it must be on it or above",
    }.get(StepStatus(status))
    if sentence:
        raise ValueError(sentence)
