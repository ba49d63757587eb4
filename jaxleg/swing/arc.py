"""Pieces of a compound cycloid as paths, and where they first touch a terrain profile. Paper B, (2)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.swing.contact import Cells, first_contact
from jaxleg.swing.cycloid import cycloid_advance, cycloid_lift
from jaxleg.swing.profile import Profile, bounds_between, height, slope

CELLS = 32  # of a whole period, for the search for contacts; a multiple of 4, see `_greatest`
NODE, WEIGHT = np.polynomial.legendre.leggauss(10)  # of the arc length, in each half of the period


class Arc(NamedTuple):
    """The piece of a compound cycloid between two shares of its period; it begins at `start`."""

    start: Float[Array, "*batch 2"]  # x, z
    stride: Float[Array, "*batch"]  # S of the whole cycloid
    rise: Float[Array, "*batch"]  # H
    begin: Float[Array, "*batch"]  # 0, or 1/2 for a second half
    end: Float[Array, "*batch"]  # 1, or 1/2 for a first half


class Touch(NamedTuple):
    """Where a foot stopped along an arc."""

    share: Float[Array, ""]  # of the period
    point: Float[Array, "2"]
    hit: Bool[Array, ""]  # by contact; otherwise at the arc's end
    lost: Bool[Array, ""]  # the search was given up
    slope: Float[Array, ""]  # of the terrain there
    steps: Int[Array, ""]


def point_at(arc: Arc, share: Float[ArrayLike, "*n"]) -> Float[Array, "*n 2"]:
    """Point (x, z) of an arc at a share of the period between its begin and end."""
    x = arc.start[0] + arc.stride * (cycloid_advance(share) - cycloid_advance(arc.begin))
    z = arc.start[1] + arc.rise * (cycloid_lift(share) - cycloid_lift(arc.begin))
    return jnp.stack([x, z], axis=-1)


def length_to(arc: Arc, share: Float[ArrayLike, ""]) -> Float[Array, ""]:
    """Length of the arc's path from its begin to a share of the period: Gauss-Legendre in either half, smooth in each."""
    middle = jnp.clip(0.5, arc.begin, jnp.maximum(share, arc.begin))
    return _length_between(arc, arc.begin, middle) + _length_between(arc, middle, share)


def _length_between(arc, low, high):
    half = 0.5 * (high - low)
    x_rate, z_rate = rates(arc, low + half * (1.0 + jnp.asarray(NODE, arc.start.dtype)))
    squared = x_rate**2 + z_rate**2
    speed = jnp.where(squared > 0.0, jnp.sqrt(jnp.where(squared > 0.0, squared, 1.0)), 0.0)
    return half * jnp.sum(jnp.asarray(WEIGHT, arc.start.dtype) * speed)


def period(arc: Arc) -> Float[Array, ""]:
    """Time of the whole cycloid at a peak speed of 1 (paper B gives none): the greatest |dp| by the share, in either half.

    With c = cos(2 pi s) the square of the speed is S^2 (1 - c)^2 + pi^2 H^2 (1 - c^2): greatest in mid-swing or at its vertex.
    """
    across, up = arc.stride**2, (jnp.pi * arc.rise) ** 2
    bows = up > 2.0 * across
    return jnp.where(bows, up / jnp.sqrt(jnp.where(bows, up - across, 1.0)), 2.0 * jnp.abs(arc.stride))


def velocity_at(arc: Arc, share: Float[ArrayLike, ""]) -> Float[Array, "2"]:
    """Velocity at a share of the period, at a peak speed of 1; zero for an arc of no length."""
    whole = period(arc)
    return jnp.stack(rates(arc, share)) / jnp.where(whole > 0.0, whole, 1.0)


def first_touch(arc: Arc, profile: Profile) -> Touch:
    """The first contact along an arc that begins above the terrain, or the arc's end; certified, see `contact`."""

    def gap_and_rate(share, _):
        point = point_at(arc, share)
        x_rate, z_rate = rates(arc, share)
        return point[1] - height(profile, point[0]), z_rate - slope(profile, point[0]) * x_rate

    found = first_contact(_cells(arc, profile), gap_and_rate)
    point = point_at(arc, found.at)
    return Touch(found.at, point, found.hit, found.lost, slope(profile, point[0]), found.steps)


def rates(arc: Arc, share: Float[ArrayLike, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """dx/ds and dz/ds of (2), s the share of the period."""
    turn = 2.0 * jnp.pi * share
    return arc.stride * (1.0 - jnp.cos(turn)), arc.rise * jnp.pi * jnp.sin(turn)


def _cells(arc: Arc, profile: Profile) -> Cells:
    """Equal shares of the whole period, with bounds on g'' = z'' - T'' x'^2 - T' x'' in each; their cycloid is constant."""
    dtype, edge = arc.start.dtype, np.arange(CELLS + 1) / CELLS
    turn = 2.0 * np.pi * edge
    advance, lift = edge - np.sin(turn) / (2.0 * np.pi), 0.5 - 0.5 * np.cos(turn)
    x = arc.start[0] + arc.stride * (jnp.asarray(advance, dtype) - cycloid_advance(arc.begin))
    z = arc.start[1] + arc.rise * (jnp.asarray(lift, dtype) - cycloid_lift(arc.begin))
    steep, bent = bounds_between(profile, x[:-1], x[1:])
    x_rate, x_bend, z_bend = (jnp.asarray(c, dtype) for c in _greatest(turn))
    bend = jnp.abs(arc.rise) * z_bend + bent * (arc.stride * x_rate) ** 2 + steep * jnp.abs(arc.stride) * x_bend
    share = jnp.asarray(edge, dtype)
    used = (share[:-1] >= arc.begin) & (share[1:] <= arc.end)
    return Cells(share, z - height(profile, x), jnp.maximum(bend, 1e-6), used)


def _greatest(turn):
    """Greatest 1 - cos, 2 pi |sin| and 2 pi^2 |cos| in each cell: monotone, or with a turn at an edge (CELLS % 4 = 0)."""
    values = (1.0 - np.cos(turn), 2.0 * np.pi * np.abs(np.sin(turn)), 2.0 * np.pi**2 * np.abs(np.cos(turn)))
    return [np.maximum(v[:-1], v[1:]) for v in values]
