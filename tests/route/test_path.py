"""The body path against scipy's Dijkstra on the same directed graph; its statuses, heuristic, gradients and occupancy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse
from numpy.testing import assert_allclose
from scipy.sparse.csgraph import dijkstra

from jaxleg.conventions import HEADINGS
from jaxleg.route.path import PathWeights, cost_to_go, find_path, heuristic, move_costs, soft_cost_to_go
from jaxleg.status import Status

pytestmark = pytest.mark.usefixtures("optimised")

SHAPE, COUNT, LONGEST = (24, 18), 1000, 150
TOLERANCE = {"float64": 1e-5, "float32": 1e-4}
STEPS = np.array(HEADINGS)


def random_maps(rng):
    """Costs (map, heading, nx, ny), starts, goals, mu_2, cell sizes [m]: open to mostly blocked, 12 x 10 to 24 x 18 cells."""
    cost = rng.uniform(0.0, 1.0, (COUNT, 8, *SHAPE)) * rng.uniform(0.2, 1.0, (COUNT, 1, *SHAPE))
    share = rng.choice([0.0, 0.2, 0.4, 0.6], (COUNT, 1, 1, 1))
    cost[np.broadcast_to(rng.uniform(size=(COUNT, 1, *SHAPE)) < share, cost.shape)] = np.inf
    cost[rng.uniform(size=cost.shape) < 0.4 * share] = np.inf  # under some headings only
    size = np.where(rng.uniform(size=(COUNT, 1)) < 0.5, SHAPE, rng.integers((12, 10), SHAPE, (COUNT, 2)))
    for one, (nx, ny) in zip(cost, size):
        one[:, nx:], one[:, :, ny:] = np.inf, np.nan
    ends = rng.integers(0, size, (2, COUNT, 2)).astype(np.int32)
    for x, y in np.moveaxis(ends, 2, 1):
        some = np.flatnonzero(rng.uniform(size=COUNT) < 0.9)  # the others as they are, blocked or not
        cost[some, :, x[some], y[some]] = 0.5
    return cost, *ends, rng.choice([0.1, 0.6, 0.95], COUNT), rng.uniform(0.02, 0.2, (COUNT, 2))


def spiral():
    """A corridor one cell wide from the corner to the middle: its cells in order, and where they are."""
    way, cell, step = [np.zeros(2, int)], np.zeros(2, int), np.array([1, 0])
    free = np.zeros(SHAPE, bool)
    free[0, 0] = True

    def shut(cell, beyond):
        return free[tuple(cell)] if np.all((cell >= 0) & (cell < SHAPE)) else beyond

    for _ in range(sum(SHAPE)):
        while not shut(cell + step, True) and not shut(cell + 2 * step, False):
            cell = cell + step
            free[tuple(cell)] = True
            way.append(cell)
        step = np.array([-step[1], step[0]])
    return free, np.array(way)


def special_maps(cost, start, goal):
    """The last lanes made by hand; returns what their status must be."""
    free, way = spiral()
    cost[-9:] = 0.5
    cost[-9:-7] = np.where(free, 0.3, np.inf)
    start[-9:], goal[-9:] = (3, 4), (20, 11)
    start[-9], goal[-9] = way[0], way[len(way) // 2]
    start[-8], goal[-8] = way[0], way[-1]
    start[-7] = goal[-7]
    cost[-6, :, 3, 4] = np.inf
    cost[-5, :, 20, 11] = np.nan
    cost[-4] = np.inf
    start[-3], goal[-2] = (-1, 4), (20, 18)
    cost[-1, :, 10] = np.inf  # a wall
    start_, goal_ = Status.START_BLOCKED, Status.GOAL_BLOCKED
    return [Status.OK, Status.TOO_LONG, Status.OK, start_, goal_, start_, start_, goal_, Status.NO_PATH]


@jax.jit
@jax.vmap
def solve(cost, start, goal, mu, resolution):
    weights = PathWeights(1.0 - mu, mu)
    inside = jnp.clip(goal, 0, jnp.array(SHAPE, goal.dtype) - 1)
    value = cost_to_go(move_costs(cost, weights, resolution), inside)
    return find_path(cost, start, goal, weights, resolution, LONGEST), value, heuristic(SHAPE, inside, weights, resolution)


@pytest.fixture(scope="module")
def maps():
    cost, start, goal, mu, resolution = random_maps(np.random.default_rng(0))
    expected = special_maps(cost, start, goal)
    return (cost, start, goal, mu, resolution), expected


@pytest.fixture(scope="module", params=["float64", "float32"])
def solved(maps, request):
    kind = request.param
    cost, start, goal, mu, resolution = maps[0]
    answer = solve(cost.astype(kind), start, goal, mu.astype(kind), resolution.astype(kind))
    return *jax.tree.map(np.asarray, answer), TOLERANCE[kind]


def edges(cost, mu, resolution):
    """Moves of a map, one by one: from, to (flat cell numbers), cost; (17) without JAX."""
    number = np.arange(cost[0].size).reshape(cost[0].shape)
    cells = np.argwhere(number >= 0)
    heading, cell = (x.ravel() for x in np.mgrid[: len(STEPS), : len(cells)])
    onto = cells[cell] + STEPS[heading]
    inside = np.all((onto >= 0) & (onto < number.shape), axis=1)
    heading, cell, onto = heading[inside], cell[inside], onto[inside]
    way = np.hypot(*(STEPS[heading] * resolution).T)
    price = (1.0 - mu) * way + mu * cost[heading, onto[:, 0], onto[:, 1]]
    usable = np.isfinite(price)
    return cell[usable], number[tuple(onto[usable].T)], price[usable]


def exact(cost, goal, mu, resolution):
    """Cost from every cell to the goal, by Dijkstra against the moves."""
    here, there, price = edges(cost, mu, resolution)
    graph = scipy.sparse.csr_array((price, (there, here)), (cost[0].size,) * 2)
    return dijkstra(graph, indices=np.ravel_multi_index(goal, SHAPE)).reshape(SHAPE)


def test_every_cost_to_go_is_that_of_dijkstra(maps, solved):
    (cost, start, goal, mu, resolution), _ = maps
    found, value, bound, tolerance = solved
    no_path = 0
    for k in range(COUNT):
        truth = exact(cost[k], np.minimum(goal[k], np.array(SHAPE) - 1), mu[k], resolution[k])
        assert_allclose(value[k], truth, rtol=tolerance, err_msg=f"map {k}")
        assert np.all(bound[k] <= truth * (1 + tolerance) + 1e-12)
        usable = [np.any(np.isfinite(cost[k][:, i, j])) for i, j in np.clip((start[k], goal[k]), 0, np.array(SHAPE) - 1)]
        if k < COUNT - 9 and all(usable):
            reached = np.isfinite(truth[tuple(start[k])])
            assert found.status[k] == (Status.OK if reached else Status.NO_PATH)
            assert_allclose(found.cost[k], truth[tuple(start[k])], rtol=tolerance)
            no_path += not reached
        elif k < COUNT - 9:
            assert found.status[k] == (Status.GOAL_BLOCKED if usable[0] else Status.START_BLOCKED)
    assert no_path > 100
    assert np.mean(found.status == Status.OK) > 0.5


def moves_of(found, k):
    """Headings and cells entered of a path."""
    n = found.length[k] - 1
    return found.heading[k][:n], found.cells[k][1 : n + 1]


def test_the_moves_of_a_path_sum_to_its_cost(maps, solved):
    (cost, start, goal, mu, resolution), _ = maps
    found, _, _, tolerance = solved
    for k in np.flatnonzero(found.status == Status.OK):
        heading, onto = moves_of(found, k)
        assert np.array_equal(found.cells[k][0], start[k])
        assert np.array_equal(np.diff(found.cells[k][: found.length[k]], axis=0), STEPS[heading])
        assert np.all(found.cells[k][found.length[k] - 1 :] == goal[k])
        way = np.hypot(*(STEPS[heading] * resolution[k]).T)
        entered = cost[k][heading, onto[:, 0], onto[:, 1]]
        assert_allclose(np.sum((1 - mu[k]) * way + mu[k] * entered), found.cost[k], rtol=tolerance, atol=1e-12)
    without = ~np.isin(found.status, (Status.OK, Status.TOO_LONG))
    assert np.all(np.isinf(found.cost[without]))
    assert np.all(found.length[found.status != Status.OK] == 0)


def test_spiral_blocked_ends_walls_and_no_way_at_all(maps, solved):
    found = solved[0]
    assert [Status(s) for s in found.status[-9:]] == maps[1]
    _, way = spiral()
    assert found.length[-9] > len(way) // 2 - 12 > 80  # cuts its corners, else all along the corridor
    assert np.isfinite(found.cost[-8])
    assert found.length[-7] == 1
    assert found.cost[-7] == 0.0


def test_the_heuristic_is_consistent(maps, solved):
    (cost, _, _, mu, resolution), _ = maps
    for k in range(0, COUNT, 20):
        here, there, price = edges(cost[k], mu[k], resolution[k])
        bound = solved[2][k].ravel()
        assert np.all(bound[here] <= price + bound[there] + 1e-6)
        assert bound.min() == 0.0


def test_more_weight_on_cost_takes_longer_ways_over_cheaper_ground(maps):
    (cost, start, goal, mu, resolution), _ = maps
    totals = []
    for weight in (0.1, 0.6, 0.95):
        found = jax.tree.map(np.asarray, solve(cost, start, goal, np.full_like(mu, weight), resolution)[0])
        rows = []
        for k in np.flatnonzero(found.status == Status.OK):
            heading, onto = moves_of(found, k)
            rows.append([np.hypot(*(STEPS[heading] * resolution[k]).T).sum(), cost[k][heading, onto[:, 0], onto[:, 1]].sum()])
        totals.append(np.array(rows))
    steps = np.diff(totals, axis=0)
    assert np.all(steps[..., 0] >= -1e-9)
    assert np.all(steps[..., 1] <= 1e-9)
    assert np.mean(steps.sum(axis=0)[:, 0] > 0.0) > 0.3


# Gradients, on one small map.

SMALL, GOAL, START, SIZE = (9, 7), np.array([7, 5], np.int32), (1, 1), np.array([0.1, 0.15])
WEIGHTS = PathWeights(np.array(0.4), np.array(0.6))


@pytest.fixture(scope="module")
def cost():
    """A map with a wall, open at one end."""
    cost = np.random.default_rng(3).uniform(0.2, 1.0, (8, *SMALL))
    cost[:, 4, :5] = np.inf
    return cost


@pytest.fixture(scope="module")
def moves(cost):
    return np.asarray(jax.jit(move_costs)(cost, WEIGHTS, SIZE))


def at_start(function):
    both = jax.jit(jax.value_and_grad(lambda moves, *rest: function(moves, jnp.asarray(GOAL), *rest)[START]))
    return lambda *values: jax.tree.map(np.asarray, both(*values))


exact_at_start, soft = at_start(cost_to_go), at_start(soft_cost_to_go)


def divergence(flow):
    """What leaves each cell less what enters it."""
    rest = flow.sum(axis=0)
    for h, i, j in np.argwhere(flow > 0):
        rest[i + HEADINGS[h][0], j + HEADINGS[h][1]] -= flow[h, i, j]
    return rest


@pytest.mark.parametrize("temperature", [0.01, 0.03, 0.08])
def test_occupancy_is_a_flow_of_one_from_start_to_goal(moves, temperature):
    flow = soft(moves, temperature)[1]
    expected = np.zeros(SMALL)
    expected[START], expected[tuple(GOAL)] = 1.0, -1.0
    assert np.all(flow >= 0.0)
    assert_allclose(divergence(flow), expected, atol=1e-7)


def test_gradients_are_central_differences(moves):
    chosen = np.argwhere(np.isfinite(moves))[::9]
    bump = np.zeros((len(chosen), *moves.shape))
    bump[(np.arange(len(chosen)), *chosen.T)] = 1e-5

    @jax.jit
    @jax.vmap
    def values(moves):
        goal = jnp.asarray(GOAL)
        return soft_cost_to_go(moves, goal, 0.05)[START], cost_to_go(moves, goal)[START]

    slopes = soft(moves, 0.05)[1], exact_at_start(moves)[1]
    for slope, up, down in zip(slopes, values(moves[None] + bump), values(moves[None] - bump)):
        assert_allclose(slope[tuple(chosen.T)], np.subtract(up, down) / 2e-5, atol=1e-6)


def test_the_soft_form_tends_to_the_exact_path(moves):
    value, flow = exact_at_start(moves)
    assert set(np.unique(flow)) == {0.0, 1.0}
    assert_allclose(np.sum(flow * np.where(flow > 0, moves, 0.0)), value)
    cold, cold_flow = soft(moves, 1e-4)
    assert_allclose(cold, value, atol=1e-6)
    assert_allclose(cold_flow, flow, atol=1e-6)
    assert soft(moves, 0.05)[0] < cold


def test_a_sum_without_a_limit_is_not_a_number(moves):
    assert np.isnan(soft(moves, 1.0)[0])


def test_gradients_reach_costs_and_weights(cost):
    """The cost of a path by the weights: its way and its costs; by the cost of a cell: mu_2 where it is entered."""

    def total(cost, weights):
        found = find_path(cost, jnp.array(START, jnp.int32), jnp.asarray(GOAL), weights, jnp.asarray(SIZE), 40)
        return found.cost, found

    (_, found), (by_cost, by_weight) = jax.jit(jax.value_and_grad(total, (0, 1), has_aux=True))(cost, WEIGHTS)
    found = jax.tree.map(np.asarray, found)
    heading, onto = found.heading[: found.length - 1], found.cells[1 : found.length]
    expected = np.zeros(cost.shape)
    expected[heading, onto[:, 0], onto[:, 1]] = 0.6
    assert_allclose(by_cost, expected, atol=1e-12)
    assert_allclose(by_weight.distance, np.hypot(*(STEPS[heading] * SIZE).T).sum())
    assert_allclose(by_weight.cost, cost[heading, onto[:, 0], onto[:, 1]].sum())


def test_lanes_may_share_a_map_or_a_goal(moves):
    one = np.asarray(jax.jit(cost_to_go)(moves, GOAL))
    many, goals = np.stack([moves, 2.0 * moves]), np.stack([GOAL, GOAL])
    assert_allclose(jax.jit(jax.vmap(cost_to_go, (0, None)))(many, GOAL), np.stack([one, 2.0 * one]))
    assert_allclose(jax.jit(jax.vmap(cost_to_go, (None, 0)))(moves, goals), np.stack([one, one]))


@jax.jit
def search(cost, start, goal, weights):
    return find_path(cost, start, goal, weights, jnp.array([0.1, 0.1]), LONGEST).status


def test_ends_that_are_nowhere_are_blocked():
    """Off the map by a million cells, as `nearest_cell` has what is not a number."""
    cost, weights = np.full((8, *SHAPE), 0.5), PathWeights(0.4, 0.6)
    here, nowhere = np.array([3, 4], np.int32), np.array([-(2**20), 4], np.int32)
    found = [int(search(cost, *ends, weights)) for ends in ((here, here), (nowhere, here), (here, nowhere))]
    assert found == [Status.OK, Status.START_BLOCKED, Status.GOAL_BLOCKED]


def test_weights_that_are_not_finite_give_no_path():
    cost, ends = np.full((8, *SHAPE), 0.5), np.array([[3, 4], [9, 9]], np.int32)
    assert search(cost, *ends, PathWeights(np.nan, 0.6)) != Status.OK
