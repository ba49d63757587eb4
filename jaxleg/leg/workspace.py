"""Where under the hip a foot should stand: mean torque over a workspace, and the best workspace of a given size.

Paper A, Section III: a workspace is a rectangle of (L_F2H, H_COG) that a standing leg sweeps. Torques are those of
`statics.leg_torque`; the sums are midpoint rules over cells of the rectangle.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.leg.statics import LegTorque, torque_map
from jaxleg.robot import Robot


class Workspace(NamedTuple):
    """A rectangle of foot places [m]: the foot ahead of the hip (L_F2H) and the hip above the foot (H_COG), from and to."""

    behind: Float[ArrayLike, "*batch"]  # those that do not bind are `UNBOUND`'s
    ahead: Float[ArrayLike, "*batch"]
    low: Float[ArrayLike, "*batch"]
    high: Float[ArrayLike, "*batch"]


UNBOUND = Workspace(-math.inf, math.inf, 0.0, math.inf)  # what stands for bounds that are not given


class Cost(NamedTuple):
    """Two measures of a leg's load; inf where the foot is out of reach."""

    total: Float[Array, "*n"]  # |thigh| + |knee| [N m], as paper A, Fig. 4c
    square: Float[Array, "*n"]  # thigh^2 + knee^2 [N^2 m^2], as the heat of the windings


class Window(NamedTuple):
    """First cell of the best window along both axes, and the mean over it: inf, at cell 0, where none is allowed."""

    x: Int[Array, ""]
    h: Int[Array, ""]
    mean: Float[Array, ""]


@jax.jit
def cost(torque: LegTorque) -> Cost:
    """The two measures at each point of a torque map."""
    total, square = jnp.abs(torque.thigh) + jnp.abs(torque.knee), torque.thigh**2 + torque.knee**2
    return Cost(*(jnp.where(torque.reachable, value, jnp.inf) for value in (total, square)))


def centres(start: Float[ArrayLike, ""], end: Float[ArrayLike, ""], count: int) -> Float[Array, "n"]:
    """Midpoints [m] of `count` equal cells from `start` to `end`."""
    share = (jnp.arange(count, dtype=jnp.result_type(start, end, float)) + 0.5) / count
    return (1.0 - share) * jnp.asarray(start) + share * jnp.asarray(end)


def mean_cost(robot: Robot, workspace: Workspace, force: Float[ArrayLike, ""], cells: tuple[int, int] = (64, 16)) -> Cost:
    """Mean over a workspace under a vertical force [N], by the midpoint rule; inf where a part is out of reach."""
    x = centres(workspace.behind, workspace.ahead, cells[0])
    h = centres(workspace.low, workspace.high, cells[1])
    return Cost(*map(jnp.mean, cost(torque_map(robot, x, h, force))))


@jax.jit
def keeps_bend(
    robot: Robot, x: Float[Array, "nx"], h: Float[Array, "nz"], size: Float[ArrayLike, ""], least_bend: Float[ArrayLike, ""]
) -> Bool[Array, "nx nz"]:
    """Whether the leg keeps `least_bend` [rad] and H_COG >= L2 on the whole of each square cell of `size` [m] round (x, h).

    The knee is least bent at the corner farthest from the hip, by the law of cosines.
    """
    x, h = x[:, None], h[None]
    farthest = jnp.hypot(jnp.abs(x) + 0.5 * size, h + 0.5 * size)
    low = h - 0.5 * size < -robot.link_offset[0, 1, 2] - 1e-6 * size  # the cell that begins at L2 is in, whatever its rounding
    return (farthest <= reach_for_bend(robot.link_offset[0], least_bend)) & ~low


def window_means(values: Float[Array, "nx nz"], cells: tuple[int, int]) -> Float[Array, "mx mz"]:
    """Mean over every window of `cells` cells, at its first cell: a running sum along one axis, then the other."""
    for axis, count in enumerate(cells):
        total = jnp.cumsum(jnp.moveaxis(values, axis, 0), axis=0)
        total = jnp.concatenate([jnp.zeros_like(total[:1]), total])
        values = jnp.moveaxis((total[count:] - total[:-count]) / count, 0, axis)
    return values


def allowed_means(
    values: Float[Array, "nx nz"], allowed: Bool[Array, "nx nz"], cells: tuple[int, int]
) -> Float[Array, "mx mz"]:
    """`window_means` where all cells of a window are allowed, inf elsewhere; what a forbidden cell holds has no effect."""
    forbidden = window_means((~allowed).astype(values.dtype), cells) * (cells[0] * cells[1])
    return jnp.where(forbidden < 0.5, window_means(jnp.where(allowed, values, 0.0), cells), jnp.inf)


def best_window(values: Float[Array, "nx nz"], allowed: Bool[Array, "nx nz"], cells: tuple[int, int]) -> Window:
    """The window of `cells` cells, all of them allowed, with the least mean of `values`."""
    means = allowed_means(values, allowed, cells)
    first = jnp.argmin(means)
    return Window(first // means.shape[1], first % means.shape[1], means.ravel()[first])
