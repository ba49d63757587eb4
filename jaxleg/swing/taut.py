"""The foot on a taut string: the shortest way over ground that is known, a clearance above it. Paper B, III.C (reading B13).

Paper B plans it in the plane of a step over a local map; here that is cut out of the height map, for a step in any direction.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.gait.params import GaitParams
from jaxleg.gait.phases import Flight
from jaxleg.numerics import norm_safe
from jaxleg.pytree import pytree
from jaxleg.robot import Robot
from jaxleg.swing.localmap import LocalMap, points, widened
from jaxleg.swing.routing import WINDOW, View, taut_string
from jaxleg.terrain.obstacles import Obstacles, highest_near

POINTS = 48  # of the local map of a step


@pytree
class Taut:
    """The shortest way from foothold to foothold that keeps clear of the ground; every field a leaf."""

    clearance: Float[Array, "*batch"]  # between the foot and the ground, at most `WINDOW` points of the local map [m]
    load_share: Float[Array, "*batch"]  # part of a swing at either end in which the load is transferred

    def flight(
        self, robot: Robot, gait: GaitParams, ground: Obstacles, start: Float[Array, "3"], end: Float[Array, "3"]
    ) -> Flight:
        """The route between two centres of the foot in W [m] (B, III.C); rounded corners take less than half the clearance."""
        local = section(robot, ground, start, end)
        view = _view(local, widened(local, self.clearance, WINDOW), start)
        stride = points(local)[-1]
        corner = taut_string(view).corner / jnp.stack([stride, jnp.ones_like(stride)])[None]
        apex = jnp.max(corner[:, 1]) - jnp.maximum(start[2], end[2])
        return Flight(apex, jnp.zeros_like(apex), corner, self.clearance)


def section(robot: Robot, ground: Obstacles, start: Float[Array, "3"], end: Float[Array, "3"]) -> LocalMap:
    """The local map of a step in its own vertical plane: least heights [m] of a foot's centre on its way from start to end.

    Ground counts that is as near as a leg is thick; at the two ends the foot stands where it stands.
    """
    stride = jnp.maximum(norm_safe(end[:2] - start[:2]), 1e-3)
    share = jnp.linspace(0.0, 1.0, POINTS, dtype=start.dtype)
    place = start[None, :2] + share[:, None] * (end - start)[None, :2]
    high = jax.vmap(highest_near, in_axes=(None, 0))(ground, place) + robot.contact_radius
    high = jnp.where(jnp.isfinite(high), high, jnp.minimum(start[2], end[2]))  # unseen: no obstacle
    high = high.at[0].set(start[2]).at[-1].set(end[2])
    return LocalMap(high, jnp.zeros_like(stride), stride / (POINTS - 1))


def _view(local: LocalMap, wide: Float[Array, "point"], start: Float[Array, "3"]) -> View:
    """What `taut_string` sees: it lands at the last point and nowhere else."""
    zero = jnp.zeros_like(local.start)
    cost = jnp.full_like(wide, jnp.inf).at[-1].set(0.0)
    block, begin = jnp.full(3, -jnp.inf, wide.dtype), jnp.stack([zero, start[2]])
    first = jnp.zeros((), int)
    return View(points(local), local.ground, block, wide, first, begin, cost, points(local)[-1], zero, jnp.zeros(3, wide.dtype))
