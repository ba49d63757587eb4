"""Folds over the cells round each cell of a map: a loop over offsets, so what is compiled does not grow with the window."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.terrain.features import Disc


def fold(
    elevation: Float[Array, "nx ny"],
    window: Disc,
    visit: Callable[[Any, Float[Array, "2"], Float[Array, "nx ny"]], Any],
    start: Any,
) -> Any:
    """`total = visit(total, offset, heights)` for every offset (i, j) [cells] of a static window, from `start` on.

    `heights` holds in each cell what lies at that offset from it, NaN beyond the map's border. Reverse mode goes over the
    offsets once more, so its memory is the totals of each turn, not what `visit` made of them.
    """
    reach = max(max(abs(i), abs(j)) for i, j in window)
    padded = jnp.pad(elevation, reach, constant_values=jnp.nan)

    @jax.checkpoint
    def turn(total, offset):
        heights = jax.lax.dynamic_slice(padded, reach + offset, elevation.shape)
        return visit(total, offset.astype(elevation.dtype), heights), None

    return jax.lax.scan(turn, start, jnp.array(window))[0]
