"""The search of a series against a plain recursive one on random feasibility tables."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.series.tree import Nodes, SearchStatus, Tried, begin, search

TABLES, STEPS, WIDTH = 1000, 6, 5


def tables(seed):
    """Feasible (step, parent's candidate, candidate), what a failure prunes, and an order for each node."""
    rng = np.random.default_rng(seed)
    share = rng.uniform(0.1, 0.6, (TABLES, 1, 1, 1))
    feasible = rng.random((TABLES, STEPS, WIDTH, WIDTH)) < share
    prunes = rng.random((TABLES, STEPS, WIDTH, WIDTH, WIDTH)) < 0.15
    order = np.argsort(rng.random((TABLES, STEPS + 1, WIDTH, WIDTH)), axis=-1)
    return feasible, prunes, order


def nodes_of(feasible, prunes, order):
    def attempt(state, data, step, candidate):
        reached = feasible[step, state, candidate]
        cause = candidate % 3
        return Tried(reached, candidate, prunes[step, state, candidate] & ~reached, cause)

    return Nodes(lambda state, step: (state, order[step, state]), attempt)


@functools.partial(jax.jit, static_argnums=(3, 4))
def run(feasible, prunes, order, depth, budget):
    def one(*table):
        return search(nodes_of(*table), jnp.zeros((), jnp.int32), jnp.array(STEPS), STEPS, depth, budget)

    return jax.vmap(one)(feasible, prunes, order)


def recursive(table, step, last, parent, seen):
    """The first branch from a node down to `last`, or None; `seen` collects every candidate tried."""
    feasible, prunes, order = table
    if step == last:
        return []
    dead = set()
    for candidate in order[step, parent]:
        if candidate in dead:
            continue
        seen.append((step, parent, candidate))
        if feasible[step, parent, candidate]:
            rest = recursive(table, step + 1, last, candidate, seen)
            if rest is not None:
                return [candidate, *rest]
        else:
            dead |= set(np.flatnonzero(prunes[step, parent, candidate]))
    return None


def receding(table, depth):
    """Settle one step at a time, each after a fresh search of `depth` steps."""
    chosen, parent, seen = [], 0, []
    for step in range(STEPS):
        branch = recursive(table, step, min(step + depth, STEPS), parent, seen)
        if branch is None:
            return chosen, False, seen
        parent = branch[0]
        chosen.append(parent)
    return chosen, True, seen


def test_full_depth_is_the_recursive_search():
    data = tables(0)
    found = jax.tree.map(np.asarray, run(*data, STEPS, 10**6))
    solved = 0
    for lane in range(TABLES):
        seen = []
        branch = recursive([x[lane] for x in data], 0, STEPS, 0, seen)
        assert found.visited[lane] == len(seen)
        assert (found.status[lane] == SearchStatus.FOUND) == (branch is not None)
        if branch is not None:
            solved += 1
            np.testing.assert_array_equal(found.choice[lane], branch)
            np.testing.assert_array_equal(found.states[lane], [0, *branch])
        failed = [c for s, p, c in seen if not data[0][lane, s, p, c]]
        np.testing.assert_array_equal(found.causes[lane, :3], np.bincount(np.array(failed, int) % 3, minlength=3))
    assert 0.2 * TABLES < solved < 0.9 * TABLES  # both outcomes are there to be told apart


@pytest.mark.parametrize("depth", [1, 3])
def test_looking_ahead_is_a_fresh_search_at_every_step(depth):
    data = tables(depth)
    found = jax.tree.map(np.asarray, run(*data, depth, 10**6))
    for lane in range(TABLES):
        chosen, complete, seen = receding([x[lane] for x in data], depth)
        assert (found.status[lane] == SearchStatus.FOUND) == complete
        assert (found.settled[lane] if not complete else STEPS) == len(chosen)
        np.testing.assert_array_equal(found.choice[lane, : len(chosen)], chosen)
        assert found.visited[lane] <= len(seen)


def test_looking_further_ahead_avoids_dead_ends():
    data = tables(5)
    solved = [np.mean(np.asarray(run(*data, depth, 10**6).status) == SearchStatus.FOUND) for depth in (1, 3, STEPS)]
    assert solved[0] < solved[1] < solved[2]


def test_a_spent_budget_has_its_own_status():
    found = jax.tree.map(np.asarray, run(*tables(0), STEPS, 7))
    spent = found.status == SearchStatus.BUDGET
    assert np.any(spent)
    assert np.all(found.visited[spent] == 7)
    assert np.all(found.visited <= 7)


def test_memory_does_not_grow_with_the_candidates_tried():
    """The search is one loop over a carry of fixed size: its compiled memory is the same for any budget."""
    data = tables(0)
    sizes = {budget: run.lower(*data, 3, budget).compile().memory_analysis().temp_size_in_bytes for budget in (10, 10**6)}
    assert len(set(sizes.values())) == 1


def test_no_depth_is_refused():
    data = [jnp.asarray(x[0]) for x in tables(0)]
    with pytest.raises(ValueError, match="depth is 0, but must be at least 1"):
        begin(nodes_of(*data), jnp.zeros((), jnp.int32), STEPS, 0)
