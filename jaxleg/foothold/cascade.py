"""Foothold choice: the cascaded search of paper A, IV.B.3 (A11).

The four feet of a cycle move from their nominal footholds by one common offset, so that they still form the nominal
stance (Fig. 7), and stay in the workspace under their hips. First within the search rectangle, then within the lengthened
one; failing that each leg for itself takes the nearest valid cell whatever the workspace, within the lengthened rectangle or
else within one step length. A leg without any is flagged.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import LEG_END
from jaxleg.foothold.contract import Footholds, FootholdStatus, Proposal, Room, endless
from jaxleg.foothold.rectangle import (
    Candidates,
    Extent,
    SearchRectangle,
    candidates,
    feasible_score,
    nearness,
    preference,
    preferred,
    rings,
)
from jaxleg.gait.params import GaitParams
from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.numerics import highest, sqrt_safe
from jaxleg.posture.workspace import inside
from jaxleg.pytree import pytree, static
from jaxleg.robot.model import Robot
from jaxleg.rotations import to_heading
from jaxleg.terrain.heightmap import HeightMap, nearest_cell
from jaxleg.terrain.site import Site

BLOCK = 64  # cells a leg that the last resort looks at together


class Reachable(NamedTuple):
    """What a leg can reach: a foothold's height over the mean ground under its end's two legs, and one step length [m]."""

    lowest: Float[Array, ""]
    highest: Float[Array, ""]
    step: Float[Array, ""]


class Found(NamedTuple):
    """What the legs find on the map."""

    footing: Float[Array, "nx ny"]  # height of the cells that are footholds, NaN elsewhere [m]
    level: Float[Array, "leg"]  # mean height of the ground at each leg's end [m]
    height: Float[Array, "leg i j"]  # of the candidates, NaN where they are no footholds [m]
    usable: Bool[Array, "leg i j"]  # candidates that are footholds of a height that the leg reaches


@pytree
class Cascade:
    """The search rectangle, and the knee bend that a foothold's height must allow; the extent is static."""

    rectangle: SearchRectangle
    least_bend: Float[Array, "*batch"]  # [rad]
    extent: Extent = static()
    count: int = static(12)  # of candidates that a tree search is offered

    def stance(
        self,
        robot: Robot,
        gait: GaitParams,
        site: Site,
        nominal: Float[Array, "leg 2"],
        yaw: Float[Array, ""],
        room: Room = endless,
    ) -> Footholds:
        """The footholds of a stance that heads by `yaw` [rad]; no gradient."""
        nominal, gait, yaw, this = jax.lax.stop_gradient((nominal, gait, yaw, self))
        reachable = reachable_heights(robot, gait, this.least_bend)
        rectangle = dataclasses.replace(this.rectangle, heading=yaw)
        return choose_stance(nominal, site.valid, site.terrain, rectangle, reachable, self.extent, room)

    def propose(
        self,
        robot: Robot,
        gait: GaitParams,
        site: Site,
        nominal: Float[Array, "leg 2"],
        yaw: Float[Array, ""],
        leg: Int[Array, ""],
    ) -> Proposal:
        """A leg's foothold of the stance's common choice, then its other cells by the feasible score; no gradient."""
        own = self.stance(robot, gait, site, nominal, yaw)
        rectangle = dataclasses.replace(self.rectangle, heading=yaw)
        seen = candidates(rectangle, site.terrain.resolution, self.extent.cells)
        reachable = reachable_heights(robot, gait, self.least_bend)
        usable = look(nominal, site.valid, site.terrain, seen, reachable, self.extent.cells).usable[leg] & seen.long
        again = jnp.all(jnp.abs(seen.offset - own.offset[leg][None, None]) < 1e-6, axis=-1)
        score = jnp.where(usable & ~again, feasible_score(seen.along, rectangle, rectangle.longer), -jnp.inf)
        worth, best = highest(score.reshape(-1), self.count - 1)
        offset = jnp.concatenate([own.offset[leg][None], seen.offset.reshape(-1, 2)[best]])
        exists = jnp.concatenate([(own.status[leg] != FootholdStatus.NONE)[None], jnp.isfinite(worth)])
        return Proposal(nominal[leg][None] + offset, exists, 1.0 - jnp.concatenate([jnp.ones(1, worth.dtype), worth]))


def reachable_heights(robot: Robot, gait: GaitParams, least_bend: Float[ArrayLike, ""]) -> Reachable:
    """Heights of a foothold over the ground round it that a leg reaches (the "kinematically valid" of paper A, IV.B.3).

    The hips' plane may come down to the workspace's lower bound, and no further than the thigh's length over the ground (A5,
    A17); the foot is at most |L_F2H| + L_Step/2 before or behind its hip: so deep reaches the leg at its least knee bend. No
    foot stands higher than H_COG - L2.
    """
    thigh = -robot.link_offset[0, 1, 2]
    high = jnp.asarray(gait.workspace.high)
    low = jnp.minimum(jnp.maximum(thigh, gait.workspace.low), high)
    ahead = jnp.abs(gait.foot_offset) + 0.5 * gait.step_length
    deepest = sqrt_safe(reach_for_bend(robot.link_offset[0], least_bend) ** 2 - ahead**2)
    return Reachable(low - deepest, high - thigh, gait.step_length)


def choose_stance(
    nominal: Float[Array, "leg 2"],
    valid: Bool[Array, "nx ny"],
    terrain: HeightMap,
    rectangle: SearchRectangle,
    reachable: Reachable,
    extent: Extent,
    room: Room = endless,
) -> Footholds:
    """The cascade in its exact form, for one stance. Piecewise constant: it has no gradient, see `foothold.soft`.

    `nominal` (x, y) in W [m]; `valid` from `terrain.footing`. A candidate counts if its cell (the one nearest to it) is on
    the map, seen, valid, and of a height that the leg reaches; together they do if all of them do and there is `room`.
    """
    seen = candidates(rectangle, terrain.resolution, extent.cells)
    footing, level, height, usable = look(nominal, valid, terrain, seen, reachable, extent.cells)
    together = jnp.all(usable, axis=0)

    def first(value, allowed):
        keys = tuple(key.reshape(-1) for key in preference(seen.along, value))
        return preferred(keys, allowed.reshape(*allowed.shape[:-2], -1))

    score = feasible_score(seen.along, rectangle)
    common = together & _inside(nominal, seen, height, room, *first(score, together & seen.short))
    short, nominal_found = first(score, common & seen.short)
    long, widened_found = first(feasible_score(seen.along, rectangle, rectangle.longer), common & seen.long)
    near, near_found = first(nearness(seen.along), usable & seen.long[None])
    offset = seen.offset.reshape(-1, 2)[jnp.where(nominal_found, short, jnp.where(widened_found, long, near))]
    lost = ~(near_found | widened_found)
    far, far_found = _resort(nominal, footing, terrain, rectangle, reachable, level, lost, extent.resort)
    each = jnp.where(near_found | far_found, FootholdStatus.NEAREST, FootholdStatus.NONE)
    status = jnp.where(nominal_found, FootholdStatus.NOMINAL, jnp.where(widened_found, FootholdStatus.WIDENED, each))
    offset = jnp.where(lost[:, None], jnp.where(far_found[:, None], far, 0.0), offset)
    return Footholds(offset, status.astype(jnp.int32))


def look(
    nominal: Float[Array, "leg 2"],
    valid: Bool[Array, "nx ny"],
    terrain: HeightMap,
    seen: Candidates,
    reachable: Reachable,
    cells: tuple[int, int],
) -> Found:
    """Each leg's candidates, cut out of the map, which is bordered by cells that are no footholds."""
    footing = jnp.where(valid & jnp.isfinite(terrain.elevation), terrain.elevation, jnp.nan)
    border = [(2 * n + 1, 2 * n + 1) for n in cells]  # a nominal foothold beyond it sees nothing but border
    bordered = jnp.pad(footing, border, constant_values=jnp.nan)
    size = tuple(2 * n + 1 for n in cells)
    half, last = jnp.array([cells], jnp.int32), jnp.array([[n - m for n, m in zip(bordered.shape, size)]], jnp.int32)
    corner = jnp.clip(nearest_cell(terrain, nominal) + half + 1, 0, last)
    height = jax.vmap(lambda c: jax.lax.dynamic_slice(bordered, c, size))(corner)
    level = _levels(jnp.where(seen.long, height, jnp.nan))
    return Found(footing, level, height, _within(height, level[:, None, None], reachable))


def _inside(nominal, seen: Candidates, height, room: Room, best, found) -> Bool[Array, "i j"]:
    """Which common offsets leave the four feet `room`. Where the `best` one does, as nearly always, none but it is asked about:
    no other will be taken."""
    at = jnp.unravel_index(best, height.shape[1:])
    feet = jnp.concatenate([nominal + seen.offset[at][None], height[:, *at][:, None]], axis=1)

    def ask(state):
        """Ask about all. That nothing was ruled out before says the compiler that this cannot be worked out beforehand."""
        own = jnp.where(state[0][None], height, jnp.nan)
        return inside(rooms(nominal, seen, own, room)), jnp.array(True)

    begin = jnp.ones(height.shape[1:], bool), found & inside(room(feet))
    return jax.lax.while_loop(lambda state: ~state[1], ask, begin)[0]


def rooms(nominal: Float[Array, "leg 2"], seen: Candidates, height: Float[Array, "leg i j"], room: Room) -> Float[Array, "i j"]:
    """The `room` of the four feet at each common offset, on cells of these heights [m]; no number where one is no foothold."""
    xy = nominal[None, None] + seen.offset[:, :, None]
    feet = jnp.concatenate([xy, jnp.moveaxis(height, 0, -1)[..., None]], axis=-1)
    return jax.vmap(jax.vmap(room))(feet)


def _levels(height: Float[Array, "leg i j"]) -> Float[Array, "leg"]:
    """Mean height of the two legs' candidates at each leg's end of the trunk, which pitches with the ground; NaN for none."""
    there = jnp.isfinite(height)
    count = jnp.sum(there, axis=(1, 2), dtype=height.dtype)
    mean = jnp.sum(jnp.where(there, height, 0.0), axis=(1, 2)) / jnp.maximum(count, 1.0)
    end = jnp.array(LEG_END)
    mates = (end[:, None] == end[None]) & (count > 0.0)[None]
    return jnp.sum(jnp.where(mates, mean[None], 0.0), axis=1) / jnp.sum(mates, axis=1, dtype=mean.dtype)


def _within(height, level, reachable: Reachable):
    """Whether there is a foothold at a height that the leg reaches; a leg that has seen no level takes any."""
    above = height - level
    return jnp.isfinite(height) & ~(above < reachable.lowest) & ~(above > reachable.highest)


def _resort(nominal, footing, terrain, rectangle, reachable: Reachable, level, lost, reach: int):
    """Last resort: each lost leg's nearest foothold within one step length. Stops looking when no leg is lost any more."""
    blocks = jnp.asarray(rings(reach, BLOCK), jnp.int32)
    start, size = nearest_cell(terrain, nominal), jnp.array([[footing.shape]], jnp.int32)

    def look(state):
        """The next block of cells: whether one of them will do for a foot that has none yet."""
        at, found, pick = state
        offset = blocks[at].astype(nominal.dtype) * terrain.resolution
        along = to_heading(offset, rectangle.heading)
        close = jnp.sum(offset**2, axis=-1) <= (reachable.step + 1e-3 * terrain.resolution) ** 2
        cell = start[:, None] + blocks[at][None]
        there = jnp.all((cell >= 0) & (cell < size), axis=-1) & close[None]
        cell = jnp.clip(cell, 0, size - 1)
        good = there & _within(footing[cell[..., 0], cell[..., 1]], level[:, None], reachable)
        best, exists = preferred(preference(along, nearness(along)), good)
        return at + 1, found | exists, jnp.where(found[:, None], pick, offset[best])

    def going(state):
        return (state[0] < blocks.shape[0]) & jnp.any(~state[1])

    _, found, pick = jax.lax.while_loop(going, look, (jnp.zeros((), jnp.int32), ~lost, jnp.zeros_like(nominal)))
    return pick, found & lost
