"""Where the feet of a walk stand under their hips, and how often inside the workspace. Paper A, IV.B.3."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.foothold.contract import FootholdStatus
from jaxleg.gait.order import STEP_LEGS
from jaxleg.leg.workspace import Workspace
from jaxleg.posture.workspace import Stood, inside, room, stood
from jaxleg.robot import Robot
from jaxleg.walk.data import Walk


def steps_stood(robot: Robot, walk: Walk) -> Stood:
    """The feet at each step of a walk (leading axis); beyond its last none are asked."""
    step = np.arange(walk.steps)
    leg = jnp.asarray([STEP_LEGS[s % 4] for s in step])
    each = jax.vmap(lambda *at: stood(robot, walk.gait, *at))
    seen = each(walk.poses[step + 1], walk.feet[step], walk.feet[step + 1], leg)
    walked = jnp.asarray(step, jnp.int32) < walk.count
    return seen._replace(asked=seen.asked & walked[:, None, None])


def stood_in(robot: Robot, walk: Walk) -> tuple[Workspace, Float[Array, ""]]:
    """The smallest workspace that all places lie in that are asked, and which share of them is inside the gait's own."""
    seen = steps_stood(robot, walk)
    above = jnp.broadcast_to(seen.above[:, None, None], seen.asked.shape)
    least, most = ([_end(x, seen.asked, sign) for x in (seen.ahead, above)] for sign in (1.0, -1.0))
    within = seen.asked & inside(jax.vmap(lambda at: room(robot, walk.gait, at))(seen))
    share = jnp.sum(within, dtype=above.dtype) / jnp.maximum(jnp.sum(seen.asked, dtype=above.dtype), 1.0)
    return Workspace(least[0], most[0], least[1], most[1]), share


def _end(values, asked, sign):
    """Least (sign 1) or greatest (-1) of the values that are asked."""
    return sign * jnp.min(jnp.where(asked, sign * values, jnp.inf))


def found_so(walk: Walk) -> Float[Array, "status"]:
    """Share of a walk's footholds by how they were found, in the order of `FootholdStatus`."""
    return jnp.stack([jnp.mean((walk.found == status).astype(walk.way.dtype)) for status in FootholdStatus])
