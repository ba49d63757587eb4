"""Search of a series of states with look-ahead: depth first with backtracking, in fixed memory. Paper C, 3.3.2 (C14).

Each step of the series has a node with numbered candidates in an order of preference. Candidates are tried in that order; the
first that can be reached becomes the step's state and the next step's node is made; where none is left, the step before tries
its next one. A step is settled once `depth` steps, itself included, stand; nothing goes back behind a settled step. So
`depth` 1 never looks ahead and `depth` >= steps is a full search. Settling keeps the branch found so far, which makes the
result that of a fresh search of `depth` steps from every settled state, without its repeated work.

Memory: the series and `depth` nodes, however many candidates are tried (paper C: "only 5 states in the green line").
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jaxleg.numerics import Code


class SearchStatus(Code):
    """Outcome of a search."""

    FOUND = 0
    DEAD_END = 1  # no candidate is left for the first step that is not settled
    BUDGET = 2  # as many candidates tried as allowed
    RUNNING = 3


class Tried(NamedTuple):
    """What trying one candidate showed."""

    reached: Bool[Array, ""]  # whether the state can be reached
    state: Any  # the state, if so
    pruned: Bool[Array, "candidate"]  # candidates of the same node that need not be tried any more
    cause: Int[Array, ""]  # why not, for the records: an index below `CAUSES`


class Nodes(NamedTuple):
    """Callbacks that define the tree; all of one lane, `step` counts from 0."""

    expand: Callable[[Any, Int[Array, ""]], tuple[Any, Int[Array, "candidate"]]]  # (state, step) -> node's data, its order
    attempt: Callable[[Any, Any, Int[Array, ""], Int[Array, ""]], Tried]  # (state, data, step, candidate) -> `Tried`


CAUSES = 11  # most kinds of failure that are told apart


class Series(NamedTuple):
    """A search under way or done. `states[k]` is the state before step k, good up to `states[step]`."""

    states: Any
    choice: Int[Array, "step"]  # candidate of each step
    step: Int[Array, ""]  # to be decided next: with FOUND the number of steps
    settled: Int[Array, ""]
    furthest: Int[Array, ""]  # most steps that ever stood
    visited: Int[Array, ""]  # candidates tried
    causes: Int[Array, "cause"]  # candidates that failed, by cause
    status: Int[Array, ""]  # SearchStatus
    data: Any  # of the last `depth` nodes, step k at k % depth
    order: Int[Array, "depth candidate"]
    place: Int[Array, "depth"]  # in the order, of the candidate to be tried next
    dead: Bool[Array, "depth candidate"]  # pruned


def begin(nodes: Nodes, root: Any, steps: int, depth: int) -> Series:
    """A search that has tried nothing yet. Raises ValueError for a depth below 1."""
    if depth < 1:
        raise ValueError(f"the search's depth is {depth}, but must be at least 1")
    zero = jnp.zeros((), jnp.int32)
    data, order = nodes.expand(root, zero)

    def window(x):
        return jnp.broadcast_to(x, (depth, *jnp.shape(x)))

    return Series(
        states=jax.tree.map(lambda x: jnp.broadcast_to(x, (steps + 1, *jnp.shape(x))), root),
        choice=jnp.zeros(steps, jnp.int32),
        **dict.fromkeys(("step", "settled", "furthest", "visited"), zero),
        causes=jnp.zeros(CAUSES, jnp.int32),
        status=zero + SearchStatus.RUNNING,
        data=jax.tree.map(window, data),
        order=window(order.astype(jnp.int32)),
        place=jnp.zeros(depth, jnp.int32),
        dead=jnp.zeros((depth, order.shape[0]), bool),
    )


def advance(nodes: Nodes, series: Series, count: Int[Array, ""], budget: Int[Array, ""]) -> Series:
    """Try one candidate, or go back one step where none is left. `count` steps are wanted, at most those of `begin`."""
    depth, width = series.order.shape
    slot = series.step % depth
    order, dead, place = series.order[slot], series.dead[slot], series.place[slot]
    open_ = ~dead[order] & (jnp.arange(width, dtype=place.dtype) >= place)
    at = jnp.argmax(open_).astype(jnp.int32)
    candidate, any_left = order[at], open_[at]
    tried = nodes.attempt(_item(series.states, series.step), _item(series.data, slot), series.step, candidate)
    reached = tried.reached & any_left
    failed = any_left & ~tried.reached
    series = series._replace(
        visited=series.visited + any_left.astype(jnp.int32),
        causes=series.causes.at[tried.cause].add(failed.astype(jnp.int32)),
        place=series.place.at[slot].set(at + 1),
        dead=series.dead.at[slot].set(dead | (tried.pruned & any_left)),
    )
    series = _entered(nodes, series, candidate, tried.state, reached)
    back = series.step > series.settled
    step = jnp.where(any_left, series.step, jnp.where(back, series.step - 1, series.step))
    status = jnp.where(~any_left & ~back, SearchStatus.DEAD_END, SearchStatus.RUNNING)
    status = jnp.where((status == SearchStatus.RUNNING) & (series.visited >= budget), SearchStatus.BUDGET, status)
    status = jnp.where(step >= count, SearchStatus.FOUND, status)
    return series._replace(step=step, status=status.astype(jnp.int32))


def search(nodes: Nodes, root: Any, count: Int[Array, ""], steps: int, depth: int, budget: int | Int[Array, ""]) -> Series:
    """The first series of `count` <= `steps` states in the candidates' order, looking `depth` steps ahead.

    `steps` and `depth` are static, `budget` is the most candidates tried. Exact and not differentiable. Raises as `begin`.
    """
    start = begin(nodes, root, steps, depth)
    start = start._replace(status=jnp.where(count <= 0, SearchStatus.FOUND, start.status).astype(jnp.int32))
    budget = jnp.asarray(budget, jnp.int32)
    return jax.lax.while_loop(
        lambda s: s.status == SearchStatus.RUNNING, lambda s: advance(nodes, s, jnp.asarray(count), budget), start
    )


def _entered(nodes: Nodes, series: Series, candidate, state, reached) -> Series:
    """The search with a reached state on its branch and the next step's node made."""
    depth, steps = series.place.shape[0], series.choice.shape[0]
    here = jnp.where(reached, series.step, steps)  # beyond the end: dropped
    step = series.step + reached.astype(jnp.int32)
    data, order = nodes.expand(state, step)
    slot = jnp.where(reached, step % depth, depth)
    return series._replace(
        states=jax.tree.map(lambda x, new: x.at[here + 1].set(new, mode="drop"), series.states, state),
        choice=series.choice.at[here].set(candidate, mode="drop"),
        step=step,
        settled=jnp.maximum(series.settled, step - depth + 1),
        furthest=jnp.maximum(series.furthest, step),
        data=jax.tree.map(lambda x, new: x.at[slot].set(new, mode="drop"), series.data, data),
        order=series.order.at[slot].set(order.astype(jnp.int32), mode="drop"),
        place=series.place.at[slot].set(0, mode="drop"),
        dead=series.dead.at[slot].set(False, mode="drop"),
    )


def _item(tree, index):
    return jax.tree.map(lambda x: x[index], tree)
