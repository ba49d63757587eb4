"""Certified search for the first contact along a path in cells.

The gap g between path and ground is smooth within a cell and |g''| <= M there, so a cell of width h between gaps a
and b is free if min(a, b) > M h^2 / 8. In the cells left open the search marches: the gap stays above
g + g' h - M h^2 / 2, so a step to that parabola's root never jumps over a contact, and near one it converges as
Newton's method.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

STEPS = 20_000  # of one search; a path that creeps along the ground longer than this comes back as `lost`


class Cells(NamedTuple):
    """A path's cells in order."""

    edge: Float[Array, "edge"]  # of the path's parameter
    gap: Float[Array, "edge"]  # height over the ground there
    bend: Float[Array, "cell"]  # bound on |g''|, positive
    used: Bool[Array, "cell"]  # cells outside of the path are not searched; those used are contiguous


class Contact(NamedTuple):
    """Where the search ended."""

    at: Float[Array, ""]  # the path's parameter; the end of the last used cell without a contact
    cell: Int[Array, ""]
    hit: Bool[Array, ""]
    lost: Bool[Array, ""]  # given up
    steps: Int[Array, ""]


def skin(dtype: jnp.dtype) -> float:
    """How far above the ground a foot that has touched it sets off again; a tenth of it counts as contact."""
    return max(1e-6, 320.0 * float(jnp.finfo(dtype).eps))


def first_contact(cells: Cells, gap_and_rate: Callable[..., tuple[Array, Array]]) -> Contact:
    """First contact along a path that begins above the ground; `gap_and_rate(at, cell)` is g and g' within a cell."""
    count, near = cells.bend.shape[0], 0.1 * skin(cells.edge.dtype)
    width = jnp.diff(cells.edge)
    free = jnp.minimum(cells.gap[:-1], cells.gap[1:]) > cells.bend * width**2 / 8.0 + near
    index = jnp.where(cells.used & ~free, jnp.arange(count, dtype=jnp.int32), count)
    open_from = jnp.append(jax.lax.cummin(index, reverse=True), count)  # first open cell from each one on
    edge, bend = cells.edge, cells.bend

    def going(state):
        _, cell, hit, steps = state
        return ~hit & (cell < count) & (steps < STEPS)

    def advance(state):
        """On to where the ground could be met at the earliest, at most to the cell's end."""
        at, cell, _, steps = state
        gap, rate = gap_and_rate(at, cell)
        ahead = (rate + jnp.sqrt(rate**2 + 2.0 * bend[cell] * jnp.maximum(gap, 0.0))) / bend[cell]
        hit, over = gap <= near, at + ahead >= edge[cell + 1]
        then = jnp.where(over & ~hit, open_from[cell + 1], cell)
        return jnp.where(hit, at, jnp.where(over, edge[then], at + ahead)), then, hit, steps + 1

    begin = open_from[0]
    at, cell, hit, steps = jax.lax.while_loop(going, advance, (edge[begin], begin, jnp.array(False), jnp.zeros((), jnp.int32)))
    last = count - 1 - jnp.argmax(cells.used[::-1]).astype(jnp.int32)
    ended = cell >= count
    touches = ended & (cells.gap[last + 1] <= 20.0 * near)  # a level swing ends where it began
    return Contact(jnp.where(ended, edge[last + 1], at), jnp.where(ended, last, cell), hit | touches, ~hit & ~ended, steps)
