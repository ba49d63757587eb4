"""Many loops of very different length over few lanes: a lane that is done takes the next item of the queue.

`vmap` of a `while_loop` runs every lane for as long as the slowest; here the work is that of the mean.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool


def over_queue(
    begin: Callable[[Any], Any],
    advance: Callable[[Any, Any], Any],
    going: Callable[[Any], Bool[Array, ""]],
    items: Any,
    lanes: int,
) -> Any:
    """The last state of `while going(state): state = advance(item, state)` from `begin(item)`, for every item.

    All functions are of one item; `items` and the result have a leading axis.
    """
    count = jax.tree.leaves(items)[0].shape[0]
    lanes = min(lanes, count)

    def of(index):
        return jax.tree.map(lambda x: x[jnp.minimum(index, count - 1)], items)

    def proceed(carry):
        """Every lane one step on; one that is done writes its result and takes the next item."""
        index, item, state, upcoming, results = carry
        state = _where(jax.vmap(going)(state), jax.vmap(advance)(item, state), state)
        done = ~jax.vmap(going)(state)
        results = jax.tree.map(lambda r, s: r.at[jnp.where(done, index, count)].set(s, mode="drop"), results, state)
        index = jnp.where(done, upcoming + jnp.cumsum(done) - 1, index)
        item, fresh = _where(done, of(index), item), jax.vmap(begin)(of(index))
        return index, item, _where(done, fresh, state), upcoming + jnp.sum(done), results

    index = jnp.arange(lanes)
    state = jax.vmap(begin)(of(index))
    results = jax.tree.map(lambda s: jnp.zeros((count, *s.shape[1:]), s.dtype), state)
    carry = (index, of(index), state, jnp.asarray(lanes, index.dtype), results)
    return jax.lax.while_loop(lambda carry: jnp.any(carry[0] < count), proceed, carry)[-1]


def _where(mask, new, old):
    return jax.tree.map(lambda a, b: jnp.where(mask.reshape(-1, *(1,) * (a.ndim - 1)), a, b), new, old)
