"""Stations of a route: where the stance is to stand in each half cycle, and how it turns. Paper A, IV.A; C, 3.1 (C10b).

The path's text has no rule for turning. Reading: the stance turns about its centre by a bounded angle a half cycle towards
the path's direction, and goes on along the path only as far as the turn leaves of a foot's stride; where the path turns more
sharply than that, the robot moves sideways for a while (crabs).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxleg.gait.params import GaitParams
from jaxleg.numerics import norm_safe
from jaxleg.pytree import pytree
from jaxleg.rotations import turned


class Line(NamedTuple):
    """A smoothed path at equal spacing, good up to `length`; beyond it its end goes on."""

    xy: Float[Array, "sample 2"]  # in W [m]
    direction: Float[Array, "sample"]  # of travel, without jumps by a full turn [rad]
    spacing: Float[Array, ""]  # [m]
    length: Float[Array, ""]  # [m]


class Stations(NamedTuple):
    """The stance's centre and yaw before each half cycle; the last ones repeat the path's end."""

    xy: Float[Array, "station 2"]  # in W [m]
    yaw: Float[Array, "station"]  # [rad]
    count: Int[Array, ""]  # half cycles until the stance has arrived


def smoothed(
    points: Float[Array, "point 2"], length: Int[Array, ""], spacing: Float[Array, ""], window: Float[Array, ""], samples: int
) -> Line:
    """A path's points (the first `length` are good) [m], averaged over a sliding window [m] and resampled at equal spacing.

    The window shrinks towards both ends, which stay where they are. Direction: from the path half a window behind to half a
    window ahead.
    """
    last = length - 1
    points = jnp.where((jnp.arange(points.shape[0], dtype=last.dtype) <= last)[:, None], points, points[last])
    steps = norm_safe(jnp.diff(points, axis=0))
    along = jnp.concatenate([jnp.zeros(1, points.dtype), jnp.cumsum(steps)])
    total = along[-1]
    way = jnp.minimum(spacing * jnp.arange(samples, dtype=spacing.dtype), total)
    half = jnp.minimum(0.5 * window, jnp.minimum(way, total - way))
    nodes = jnp.linspace(-1.0, 1.0, 9, dtype=points.dtype)
    at = way[:, None] + half[:, None] * nodes[None]
    xy = jnp.mean(_along(points, along, at), axis=1)
    reach = jnp.maximum(0.5 * window, spacing)
    chord = _along(points, along, jnp.minimum(way + reach, total)) - _along(points, along, jnp.maximum(way - reach, 0.0))
    return Line(xy, jnp.unwrap(jnp.arctan2(chord[:, 1], chord[:, 0])), spacing, total)


def _along(points, along, at):
    """Points of the polyline at ways along it."""
    return jnp.stack([jnp.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=-1)


@pytree
class Straight:
    """The straight route along a heading: a stance that goes on by half a step a half cycle. Paper A, IV.A."""

    heading: Float[Array, "*batch"]  # [rad]

    def stations(self, gait: GaitParams, line: Line | None, count: int) -> Stations:
        """`count` stations; the stance that the walk begins in, its right feet at the first station and its left ones at the
        second, is centred on the origin."""
        del line
        ahead = (0.5 * jnp.arange(count, dtype=gait.step_length.dtype) - 0.25) * gait.step_length
        xy = turned(jnp.stack([ahead, jnp.zeros_like(ahead)], axis=-1), self.heading)
        return Stations(xy, jnp.full(count, self.heading), jnp.asarray(count, jnp.int32))


@pytree
class Along:
    """The route along a body path."""

    turn: Float[Array, "*batch"]  # most that the stance turns in a cycle [rad]

    def stations(self, gait: GaitParams, line: Line, count: int) -> Stations:
        """`count` stations from the line's start, where the stance stands along it."""
        step, turn = 0.5 * gait.step_length, 0.5 * self.turn
        radius = 0.5 * jnp.hypot(gait.stance_length, gait.stance_width)  # what a turn costs a foot of its stride

        def onward(carry, _):
            """Half a cycle further along the line, less what the turn takes of the feet's way."""
            way, yaw = carry
            ahead = _at(line, jnp.minimum(way + step, line.length))
            wanted = jnp.arctan2(jnp.sin(ahead[2] - yaw), jnp.cos(ahead[2] - yaw))
            turned_by = jnp.clip(wanted, -turn, turn)
            left = jnp.maximum(step - radius * jnp.abs(turned_by), 0.25 * step)
            return (jnp.minimum(way + left, line.length), yaw + turned_by), (way, yaw)

        yaw = line.direction[0]
        way, yaws = jax.lax.scan(onward, (jnp.zeros_like(yaw), yaw), length=count)[1]
        arrived = jnp.sum(way < line.length - 1e-6)
        return Stations(jax.vmap(_at, in_axes=(None, 0))(line, way)[:, :2], yaws, arrived.astype(jnp.int32))


def _at(route: Line, way):
    """(x, y, direction) of the route at a way along it."""
    place = way / route.spacing
    low = jnp.clip(place.astype(jnp.int32), 0, route.direction.shape[0] - 2)
    rows = jnp.concatenate([route.xy, route.direction[:, None]], axis=1)
    share = jnp.clip(place - low.astype(place.dtype), 0.0, 1.0)
    return rows[low] * (1.0 - share) + rows[low + 1] * share
