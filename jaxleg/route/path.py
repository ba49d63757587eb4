"""Body path over a cost map whose costs depend on the heading of travel. Paper C, 2.3, equations (16)-(20) (C8, C9).

A move from cell i to one of its eight neighbours j costs mu_1 |i j| + mu_2 c(j, heading of the move): the way in metres, and
the cost of the cell that is entered (reading: (16) is the cost of the body's centre crossing a cell in a direction). The
printed A* with the heuristic mu_1 |i goal| finds the cheapest path for one goal and start. Here the cost to go is worked out
for all cells, which gives the same path and is a program of a fixed shape:

    V(i) = min_h w_h(i) + V(i + step_h),  V(goal) = 0,

by sweeps over the map in four directions until nothing changes. A sweep carries a value along any path whose moves all go
its way, so the number of rounds is that of a path's turns, not its length. One map; `vmap` outside.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.conventions import HEADINGS
from jaxleg.status import Status


class PathWeights(NamedTuple):
    """mu_1 of the way [per m] and mu_2 of the cost; they sum to 1. A larger mu_2 takes longer ways over cheaper ground. (17)"""

    distance: Float[Array, ""]
    cost: Float[Array, ""]


class BodyPath(NamedTuple):
    """A path over cells, start and goal included."""

    cells: Int[Array, "cell 2"]  # the first `length` count, the goal is repeated
    heading: Int[Array, "cell"]  # of the move that leaves a cell, in the order of `HEADINGS`
    length: Int[Array, ""]  # number of cells
    cost: Float[Array, ""]  # infinite without a path
    status: Int[Array, ""]  # Status


def move_costs(
    cost: Float[Array, "heading nx ny"], weights: PathWeights, resolution: Float[Array, "2"]
) -> Float[Array, "heading nx ny"]:
    """Cost of leaving each cell under each heading; infinite off the map and into blocked cells. Paper C, (17), (18).

    `cost` is infinite where blocked (or NaN, unknown), else not negative; `resolution` is the size of a cell along x and y [m].
    """
    steps = jnp.asarray(HEADINGS, resolution.dtype) * resolution[None]
    way = jnp.sqrt(jnp.sum(steps**2, axis=1))
    entered = jnp.stack([_moved(c, step, jnp.inf) for c, step in zip(cost, HEADINGS)])
    closed = ~jnp.isfinite(entered)
    moves = weights.distance * way[:, None, None] + weights.cost * jnp.where(closed, 0.0, entered)  # 0 inf has no gradient
    return jnp.where(closed, jnp.inf, moves)


def heuristic(
    shape: tuple[int, int], goal: Int[Array, "2"], weights: PathWeights, resolution: Float[Array, "2"]
) -> Float[Array, "nx ny"]:
    """mu_1 times the straight way from each cell to the goal: never more than the cost to go. Paper C, (19), (20)."""
    i, j = ((jnp.arange(n, dtype=goal.dtype) - g).astype(resolution.dtype) for n, g in zip(shape, goal))
    return weights.distance * jnp.hypot(i[:, None] * resolution[0], j[None, :] * resolution[1])


@jax.custom_vjp
def cost_to_go(moves: Float[Array, "heading nx ny"], goal: Int[Array, "2"]) -> Float[Array, "nx ny"]:
    """Cost of the cheapest path from every cell to the goal, infinite where there is none; exact for any `move_costs`.

    Its gradient with respect to a move's cost is how many of the paths asked for use that move: for the value at one cell the
    path's own moves, 1 each (one of them, where several paths are equally cheap).
    """
    return _sweeps(moves, goal)


@jax.custom_batching.custom_vmap
def _sweeps(moves, goal):
    return _sweeps_of_lanes(moves[..., None], goal[None])[..., 0]


@_sweeps.def_vmap
def _sweeps_batched(size, batched, moves, goal):
    """With the lanes' axis last a row of many maps is one long vector: twice as fast as with it first."""
    moves = jnp.moveaxis(moves, 0, -1) if batched[0] else jnp.broadcast_to(moves[..., None], (*moves.shape, size))
    goal = goal if batched[1] else jnp.broadcast_to(goal, (size, 2))
    return jnp.moveaxis(_sweeps_of_lanes(moves, goal), -1, 0), True


def _sweeps_of_lanes(moves: Float[Array, "heading nx ny lane"], goal: Int[Array, "lane 2"]) -> Float[Array, "nx ny lane"]:
    """`cost_to_go` of many maps."""
    at = (*goal.T, jnp.arange(goal.shape[0]))
    start = jnp.full(moves.shape[1:], jnp.inf, moves.dtype).at[at].set(0.0)
    ways = [(axis, sign) for axis in (0, 1) for sign in (1, -1)]
    along = [[h for h, step in enumerate(HEADINGS) if step[axis] == sign] for axis, sign in ways]
    # the moves of each direction of travel with the swept axis first, once and for all: else every round gathers them anew
    costs = [jnp.stack([jnp.swapaxes(moves[h], 0, axis) for h in hs], axis=1) for (axis, _), hs in zip(ways, along)]
    costs = jax.lax.optimization_barrier(costs)

    def again(carry):
        value = carry[0]
        for (axis, sign), hs, cost in zip(ways, along, costs):
            swept = _sweep(jnp.swapaxes(value, 0, axis), cost, [HEADINGS[h][1 - axis] for h in hs], sign)
            value = jnp.swapaxes(swept, 0, axis)
        return value, jnp.any(value < carry[0])

    return jax.lax.while_loop(lambda carry: carry[1], again, (start, jnp.array(True)))[0]


def _sweep(value, costs, aside, sign):
    """Row after row against the direction of travel: the least of what a row has and of moving on to the row before it."""

    def row(ahead, inputs):
        """One row, from the values of the row ahead of it."""
        best, cost = inputs
        border = jnp.full((1, ahead.shape[1]), jnp.inf, ahead.dtype)
        padded = jnp.concatenate([border, ahead, border])
        for k, a in enumerate(aside):
            onward = cost[k] + padded[1 + a : 1 + a + ahead.shape[0]]
            best = jnp.where(onward < best, onward, best)  # a minimum that looks out for NaN is slower
        return best, best

    nothing = jnp.full(value.shape[1:], jnp.inf, value.dtype)
    # not unrolled: XLA would fuse rows and work out each again for every use
    return jax.lax.scan(row, nothing, (value, costs), reverse=sign > 0)[1]


def onward_costs(moves: Float[Array, "heading nx ny"], value: Float[Array, "nx ny"]) -> Float[Array, "heading nx ny"]:
    """w_h(i) + V(i + step_h): cost of going on under each heading."""
    return moves + jnp.stack([_moved(value, step, jnp.inf) for step in HEADINGS])


def _moved(values, step, beyond):
    """The map moved so that cell i holds what lies one step on from it."""
    padded = jnp.pad(values, 1, constant_values=beyond)
    nx, ny = values.shape
    return padded[1 + step[0] : 1 + step[0] + nx, 1 + step[1] : 1 + step[1] + ny]


def find_path(
    cost: Float[Array, "heading nx ny"],
    start: Int[Array, "2"],
    goal: Int[Array, "2"],
    weights: PathWeights,
    resolution: Float[Array, "2"],
    longest: int,
) -> BodyPath:
    """The cheapest path between two cells, of at most `longest` cells (static). Paper C, 2.3. Exact; no exceptions.

    A start or goal off the map counts as blocked.
    """
    shape = jnp.array(cost.shape[1:], jnp.int32)
    blocked = [jnp.any((c < 0) | (c >= shape)) for c in (start, goal)]
    start, goal = (jnp.clip(c, 0, shape - 1) for c in (start, goal))
    open_ = jnp.any(jnp.isfinite(cost), axis=0)
    blocked = [b | ~open_[tuple(c)] for b, c in zip(blocked, (start, goal))]
    moves = move_costs(cost, weights, resolution)
    value = cost_to_go(moves, goal)
    best = jnp.argmin(onward_costs(moves, value), axis=0).astype(jnp.int32)
    total = jnp.where(blocked[0] | blocked[1], jnp.inf, value[tuple(start)])
    steps = jnp.array(HEADINGS, jnp.int32)

    def walk(cell, _):
        heading, there = best[tuple(cell)], jnp.all(cell == goal)
        return jnp.where(there, cell, jnp.clip(cell + steps[heading], 0, shape - 1)), (cell, heading)

    _, (cells, heading) = jax.lax.scan(walk, jnp.where(jnp.isfinite(total), start, goal), length=longest)
    there = jnp.all(cells == goal[None], axis=1)
    status = jnp.where(there[-1], Status.OK, Status.TOO_LONG)
    status = jnp.where(jnp.isfinite(total), status, Status.NO_PATH)
    status = jnp.where(blocked[1], Status.GOAL_BLOCKED, status)
    status = jnp.where(blocked[0], Status.START_BLOCKED, status)
    length = jnp.where(status == Status.OK, jnp.argmax(there) + 1, 0)
    return BodyPath(cells, heading, length.astype(jnp.int32), total, status.astype(jnp.int32))


# Gradients: dV(i)/dw is a flow from i along the best (or soft-best) moves to the goal, pushed on until it is there.


def _flow(policy: Float[Array, "heading nx ny"], source: Float[Array, "nx ny"]) -> Float[Array, "nx ny"]:
    """How much passes each cell when `source` goes on by a policy (its sum over headings is 1, at the goal 0)."""
    back = [(-a, -b) for a, b in HEADINGS]

    def push(carry):
        total, moving, rounds = carry
        moving = sum(_moved(p * moving, step, 0.0) for p, step in zip(policy, back))
        return total + moving, moving, rounds + 1

    def going(carry):
        return (carry[2] < source.size) & (jnp.max(jnp.abs(carry[1])) > 1e-9 * jnp.max(jnp.abs(source)))

    return jax.lax.while_loop(going, push, (source, source, 0))[0]


def _at_goal(shape, goal):
    return jnp.zeros(shape, bool).at[tuple(goal)].set(True)


def _forward(moves, goal):
    value = _sweeps(moves, goal)
    return value, (moves, value, goal)


def _backward(kept, cotangent):
    moves, value, goal = kept
    onward = onward_costs(moves, value)
    policy = jax.nn.one_hot(jnp.argmin(onward, axis=0), len(HEADINGS), axis=0, dtype=value.dtype)
    return _occupancy(policy, value, goal, cotangent), np.zeros(goal.shape, jax.dtypes.float0)


def _occupancy(policy, value, goal, cotangent):
    """Cotangent of the moves: the flow times the policy; cells that do not reach the goal have no gradient."""
    on = jnp.isfinite(value) & ~_at_goal(value.shape, goal)
    policy = jnp.where(on, policy, 0.0)
    return policy * _flow(policy, jnp.where(jnp.isfinite(value), cotangent, 0.0))[None]


cost_to_go.defvjp(_forward, _backward)


@jax.custom_vjp
def soft_cost_to_go(
    moves: Float[Array, "heading nx ny"], goal: Int[Array, "2"], temperature: Float[Array, ""]
) -> Float[Array, "nx ny"]:
    """Soft form of `cost_to_go`: V(i) = -T log sum_h exp(-(w_h(i) + V(i + step_h)) / T), a softmin over all paths.

    Tends to the exact form as T goes to 0. Its gradient with respect to a move's cost is the share of paths, each weighted by
    exp(-cost / T), that use the move: the path's occupancy. The temperature must be well below the cost of a cell's cheapest
    move over log 8, else the sum over ever longer detours has no limit; the value is then NaN. No gradient in T.
    """
    return _soft(moves, goal, temperature)


def _soft(moves, goal, temperature):
    exact = _sweeps(moves, goal)
    at_goal, reached = _at_goal(exact.shape, goal), jnp.isfinite(exact)

    def improve(carry):
        """One round of soft least costs, and by how much it changed any of them."""
        value, _, rounds = carry
        onward = onward_costs(moves, value)
        soft = -temperature * jax.nn.logsumexp(-onward / temperature, axis=0)
        new = jnp.where(at_goal, 0.0, jnp.where(reached, soft, jnp.inf))
        change = jnp.max(jnp.where(reached, jnp.abs(new - value), 0.0))
        return new, change, rounds + 1

    def settled(value, change):
        size = jnp.max(jnp.where(reached, jnp.abs(value), temperature))
        return change <= 16.0 * jnp.finfo(exact.dtype).eps * size

    def going(carry):
        value, change, rounds = carry
        endless = jnp.any(value < -100.0 * temperature)  # e^100 times the weight of a free move: no convergent sum
        return ~settled(value, change) & ~endless & (rounds < 4 * exact.size)

    value, change, _ = jax.lax.while_loop(going, improve, (exact, jnp.full((), jnp.inf, exact.dtype), 0))
    return jnp.where(settled(value, change), value, jnp.nan)


def _soft_forward(moves, goal, temperature):
    value = _soft(moves, goal, temperature)
    return value, (moves, value, goal, temperature)


def _soft_backward(kept, cotangent):
    moves, value, goal, temperature = kept
    onward = onward_costs(moves, value)
    usable = jnp.isfinite(value)[None] & jnp.isfinite(onward)
    policy = jnp.where(usable, jnp.exp(-(jnp.where(usable, onward - value[None], 0.0)) / temperature), 0.0)
    gradient = _occupancy(policy, value, goal, cotangent)
    return gradient, np.zeros(goal.shape, jax.dtypes.float0), jnp.zeros_like(temperature)


soft_cost_to_go.defvjp(_soft_forward, _soft_backward)
