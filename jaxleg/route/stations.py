"""Stations along a body path: where the stance is to stand in each half cycle, and how it turns. Paper C, 3.1 (C10b).

The path's text has no rule for turning. Reading: the stance turns about its centre by a bounded angle a half cycle towards
the path's direction, and goes on along the path only as far as the turn leaves of a foot's stride; where the path turns more
sharply than that, the robot moves sideways for a while (crabs).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


class Route(NamedTuple):
    """A smoothed path at equal spacing, good up to `length`; beyond it its end goes on."""

    xy: Float[Array, "sample 2"]  # in W [m]
    direction: Float[Array, "sample"]  # of travel, without jumps by a full turn [rad]
    spacing: Float[Array, ""]  # [m]
    length: Float[Array, ""]  # [m]


class Stride(NamedTuple):
    """How far the stance moves and turns."""

    step_length: Float[Array, ""]  # L_Step: a foot's way relative to the trunk in a cycle [m]
    turn: Float[Array, ""]  # most in a cycle [rad]
    foot_radius: Float[Array, ""]  # from the stance's centre to a foot: what a turn costs of the stride [m]


class Stations(NamedTuple):
    """The stance's centre and yaw before each half cycle; the last ones repeat the path's end."""

    xy: Float[Array, "station 2"]  # in W [m]
    yaw: Float[Array, "station"]  # [rad]
    count: Int[Array, ""]  # half cycles until the stance has arrived


def smooth_route(
    points: Float[Array, "point 2"], length: Int[Array, ""], spacing: Float[Array, ""], window: Float[Array, ""], samples: int
) -> Route:
    """A path's points (the first `length` are good) [m], averaged over a sliding window [m] and resampled at equal spacing.

    The window shrinks towards both ends, which stay where they are. Direction: from the path half a window behind to half a
    window ahead.
    """
    last = length - 1
    points = jnp.where((jnp.arange(points.shape[0], dtype=last.dtype) <= last)[:, None], points, points[last])
    steps = jnp.linalg.norm(jnp.diff(points, axis=0), axis=1)
    along = jnp.concatenate([jnp.zeros(1, points.dtype), jnp.cumsum(steps)])
    total = along[-1]
    way = jnp.minimum(spacing * jnp.arange(samples, dtype=spacing.dtype), total)
    half = jnp.minimum(0.5 * window, jnp.minimum(way, total - way))
    nodes = jnp.linspace(-1.0, 1.0, 9, dtype=points.dtype)
    at = way[:, None] + half[:, None] * nodes[None]
    xy = jnp.mean(_along(points, along, at), axis=1)
    reach = jnp.maximum(0.5 * window, spacing)
    chord = _along(points, along, jnp.minimum(way + reach, total)) - _along(points, along, jnp.maximum(way - reach, 0.0))
    return Route(xy, jnp.unwrap(jnp.arctan2(chord[:, 1], chord[:, 0])), spacing, total)


def _along(points, along, at):
    """Points of the polyline at ways along it."""
    return jnp.stack([jnp.interp(at, along, points[:, axis]) for axis in (0, 1)], axis=-1)


def stations(route: Route, stride: Stride, yaw: Float[Array, ""], count: int) -> Stations:
    """`count` stations from the route's start, where the stance stands at `yaw` [rad]."""
    step, turn = 0.5 * stride.step_length, 0.5 * stride.turn

    def onward(carry, _):
        """Half a cycle further along the route, less what the turn takes of the feet's way."""
        way, yaw = carry
        ahead = _at(route, jnp.minimum(way + step, route.length))
        wanted = jnp.arctan2(jnp.sin(ahead[2] - yaw), jnp.cos(ahead[2] - yaw))
        turned = jnp.clip(wanted, -turn, turn)
        left = jnp.maximum(step - stride.foot_radius * jnp.abs(turned), 0.25 * step)
        after = (jnp.minimum(way + left, route.length), yaw + turned)
        return after, (way, yaw)

    start = (jnp.zeros_like(yaw), yaw)
    way, yaws = jax.lax.scan(onward, start, length=count)[1]
    arrived = jnp.sum(way < route.length - 1e-6)
    return Stations(jax.vmap(_at, in_axes=(None, 0))(route, way)[:, :2], yaws, arrived.astype(jnp.int32))


def _at(route: Route, way):
    """(x, y, direction) of the route at a way along it."""
    place = way / route.spacing
    low = jnp.clip(place.astype(jnp.int32), 0, route.direction.shape[0] - 2)
    rows = jnp.concatenate([route.xy, route.direction[:, None]], axis=1)
    share = jnp.clip(place - low.astype(place.dtype), 0.0, 1.0)
    return rows[low] * (1.0 - share) + rows[low + 1] * share
