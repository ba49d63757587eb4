"""Footholds one leg at a time, ranked by their cost and their distance from the default one. Paper C, (23)."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxleg.foothold.contract import Footholds, FootholdStatus, Proposal, Room, endless
from jaxleg.foothold.rectangle import cells_around
from jaxleg.gait.params import GaitParams
from jaxleg.numerics import highest
from jaxleg.pytree import pytree, static
from jaxleg.robot import Robot
from jaxleg.rotations import to_heading
from jaxleg.terrain.heightmap import nearest_cell
from jaxleg.terrain.site import Site


@pytree
class Ranked:
    """The rectangle that a leg searches, and what its cells are ranked by; all but the counts leaves."""

    length: Float[Array, "*batch"]  # of the rectangle round the default foothold, along the heading [m]
    width: Float[Array, "*batch"]
    cost_weight: Float[Array, "*batch"]  # footholds are ordered by this times their cost ...
    distance_weight: Float[Array, "*batch"]  # ... plus this times the distance to the default one over half the diagonal
    cells: int = static()  # looked at either way of a default foothold
    count: int = static(12)  # of candidates

    def propose(
        self,
        robot: Robot,
        gait: GaitParams,
        site: Site,
        nominal: Float[Array, "leg 2"],
        yaw: Float[Array, ""],
        leg: Int[Array, ""],
    ) -> Proposal:
        """The best valid cells of the rectangle round a leg's nominal foothold, turned to the heading [rad]; those beyond the
        cells that there are do not exist."""
        del robot, gait
        resolution, shape = site.terrain.resolution, jnp.array([site.valid.shape], jnp.int32)
        valid, cost = jnp.asarray(site.valid), jnp.asarray(site.cost)  # NumPy's could not be indexed by a tracer
        origin, default = site.terrain.origin[None], nominal[leg][None]
        middle = nearest_cell(site.terrain, default)
        cell = middle + jnp.asarray(cells_around((self.cells, self.cells)), jnp.int32).reshape(-1, 2)
        xy = origin + resolution * cell.astype(default.dtype)
        along, size = jnp.abs(to_heading(xy - default, yaw)), jnp.stack([self.length, self.width])
        inside = jnp.all((cell >= 0) & (cell < shape), axis=1) & jnp.all(2.0 * along <= size[None] + 1e-4, axis=1)
        safe = jnp.clip(cell, 0, shape - 1)
        heading = jnp.round(yaw / (0.25 * jnp.pi)).astype(jnp.int32) % 8
        near = jnp.linalg.norm(xy - default, axis=1) / (0.5 * jnp.linalg.norm(size))
        value = self.cost_weight * cost[leg, heading, safe[:, 0], safe[:, 1]] + self.distance_weight * near
        usable = inside & valid[safe[:, 0], safe[:, 1]] & jnp.isfinite(value)
        worth, best = highest(jnp.where(usable, -value, -jnp.inf), self.count)
        return Proposal(xy[best], jnp.isfinite(worth), -worth)

    def wider(self, share: float) -> "Ranked":
        """The same with a rectangle so many times as long and wide: for the first stance, which no step binds."""
        return dataclasses.replace(
            self, length=share * self.length, width=share * self.width, cells=int(-(-share * self.cells // 1)), count=1
        )

    def stance(
        self,
        robot: Robot,
        gait: GaitParams,
        site: Site,
        nominal: Float[Array, "leg 2"],
        yaw: Float[Array, ""],
        room: Room = endless,
    ) -> Footholds:
        """Each leg's best foothold, in a rectangle half as large again where there is none in its own. `room` of the
        feet together has no say here: each leg chooses for itself, and `feasible` judges what comes of it."""
        del room
        wide = self.wider(1.5)

        def choose(leg):
            near, far = (some.propose(robot, gait, site, nominal, yaw, leg) for some in (self, wide))
            xy = jnp.where(near.exists[0], near.xy[0], far.xy[0])
            status = jnp.where(far.exists[0], FootholdStatus.WIDENED, FootholdStatus.NONE)
            status = jnp.where(near.exists[0], FootholdStatus.NOMINAL, status).astype(jnp.int32)
            return jnp.where(status == FootholdStatus.NONE, 0.0, xy - nominal[leg]), status

        return Footholds(*jax.vmap(choose)(jnp.arange(4)))
