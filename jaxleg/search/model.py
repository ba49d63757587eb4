"""A lane near a vector: its cost as a straight line, its constraints as the least of many.

A plan's constraint is the least of a smooth function over instants, feet and joints (the knee bend of four legs at 240
instants, say). The least has corners, where a gradient says little; the functions it is the least of have none. A `Model`
holds the straight line of each of those that may become the least within `reach`.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.numerics import highest

FREE = 1e6  # what stands in a row that is none


class Model(NamedTuple):
    """One lane, or many (leading axes)."""

    score: Any  # what the lane is judged by, exactly
    cost: Float[Array, "*lane"]  # without penalties
    slope: Float[Array, "*lane parameter"]  # of the cost
    rows: Float[Array, "*lane constraint row"]  # distances to each constraint, in units of its scale
    slopes: Float[Array, "*lane constraint row parameter"]  # of the rows


def linearised(
    parts: Callable[[Array], Any], vector: Float[Array, "parameter"], reach: Float[Array, "parameter"], most: int
) -> Model:
    """The model of a lane's `parts` (score, cost, rows by constraint) where no number moves further than its `reach`, with
    `most` rows of each constraint."""

    def moving(x):
        seen = parts(x)
        return (seen.cost, seen.rows), seen

    (slope, slopes), seen = jax.jacfwd(moving, has_aux=True)(vector)
    kept = [_lowest(rows, turned, reach, most) for rows, turned in zip(seen.rows, slopes)]
    rows, slopes = (jnp.stack(x) for x in zip(*kept))
    return Model(seen.score, seen.cost, slope, rows, slopes)


def _lowest(rows, slopes, reach, most):
    """The row that is lowest, and those of the others that may come lowest within the reach: `most` in all."""
    may_be = rows - jnp.sum(jnp.abs(slopes) * reach[None], axis=1)
    first = jnp.isnan(may_be) | (rows == jnp.min(rows))  # what is no number is kept: such a lane cannot be judged
    worth, index = highest(-jnp.where(first, -jnp.inf, may_be), most)
    free = jnp.isneginf(worth) | jnp.isposinf(rows[index])
    return jnp.where(free, FREE, rows[index]), jnp.where(free[:, None], 0.0, slopes[index])
