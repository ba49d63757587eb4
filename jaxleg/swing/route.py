"""A planned route of the foot: a polyline of fixed size, followed from corner to corner until a contact."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.numerics import norm_safe
from jaxleg.swing.contact import Cells, first_contact
from jaxleg.swing.profile import Profile, bounds_between, height, slope


class Route(NamedTuple):
    """Corners of a polyline; those that are not needed repeat others."""

    corner: Float[Array, "corner 2"]  # x, z
    found: Bool[Array, ""]  # otherwise there is none


class Stop(NamedTuple):
    """Where a foot stopped along a route."""

    point: Float[Array, "2"]
    length: Float[Array, ""]  # up to there
    hit: Bool[Array, ""]
    lost: Bool[Array, ""]
    slope: Float[Array, ""]
    cell: Int[Array, ""]  # between which corners


def route_length(route: Route) -> Float[Array, ""]:
    """Length of a whole route."""
    return jnp.sum(norm_safe(jnp.diff(route.corner, axis=0)))


def follow(route: Route, profile: Profile) -> Stop:
    """Along a route that begins above the terrain to its first contact, certified (see `contact`), or its end."""
    corner, way = route.corner, jnp.diff(route.corner, axis=0)
    _, bent = bounds_between(profile, corner[:-1, 0], corner[1:, 0])
    gap = corner[:, 1] - height(profile, corner[:, 0])
    edge = jnp.arange(corner.shape[0], dtype=corner.dtype)
    bend = jnp.maximum(bent * way[:, 0] ** 2, 1e-6)

    def point(at, cell):
        return corner[cell] + (at - edge[cell]) * way[cell]

    def gap_and_rate(at, cell):
        x, z = point(at, cell)
        return z - height(profile, x), way[cell, 1] - slope(profile, x) * way[cell, 0]

    found = first_contact(Cells(edge, gap, bend, jnp.ones_like(bend, bool)), gap_and_rate)
    end, lengths = point(found.at, found.cell), norm_safe(way)
    before = jnp.sum(jnp.where(edge[:-1] < edge[found.cell], lengths, 0.0))
    length = before + (found.at - edge[found.cell]) * lengths[found.cell]
    return Stop(end, length, found.hit, found.lost, slope(profile, end[0]), found.cell)


def corners_to(route: Route, stop: Stop, count: int) -> Float[Array, "count 2"]:
    """So many points of a route up to where the foot stopped, evenly spaced along it."""
    index = jnp.arange(route.corner.shape[0], dtype=stop.cell.dtype)[:, None]
    corner = jnp.where(index <= stop.cell, route.corner, stop.point)
    along = jnp.concatenate([jnp.zeros(1, corner.dtype), jnp.cumsum(norm_safe(jnp.diff(corner, axis=0)))])
    at = jnp.linspace(0.0, 1.0, count) * along[-1]
    return jnp.stack([jnp.interp(at, along, corner[:, 0]), jnp.interp(at, along, corner[:, 1])], axis=-1)
