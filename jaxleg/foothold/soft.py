"""The cascade's choice made soft, for gradients: a mean of what it chooses from, weighted by how near each is to being chosen.

The exact cascade takes the best value among what is allowed: a common offset's score (8), one less in the lengthened rectangle
alone, and less than any of these each leg's nearest cell. Soft, whatever is outside of the workspace or out of the legs' reach
loses value by and by, over a length; and the choice is a mean by a softmax, over a temperature of the value. With both near
zero it is the exact choice, where this has no tie.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.foothold.cascade import Cascade, Found, Reachable, look, reachable_heights, rooms
from jaxleg.foothold.contract import Footholds, FootholdStatus, Room, endless
from jaxleg.foothold.rectangle import candidates, feasible_score
from jaxleg.gait.params import GaitParams
from jaxleg.robot import Robot
from jaxleg.terrain.site import Site

APART = -1.5  # value of the four feet each for itself: below any common offset's, -1 to 1


class Softness(NamedTuple):
    """How soft a choice is; annealed towards zero."""

    temperature: Float[ArrayLike, "*batch"]  # of the value, whose range is 1 over the rectangle
    length: Float[ArrayLike, "*batch"]  # over which bounds give way [m]


def soft_stance(
    cascade: Cascade,
    softness: Softness,
    robot: Robot,
    gait: GaitParams,
    site: Site,
    nominal: Float[Array, "leg 2"],
    yaw: Float[Array, ""],
    room: Room = endless,
) -> Footholds:
    """The footholds of a stance that heads by `yaw` [rad]; differentiable in everything but which cells are footholds.

    The status is NOMINAL where common offsets weigh more than the feet each for itself; a leg that finds none anywhere stays at
    its nominal foothold, as in the exact choice.
    """
    apart = cascade.stance(robot, gait, site, nominal, yaw, _none)
    rectangle = dataclasses.replace(cascade.rectangle, heading=yaw)
    seen = candidates(rectangle, site.terrain.resolution, cascade.extent.cells)
    reachable = reachable_heights(robot, gait, cascade.least_bend)
    found = look(nominal, site.valid, site.terrain, seen, reachable, cascade.extent.cells)
    give = jnp.minimum(_reach(found, reachable), rooms(nominal, seen, _known(found.height), room))
    short, long = (feasible_score(seen.along, rectangle, longer) for longer in (0.0, rectangle.longer))
    value = jnp.where(seen.short, short, long - 1.0) + jax.nn.log_sigmoid(give / softness.length)
    footing = seen.long & jnp.all(jnp.isfinite(found.height), axis=0)
    together = jnp.where(footing, value, -jnp.inf).reshape(-1)
    weight = jax.nn.softmax(jnp.append(together, APART) / softness.temperature)
    offset = jnp.sum(weight[:-1, None] * seen.offset.reshape(-1, 2), axis=0)[None] + weight[-1] * apart.offset
    status = jnp.where(weight[-1] < 0.5, FootholdStatus.NOMINAL, apart.status)
    return Footholds(offset, status.astype(jnp.int32))


def _reach(found: Found, reachable: Reachable):
    """How far the lowest or highest of the four cells of each offset is within the legs' reach [m]. Where a leg knows no level
    it sees no foothold, and no common offset has any weight."""
    above = _known(found.height) - _known(found.level)[:, None, None]
    return jnp.min(jnp.minimum(above - reachable.lowest, reachable.highest - above), axis=0)


def _known(height):
    """Heights with 0 for those of no foothold: such an offset has no weight, nor may it have a NaN gradient."""
    return jnp.where(jnp.isfinite(height), height, 0.0)


def _none(feet):
    """No room: each leg for itself."""
    return jnp.full((), -jnp.inf, feet.dtype)
