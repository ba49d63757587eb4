"""How high a planned swing must go: over the ground under all of its way. Paper B, (2); C, Table 1."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.gait.params import GaitParams
from jaxleg.gait.phases import Flight
from jaxleg.pytree import pytree
from jaxleg.robot import Robot
from jaxleg.swing.cycloid import cycloid_advance, cycloid_lift
from jaxleg.terrain.obstacles import Obstacles, highest_near

LOOKS = np.linspace(0.15, 0.85, 33)  # shares of a swing at which its ground is looked at: every 1/14 step at most


@pytree
class Cycloid:
    """How a foot flies that follows a plan: along a compound cycloid; every field a leaf."""

    clearance: Float[Array, "*batch"]  # between the foot and the ground in mid-swing [m]
    load_share: Float[Array, "*batch"]  # part of a swing at either end in which the load is transferred

    def flight(
        self, robot: Robot, gait: GaitParams, ground: Obstacles, start: Float[Array, "3"], end: Float[Array, "3"]
    ) -> Flight:
        """The cycloid between two centres of the foot in W [m]: its apex the least one, raised until the foot clears the ground
        near all of its way (B, (2)).

        Between two looks the ground counts as the higher one's and the foot as the lower one's.
        """
        shares = jnp.asarray(LOOKS, start.dtype)
        along = cycloid_advance(jnp.clip((shares - gait.lift_share) / (1.0 - 2.0 * gait.lift_share), 0.0, 1.0))
        path = start[None, :2] + (end - start)[None, :2] * along[:, None]
        high = jax.vmap(highest_near, in_axes=(None, 0))(ground, path) + robot.contact_radius
        base, lift = jnp.where(shares < 0.5, start[2], end[2]), cycloid_lift(shares)
        high, base, lift = (f(x[1:], x[:-1]) for f, x in ((jnp.maximum, high), (jnp.minimum, base), (jnp.minimum, lift)))
        top = base + (high + self.clearance * lift - base) / lift
        apex = jnp.maximum(jnp.max(top) - jnp.maximum(start[2], end[2]), gait.swing_height)
        return Flight(apex, gait.lift_share, jnp.zeros((0, 2), apex.dtype), jnp.zeros_like(apex))
