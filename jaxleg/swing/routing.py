"""Routes over a believed ground: potential field as printed, field repaired, taut string. Paper B, III.C.

Each is a function of a `View`; fixed sizes, so `vmap` them. A route lifts off and touches down straight; between, it keeps
the clearance from the map. A route is never one through the believed ground: then there is none.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.numerics import norm_safe
from jaxleg.swing.route import Route

WINDOW = 12  # points of the map to either side that count for its clearance
DESCENT, STRIDE = 400, 0.05  # steps of the field as printed and their length
FLOOR = 1e-3  # least distance in the repulsive potential: below it, and inside an obstacle, it goes on linearly


class View(NamedTuple):
    """The map as seen from where a route begins. Points up to `first` lie behind; `first` itself stands for the beginning."""

    x: Float[Array, "point"]
    ground: Float[Array, "point"]  # believed
    block: Float[Array, "3"]  # left, right and top of the preset obstacle
    wide: Float[Array, "point"]  # ground and block widened by the clearance, at most z+
    first: Int[Array, ""]
    begin: Float[Array, "2"]
    cost: Float[Array, "point"]  # of landing there besides the way; infinite where the foot cannot
    wanted: Float[Array, ""]  # x_e
    press: Float[Array, ""]  # a route ends this far below the ground, to feel it
    field: Float[Array, "3"]  # zeta, eta, d0


def taut_string(view: View) -> Route:
    """The shortest route to the landing that is cheapest to get to: over a height field, the least concave curve above it.

    A hull's edge into a point comes from the point to which its slope is least, so one pass has the lengths to all landings.
    """
    parent, length = _hull(view)
    can = jnp.isfinite(view.cost)
    cost = jnp.where(can, length + (view.wide - view.ground) + view.cost, jnp.inf)
    landing = jnp.argmin(cost)
    corner = _between(view, _marked(view, parent, landing))
    return _route(view, corner, landing, jnp.isfinite(cost[landing]))


def field_repaired(view: View) -> Route:
    """The field in the limit of a stiff repulsion, sliding up the widened ground where it would stop: no local minima."""
    landing = _nearest(view)

    def move(z, i):
        on = (i > view.first) & (i <= landing)
        share = (view.x[i] - view.x[i - 1]) / jnp.where(on, view.x[landing] - view.x[i - 1], 1.0)
        z = jnp.where(on, jnp.maximum(view.wide[i], z + share * (view.wide[landing] - z)), z)
        return z, z

    index = jnp.arange(view.x.shape[0])
    _, z = jax.lax.scan(move, view.wide[view.first], index)
    return _route(view, jnp.where(index == view.first, view.wide[view.first], z), landing, _reached(view, landing))


def field_as_printed(view: View) -> Route:
    """Descent of U = U_att + U_rep (B, (11), (12)) by steps of one length; no route where it stops short of the landing."""
    landing = _nearest(view)
    goal = jnp.stack([view.x[landing], view.ground[landing]])
    near = view.field[2] + STRIDE

    def move(point, _):
        down = jax.grad(lambda p: potential(view, p, goal))(point)
        moved = point - STRIDE * down / jnp.maximum(norm_safe(down), 1e-12)
        point = jnp.where(norm_safe(point - goal) > near, moved, point)
        return point, point

    end, way = jax.lax.scan(move, view.begin, length=DESCENT)
    middle = 0.5 * (way[1:] + way[:-1])
    seen = jnp.concatenate([way, middle])
    clear = jnp.all(seen[:, 1] >= jnp.interp(seen[:, 0], view.x, view.ground) + FLOOR)
    corner = jnp.concatenate([view.begin[None], way, (goal - jnp.stack([0.0 * view.press, view.press]))[None]])
    return Route(corner, clear & (norm_safe(end - goal) <= near) & jnp.isfinite(view.cost[landing]))


def potential(view: View, point: Float[Array, "2"], goal: Float[Array, "2"]) -> Float[Array, ""]:
    """U at a point: (11) plus (12) with the distance to the nearest obstacle, negative inside; finite everywhere, and its
    gradient points out of an obstacle."""
    attraction, repulsion, threshold = view.field
    distance = clearance_of(view, point)
    held = jnp.clip(distance, FLOOR, threshold)
    steep = repulsion / FLOOR**2 * jnp.maximum(FLOOR - distance, 0.0)
    return attraction * jnp.sum((point - goal) ** 2) + repulsion * (1.0 / held - 1.0 / threshold) + steep


def clearance_of(view: View, point: Float[Array, "2"]) -> Float[Array, ""]:
    """Distance to the points of the map nearby and to the preset obstacle, negative within one of them."""
    spacing = view.x[-1] - view.x[-2]  # `first` alone stands off the grid
    index = jnp.floor((jax.lax.stop_gradient(point[0]) - view.x[0]) / spacing).astype(jnp.int32) - WINDOW
    index = jnp.clip(index, 0, view.x.shape[0] - 2 * WINDOW - 2)
    corner = jax.lax.dynamic_slice_in_dim(jnp.stack([view.x, view.ground], -1), index, 2 * WINDOW + 2)
    start, way = corner[:-1], jnp.diff(corner, axis=0)
    share = jnp.clip(jnp.sum((point[None] - start) * way, -1) / jnp.sum(way**2, -1), 0.0, 1.0)
    distance = jnp.min(norm_safe(point[None] - start - share[:, None] * way))
    ground = jnp.where(point[1] >= jnp.interp(point[0], corner[:, 0], corner[:, 1]), distance, -distance)
    return jnp.minimum(ground, _from_block(view.block, point))


def _from_block(block, point):
    left, right, top = jnp.where(jnp.isfinite(block), block, jnp.array([-1e6, -1e6, -1e6], block.dtype))
    beyond = jnp.stack([jnp.maximum(left - point[0], point[0] - right), point[1] - top])
    return norm_safe(jnp.maximum(beyond, 0.0)) + jnp.minimum(jnp.max(beyond), 0.0)


def _hull(view):
    """Each point's predecessor on the least concave curve from the beginning, and the way along it."""
    count, z = view.x.shape[0], view.wide
    index = jnp.arange(count)
    inverse = _inverse_runs(count, z.dtype) / (view.x[-1] - view.x[-2])  # `first` alone stands off the grid
    before = (index[:, None] > view.first) & (inverse > 0.0)
    steep = jnp.where(before, (z[None, :] - z[:, None]) * inverse, jnp.inf)
    begin = (z - z[view.first]) / jnp.where(index > view.first, view.x - view.x[view.first], 1.0)
    least = jnp.min(steep, axis=0)
    nearest = jnp.max(jnp.where(steep == least[None], index[:, None], 0), axis=0)  # argmin is several times slower here
    parent = jnp.where(least < begin, nearest, view.first)
    edge = jnp.hypot(view.x - view.x[parent], z - z[parent])

    def add(length, i):
        return length.at[i].set(jnp.where(i > view.first, length[parent[i]] + edge[i], 0.0)), None

    return parent, jax.lax.scan(add, jnp.zeros_like(z), index)[0]


def _inverse_runs(count: int, dtype) -> Array:
    """1 / (j - i) for the points i before j, 0 elsewhere."""
    run = np.arange(count)[None, :] - np.arange(count)[:, None]
    return jnp.asarray(np.where(run > 0, 1.0 / np.maximum(run, 1), 0.0), dtype)


def _marked(view, parent, landing):
    """Which points are corners of the least concave curve to a landing."""

    def back(at, i):
        here = i == at
        return jnp.where(here & (i > view.first), parent[i], at), here

    index = jnp.arange(view.x.shape[0])
    return jax.lax.scan(back, landing, index, reverse=True)[1]


def _between(view, marked):
    """Heights along the straight lines between marked points."""
    index = jnp.arange(view.x.shape[0])
    before = jnp.maximum(jax.lax.cummax(jnp.where(marked, index, -1)), 0)
    after = jnp.minimum(jax.lax.cummin(jnp.where(marked, index, index.shape[0]), reverse=True), index.shape[0] - 1)
    run = view.x[after] - view.x[before]
    share = (view.x - view.x[before]) / jnp.where(run > 0.0, run, 1.0)
    return view.wide[before] + jnp.where(run > 0.0, share, 0.0) * (view.wide[after] - view.wide[before])


def _nearest(view):
    """The possible landing nearest to x_e."""
    return jnp.argmin(jnp.where(jnp.isfinite(view.cost), jnp.abs(view.x - view.wanted), jnp.inf))


def _reached(view, landing):
    return jnp.isfinite(view.cost[landing])


def _route(view, z, landing, found):
    """Straight up, along the heights z from `first` to the landing, straight down."""
    index = jnp.clip(jnp.arange(view.x.shape[0]), view.first, jnp.maximum(landing, view.first))
    along = jnp.stack([view.x[index], z[index]], axis=-1)
    down = jnp.stack([view.x[landing], view.ground[landing] - view.press])
    return Route(jnp.concatenate([view.begin[None], along, down[None]]), found)
