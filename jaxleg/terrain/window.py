"""Windows of cells round each cell of a map, and folds and reductions over them."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

Disc = tuple[tuple[int, int], ...]


def disc(radius: float, resolution: float) -> Disc:
    """Offsets of the cells whose centres lie within `radius` [m]; static."""
    reach = int(radius / resolution + 1e-6)
    cells = np.arange(-reach, reach + 1)
    limit = (radius / resolution + 1e-6) ** 2
    return tuple((int(i), int(j)) for i in cells for j in cells if i * i + j * j <= limit)


def over_disc(values: Shaped[Array, "nx ny"], start: Any, reduce: Callable, window: Disc) -> Shaped[Array, "nx ny"]:
    """An idempotent reduction (or, max) of each cell's disc, which begins with `start` and so ends at the map's border.

    The disc is a union of a few rectangles, each of them two passes, along x and along y.
    """
    parts = []
    for i, j in _corners(window):
        along = jax.lax.reduce_window(values, start, reduce, (2 * i + 1, 1), (1, 1), "SAME")
        parts.append(jax.lax.reduce_window(along, start, reduce, (1, 2 * j + 1), (1, 1), "SAME"))
    return functools.reduce(reduce, parts)


def _corners(window: Disc) -> list[tuple[int, int]]:
    """Corners (i, j >= 0) of the largest rectangles within a disc."""
    widest = {i: max(j for k, j in window if k == i) for i, _ in window if i >= 0}
    return [(i, j) for i, j in widest.items() if j > widest.get(i + 1, -1)]


def median(values: Float[Array, "nx ny"], window: Disc) -> Float[Array, "nx ny"]:
    """The median of the seen cells of each cell's window: it takes out noise and leaves edges. What is unseen stays unseen."""
    reach = max(max(abs(i), abs(j)) for i, j in window)
    padded = jnp.pad(values, reach, constant_values=jnp.nan)
    nx, ny = values.shape
    shifted = jnp.stack([padded[reach + i : reach + i + nx, reach + j : reach + j + ny] for i, j in window])
    return jnp.where(jnp.isnan(values), jnp.nan, jnp.nanmedian(shifted, axis=0))


def fold(
    elevation: Float[Array, "nx ny"],
    window: Disc,
    visit: Callable[[Any, Float[Array, "2"], Float[Array, "nx ny"]], Any],
    start: Any,
) -> Any:
    """`total = visit(total, offset, heights)` for every offset (i, j) [cells] of a static window, from `start` on.

    A loop, so what is compiled does not grow with the window. `heights` holds in each cell what lies at that offset from it,
    NaN beyond the map's border. Reverse mode goes over the offsets once more, so its memory is the totals of each turn, not
    what `visit` made of them.
    """
    reach = max(max(abs(i), abs(j)) for i, j in window)
    padded = jnp.pad(elevation, reach, constant_values=jnp.nan)

    @jax.checkpoint
    def turn(total, offset):
        heights = jax.lax.dynamic_slice(padded, reach + offset, elevation.shape)
        return visit(total, offset.astype(elevation.dtype), heights), None

    return jax.lax.scan(turn, start, jnp.array(window))[0]
