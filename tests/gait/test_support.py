"""Triangles and the stability margin, against the equations of hull facets that scipy finds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull

from jaxleg.conventions import LEG_END, LEG_SIDE, LEGS, RING
from jaxleg.gait import order
from jaxleg.gait import support as gait

N = 30
NOMINAL = np.stack([LEG_END, LEG_SIDE], axis=-1) * np.array([0.3, 0.2])
incentre = jax.jit(gait.incentre)
margin = jax.jit(gait.stability_margin)
edge_margins = jax.jit(gait.edge_margins)


def random_feet(rng):
    """Four feet in convex position, in any place and heading."""
    angle, feet = rng.uniform(0, 2 * np.pi), NOMINAL + rng.uniform(-0.09, 0.09, (4, 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return feet @ turn.T + rng.normal(size=2)


def inside_all_sides(point, corners):
    """Least distance inside the sides of the hull, negative outside."""
    equations = ConvexHull(corners).equations
    return -np.max(equations[:, :2] @ point + equations[:, 2])


@pytest.mark.parametrize("airborne", [None, 0, 1, 2, 3])
def test_margin_is_the_distance_inside_the_hull(airborne):
    rng, loaded = np.random.default_rng(1), np.arange(4) != airborne
    signs = set()
    for _ in range(N):
        feet = random_feet(rng)
        com = feet.mean(axis=0) + rng.uniform(-0.25, 0.25, 2)
        ours = margin(jnp.array(com), jnp.array(feet), jnp.array(loaded))
        assert_allclose(ours, inside_all_sides(com, feet[loaded]), atol=1e-8)
        signs.add(bool(ours > 0))
    assert signs == {True, False}


@pytest.mark.parametrize("airborne", [None, 0, 1, 2, 3])
def test_each_loaded_foot_begins_one_edge_of_the_hull(airborne):
    """Its distances are those to the hull's sides, one by one; a foot in the air has none."""
    rng, loaded = np.random.default_rng(4), np.arange(4) != airborne
    for _ in range(5):
        feet = random_feet(rng)
        com = feet.mean(axis=0) + rng.uniform(-0.25, 0.25, 2)
        edges = np.asarray(edge_margins(jnp.array(com), jnp.array(feet), jnp.array(loaded)))
        sides = ConvexHull(feet[loaded]).equations
        np.testing.assert_array_equal(np.isfinite(edges), loaded[np.array(RING)])
        assert_allclose(np.sort(edges[np.isfinite(edges)]), np.sort(-(sides[:, :2] @ com + sides[:, 2])), atol=1e-8)


@pytest.mark.parametrize("pair", [(0, 3), (1, 2), (0, 1), (0, 2)])
def test_margin_on_two_feet_is_minus_the_distance_to_their_line(pair):
    rng, loaded = np.random.default_rng(2), np.isin(range(4), pair)
    for _ in range(5):
        feet = random_feet(rng)
        com, (a, b) = feet.mean(axis=0) + rng.uniform(-0.1, 0.1, 2), feet[list(pair)]
        along = (b - a) / np.linalg.norm(b - a)
        off_line = np.linalg.norm((com - a) - along * ((com - a) @ along))
        assert_allclose(margin(jnp.array(com), jnp.array(feet), jnp.array(loaded)), -off_line, atol=1e-8)


@pytest.mark.parametrize("loaded", [[False] * 4, [True, False, False, False]])
def test_margin_on_fewer_feet_is_minus_one(loaded):
    assert margin(jnp.zeros(2), jnp.array(NOMINAL), jnp.array(loaded)) == -1.0


def test_incentre_is_equally_far_from_the_three_sides():
    rng = np.random.default_rng(3)
    for _ in range(N):
        corners = rng.normal(size=(3, 2))
        centre = np.asarray(incentre(*map(jnp.array, corners)))
        hull = ConvexHull(corners).equations
        distance = hull[:, :2] @ centre + hull[:, 2]
        assert distance.max() < 0
        assert_allclose(distance, distance[0], atol=1e-7)


def test_incentre_of_one_point_is_that_point_with_a_finite_gradient():
    point = jnp.array([0.3, -0.2])
    assert_allclose(gait.incentre(point, point, point), point)
    assert np.all(np.isfinite(jax.jit(jax.jacobian(gait.incentre))(point, point, point)))


def test_crossing_lies_on_both_lines():
    rng = np.random.default_rng(4)
    for a, b, c, d in rng.normal(size=(N, 4, 2)):
        on_ab, on_cd = np.linalg.solve(np.stack([b - a, c - d], axis=1), c - a)
        ours = gait.crossing(*map(jnp.array, (a, b, c, d)))
        assert_allclose(ours, a + on_ab * (b - a), rtol=1e-7, atol=1e-9)
        assert_allclose(ours, c + on_cd * (d - c), rtol=1e-7, atol=1e-9)


def test_overlap_incentre_is_inside_both_support_triangles():
    rng, overlap = np.random.default_rng(5), jax.jit(gait.overlap_incentre)
    for _ in range(N):
        front, swing_front, hind, swing_hind = random_feet(rng)
        corners = (front, hind, swing_front, swing_hind)
        centre = np.asarray(overlap(*map(jnp.array, corners)))
        inside = [inside_all_sides(centre, np.stack([front, hind, third])) for third in (swing_front, swing_hind)]
        assert min(inside) > 0
        assert_allclose(inside[0], inside[1], atol=1e-7)  # both share the standing side


def test_crawl_swings_every_leg_once_hind_before_front_after_a_shift():
    swings = [leg for leg in order.SWING_LEG if leg != order.SHIFT]
    assert [LEGS[leg] for leg in swings] == ["RH", "RF", "LH", "LF"]
    assert [i for i, leg in enumerate(order.SWING_LEG) if leg == order.SHIFT] == [0, 3]


def test_overlap_median_runs_from_the_diagonals_crossing_to_the_standing_side():
    """Paper C, (21): on a parallelogram the overlap's three medians meet at two thirds; every point lies inside both."""
    rng, median = np.random.default_rng(6), jax.jit(gait.overlap_median)
    for _ in range(N):
        front, swing_front, hind, swing_hind = random_feet(rng)
        corners = (front, hind, swing_front, swing_hind)
        crossing = np.asarray(gait.crossing(*map(jnp.array, (front, swing_hind, hind, swing_front))))
        centroid = np.mean([front, hind, crossing], axis=0)
        assert_allclose(median(*map(jnp.array, corners), 2.0 / 3.0), centroid, atol=1e-12)
        for third in (swing_front, swing_hind):
            assert inside_all_sides(np.asarray(median(*map(jnp.array, corners), 0.4)), np.stack([front, hind, third])) > 0
