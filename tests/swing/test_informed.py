"""Planners against shortest ways found otherwise, the field's gradient, predicted obstacles, and swings with maps."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from experiments.informed_swing import lowered, shortest_way
from jaxleg.swing.informed import informed_swings
from jaxleg.swing.localmap import LocalMap, believed_height, points, sampled, widened
from jaxleg.swing.machine import Mode, Sensed, Step, printed
from jaxleg.swing.planner import as_printed, cautious, plan, predicted, repaired, shortest, view
from jaxleg.swing.profile import height, natural_spline
from jaxleg.swing.route import Route, follow, route_length
from jaxleg.swing.routing import FLOOR, STRIDE, clearance_of, potential

STEP = Step(np.array([0.0, 3.0]), np.array([8.0, 3.0]))
ABOVE = np.array([0.0, 3.0 + 1e-6])
LEVEL = np.full(15, 3.0)
plan, view, predicted, follow = (jax.jit(f) for f in (plan, view, predicted, follow))
height, natural_spline, points = (jax.jit(f) for f in (height, natural_spline, points))
clearances = jax.jit(jax.vmap(clearance_of, in_axes=(None, 0)))
fields = jax.jit(jax.vmap(jax.value_and_grad(potential, argnums=1), in_axes=(None, 0, None)))


def terrains(count, seed=0):
    heights = np.random.default_rng(seed).uniform(3.0, 4.6, (count, 15))
    heights[:, 0] = 3.0
    return heights


@jax.jit
def map_of(knots):
    return sampled(natural_spline(knots), -0.5, 9.5, 201)


@jax.jit
def field_routes(knots):
    local = jax.vmap(map_of)(knots)
    one = lambda seen: plan(printed(), as_printed(), STEP, seen, ABOVE, jnp.array(False))  # noqa: E731
    return local, jax.vmap(one)(local)


@jax.jit
def queue(planner, step, heights, believed):
    return informed_swings(printed(), planner, step, jax.vmap(natural_spline)(heights), jax.vmap(map_of)(believed))


def swings(planner, heights, believed):
    return jax.device_get(queue(planner, STEP, heights, believed))


@pytest.fixture(scope="module")
def exact():
    heights = terrains(300)
    return heights, swings(shortest(), heights, heights)


def test_with_a_map_that_is_right_nothing_is_hit_and_the_way_is_nearly_the_shortest(exact):
    heights, seen = exact
    assert np.all(seen.swing.exit == Mode.SUPPORTED)
    assert not np.any(seen.swing.collisions)
    assert not np.any(seen.swing.adjustments)
    ratio = seen.swing.time / seen.swing.length  # a cycloid at peak speed 1 takes 2; it ends at a touch, a little early
    assert 1.8 < ratio.min() < ratio.max() < 2.0
    ways = np.array([shortest_way(knots) for knots in heights[:100]])
    ratio = seen.swing.length[:100] / ways
    assert ratio.min() > 1.0
    assert np.sum(seen.swing.length[:100]) < 1.10 * np.sum(ways)


def test_the_shortest_way_of_the_experiment_is_dijkstras():
    """On a graph of all lines of sight between points of the ground 0.1 apart."""
    for knots in terrains(4, seed=5):
        spline = natural_spline(knots)
        x = np.arange(0.0, 9.05, 0.1)
        z = np.asarray(height(spline, x))
        a, b = np.triu_indices(len(x), 1)
        share = np.linspace(0.0, 1.0, 200)[:, None]
        line = z[a] + share * (z[b] - z[a])
        free = np.all(line >= np.interp(x[a] + share * (x[b] - x[a]), x, z) - 1e-9, axis=0)
        away = np.hypot(x[b] - x[a], z[b] - z[a])
        graph = coo_matrix((away[free], (a[free], b[free])), shape=(len(x), len(x)))
        way = dijkstra(graph, directed=False, indices=0)
        steep = np.abs(np.gradient(np.asarray(height(spline, np.arange(0.0, 9.05, 0.01))), 0.01))[::10]
        np.testing.assert_allclose(way[(x > 6.99) & (steep[: len(x)] < 1.0)].min(), shortest_way(knots), rtol=3e-3)


@pytest.mark.parametrize("planner", [shortest(), repaired(), cautious()])
def test_a_route_keeps_its_clearance(planner):
    for knots in terrains(10, seed=2):
        local = map_of(knots)
        route, seen = jax.device_get([f(printed(), planner, STEP, local, ABOVE, True) for f in (plan, view)])
        assert route.found
        np.testing.assert_array_equal(route.corner[0], ABOVE)
        corner, ground = route.corner[1:-1], np.stack([points(local), local.ground], axis=-1)
        away = np.linalg.norm(corner[:, None] - ground, axis=-1)
        assert away.min() > float(planner.clearance) - 1e-9  # from the map's points; between them a little less
        middle = clearances(seen, 0.5 * (corner[1:] + corner[:-1])[::8])
        assert np.min(middle) > 0.5 * float(planner.clearance)
        x = route.corner[1:-1, 0]
        assert np.all(np.diff(x) >= 0.0)
        over = (x >= 0.5) & (x <= 6.5)
        assert np.all(route.corner[1:-1, 1][over] >= 3.5)  # the preset obstacle


def test_the_taut_string_is_the_least_concave_curve():
    local = map_of(terrains(1, seed=8)[0])
    route = plan(printed(), shortest(), STEP, local, ABOVE, False)
    x, z = np.asarray(route.corner)[1:-1].T
    keep = np.append(True, np.diff(x) > 1e-9)
    x, z = x[keep], z[keep]
    turn = np.diff(np.diff(z) / np.diff(x))
    assert turn.max() < 1e-9
    wide = np.interp(x, points(local), jax.jit(widened, static_argnums=2)(local, shortest().clearance, 12))
    touches = np.abs(z - wide)[1:-1] < 1e-9
    assert np.all(touches[turn < -1e-9])  # it bends nowhere but on the ground


def test_the_field_is_finite_and_points_out_of_obstacles():
    seen = view(printed(), as_printed(), STEP, map_of(LEVEL), ABOVE, True)
    np.testing.assert_allclose(seen.block, [0.0 + 0.5, 8.0 - 0.5, 3.0 + 0.5])  # (13), with Table I's H_limit
    goal = np.array([8.0, 3.0])
    inside = [[3.0, 2.9], [3.0, 3.48], [0.52, 3.2], [3.0, 3.0], [0.3, 3.0]]
    point = [2.0, 3.53]  # within d0 of the block's top
    value, slope = fields(seen, np.array([*inside, [3.0, 5.0], point]), goal)
    down = -np.asarray(slope)
    assert np.all(np.isfinite(down[:5]))
    out = down[1:3]
    assert out[0, 1] > 0.0  # up out of the block's top
    assert out[1, 0] < 0.0  # back out of its side
    np.testing.assert_allclose(down[5], -20.0 * (np.array([3.0, 5.0]) - goal), rtol=1e-9)
    u = 10.0 * (6.0**2 + 0.53**2) + 1000.0 * (1 / 0.03 - 1 / 0.05)
    np.testing.assert_allclose(value[6], u, rtol=1e-9)  # (12) by hand


def test_the_field_as_printed_finds_a_route_where_its_descent_arrives_and_stays_clear():
    """Of 300 terrains, by its points and those half way between; without the preset obstacle."""
    local, route = jax.device_get(field_routes(terrains(300)))
    close, planner = [], as_printed()
    for ground, way in zip(local.ground, route.corner[:, 1:-1]):
        seen = np.concatenate([way[:-1], way[1:], 0.5 * (way[:-1] + way[1:])])
        close.append(np.min(seen[:, 1] - np.interp(seen[:, 0], np.linspace(-0.5, 9.5, 201), ground)))
    goal = route.corner[:, -1] + [0.0, float(planner.press)]
    arrives = np.linalg.norm(route.corner[:, -2] - goal, axis=1) <= float(planner.clearance) + STRIDE
    assert 0.05 < route.found.mean() < 0.95
    np.testing.assert_array_equal(route.found, arrives & (np.array(close) >= FLOOR))


def test_the_field_as_printed_sticks_at_its_own_preset_obstacle():
    route = plan(printed(), as_printed(), STEP, map_of(LEVEL), ABOVE, True)
    assert not route.found
    np.testing.assert_allclose(np.asarray(route.corner)[-2], [0.45, 3.05], atol=0.06)
    for better in (repaired(), shortest()):
        assert plan(printed(), better, STEP, map_of(LEVEL), ABOVE, True).found


@pytest.mark.slow
def test_where_there_is_no_route_the_blind_machine_moves(exact):
    heights = np.stack([LEVEL, LEVEL])
    seen = swings(as_printed(), heights, heights)
    assert not np.any(seen.at_first)
    assert np.all(seen.swing.exit == Mode.SUPPORTED)
    assert np.all(seen.unplanned == 1)


def test_predicted_obstacles_are_the_papers():
    """Equations (14) and (16), and that a ramp is mirrored with the force."""
    local = LocalMap(np.full(201, 1.0), np.array(-0.5), np.array(0.05))
    planner, x = as_printed(), np.asarray(points(local))
    near = np.abs(x - 4.0) <= 0.5 + 1e-9

    def after(case, slope):
        felt = Sensed(np.array([4.0, 2.0]), True, slope)
        ground = np.asarray(predicted(printed(), planner, local, int(case), felt).ground)
        np.testing.assert_allclose(ground[~near], 1.0)
        return ground[near]

    np.testing.assert_allclose(after(Mode.OVER, 0.2), 2.0, atol=1e-9)
    np.testing.assert_allclose(after(Mode.BACK, 3.0), 2.0 + (x[near] - 4.0), atol=1e-6)
    np.testing.assert_allclose(after(Mode.BACK, -3.0), 2.0 - (x[near] - 4.0), atol=1e-6)
    np.testing.assert_allclose(after(Mode.DOWN, 3.0), 1.0)


def test_a_map_is_raised_to_what_was_felt():
    local = LocalMap(np.full(201, 1.0), np.array(-0.5), np.array(0.05))
    planner = dataclasses.replace(as_printed(), reach=jnp.asarray(2.0), half_width=jnp.asarray(0.0))
    felt = Sensed(np.array([4.0, 2.0]), True, 0.0)
    raised = predicted(printed(), planner, local, int(Mode.OVER), felt)
    believed = jax.jit(jax.vmap(believed_height, in_axes=(None, 0)))(raised, np.array([2.0, 3.0, 4.0, 6.0]))
    np.testing.assert_allclose(believed, [1.0, 1.5, 2.0, 1.0], atol=1e-6)


def test_a_map_that_is_wrong_costs_collisions_and_caution_avoids_them():
    heights = terrains(300, seed=3)
    believed = lowered(heights, 2.0)
    bold, careful = swings(shortest(), heights, believed), swings(cautious(), heights, believed)
    assert np.mean(careful.swing.collisions) < 1.1 < np.mean(bold.swing.collisions) + 0.3
    assert np.mean(careful.swing.exit == Mode.SUPPORTED) > 0.9
    assert not np.any(careful.swing.lost)


def test_unseen_ground_gives_no_route():
    local = jax.device_get(map_of(LEVEL))
    unseen = local._replace(ground=np.where(np.arange(201) == 100, np.nan, local.ground))
    for planner in (shortest(), repaired(), as_printed()):
        route = plan(printed(), planner, STEP, unseen, ABOVE, True)
        assert not route.found


@pytest.mark.parametrize("unseen", [slice(192, None), slice(0, 8), slice(200, 201)])
def test_what_is_not_seen_behind_or_beyond_leaves_the_route_as_it_is(unseen):
    """The map goes from -0.5 to 9.5, landings up to 9."""
    local = jax.device_get(map_of(np.array([3.0, 3.5, 4.1, *LEVEL[3:]])))
    part = local._replace(ground=local.ground.copy())
    part.ground[unseen] = np.nan
    for planner in (shortest(), cautious()):
        whole, seen = (plan(printed(), planner, STEP, ground, ABOVE, True) for ground in (local, part))
        assert whole.found
        assert seen.found
        np.testing.assert_allclose(seen.corner, whole.corner, atol=1e-9)


def test_the_fields_clearance_is_the_same_wherever_a_route_begins_in_a_cell():
    """Also in the map's first, whose point then stands for the beginning."""
    wall = sampled(natural_spline(LEVEL), 0.0, 10.0, 201)
    wall = wall._replace(ground=wall.ground.at[100:104].set(4.0))
    near = [np.array([4.8, 3.6]), np.array([6.0, 3.3])]
    found = []
    for x in (0.0, 0.045, 0.545):
        seen = view(printed(), as_printed(), STEP, wall, np.array([x, 3.0 + 1e-6]), False)
        found.append(clearances(seen, np.stack(near)))
    np.testing.assert_allclose(found, np.broadcast_to(found[0], (3, 2)), atol=1e-9)
    assert np.all(np.asarray(found) > 0.0)


def test_no_route_leads_over_ground_above_the_map():
    local = jax.device_get(map_of(LEVEL))
    cell = np.arange(201)
    wall = local._replace(ground=np.where((cell >= 90) & (cell < 94), 9.0, local.ground))
    for planner in (shortest(), repaired()):
        assert not plan(printed(), planner, STEP, wall, ABOVE, True).found
        assert plan(printed(high=12.0), planner, STEP, wall, ABOVE, True).found
        assert plan(printed(), planner, STEP, wall, np.array([5.0, 3.0 + 1e-6]), False).found  # it lies behind


def test_following_a_route_stops_at_the_first_contact():
    spline = natural_spline(terrains(1, seed=4)[0])
    corner = np.array([[0.0, 3.001], [0.0, 6.0], [4.0, 6.0], [4.0, 0.0], [5.0, 0.0]])
    stop = follow(Route(corner, True), spline)
    ground = float(height(spline, 4.0))
    assert stop.hit
    np.testing.assert_allclose(stop.point, [4.0, ground], atol=1e-6)
    np.testing.assert_allclose(stop.length, 2.999 + 4.0 + 6.0 - ground, atol=1e-6)
    np.testing.assert_allclose(jax.jit(route_length)(Route(corner, True)), 2.999 + 4.0 + 6.0 + 1.0)


def test_a_long_straight_does_not_tunnel_through_a_bump():
    """Straights much longer than the terrain's bumps, against dense sampling."""
    x, stopped = np.linspace(0.0, 9.0, 90_001), 0
    for knots in terrains(12, seed=9):
        spline = natural_spline(knots)
        ground = np.asarray(height(spline, x))
        stop = jax.device_get(follow(Route(np.array([[0.0, 4.4], [9.0, 4.4]]), True), spline))
        below = np.flatnonzero(ground > 4.4)
        assert bool(stop.hit) == bool(below.size)
        if below.size:
            np.testing.assert_allclose(stop.point[0], x[below[0]], atol=2e-4)
            stopped += 1
    assert stopped > 3
