"""A foot on a taut string over a height map: the shortest way, clear of the ground, smooth, differentiable."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from jaxleg.gait.phases import Flight
from jaxleg.swing.flight import along, fly
from jaxleg.swing.taut import POINTS, Taut, section
from jaxleg.terrain import Grid
from jaxleg.terrain.obstacles import obstacles
from tests.crawls import gait

GRID, RADIUS = Grid(60, 60, 0.01, (-0.1, -0.3)), 0.02
CLEARANCE = 0.02
START, END = np.array([0.0, 0.0]), np.array([0.24, 0.10])


def ground(boxes):
    """Level but for boxes (low x, high x, height), along all of y."""
    x = GRID.origin[0] + GRID.resolution * np.arange(GRID.nx)
    high = np.zeros((GRID.nx, GRID.ny))
    for low, high_x, height in boxes:
        high[(x >= low) & (x <= high_x)] = height
    return GRID.map(jnp.asarray(high))


@pytest.fixture(scope="module")
def flown(pegasus):
    """Flight, section and the foot at shares of a swing over boxes."""
    law = Taut(jnp.asarray(CLEARANCE), jnp.asarray(0.1))

    @jax.jit
    def run(elevation, start, end, shares):
        terrain = dataclasses.replace(GRID.map(jnp.zeros((GRID.nx, GRID.ny))), elevation=elevation)
        near = obstacles(terrain, GRID.resolution, RADIUS, RADIUS)
        flight = law.flight(pegasus, gait(), near, start, end)
        foot = jax.vmap(lambda s: fly(start, end, flight, s))(shares)
        return flight, section(pegasus, near, start, end), foot

    return lambda boxes, shares, start=START, end=END, rise=(0.0, 0.0): run(
        ground(boxes).elevation,
        *(np.append(xy, float(pegasus.contact_radius) + z) for xy, z in zip((start, end), rise)),
        shares,
    )


BOXES = {
    "level": [],
    "one": [(0.08, 0.16, 0.10)],
    "two": [(0.05, 0.08, 0.04), (0.15, 0.17, 0.12)],
    "pit": [(0.06, 0.18, -0.1)],
}


@pytest.mark.parametrize("name", list(BOXES))
def test_it_keeps_half_of_its_clearance_from_all_ground_near_its_way(flown, pegasus, name):
    """Distance of the foot to every column near it, at fine shares; straight up and down at the ends it is nearer."""
    shares = np.linspace(0.0, 1.0, 2001)
    _, local, foot = jax.tree.map(np.asarray, flown(BOXES[name], shares))
    np.testing.assert_allclose(foot[[0, -1], :2], [START, END], atol=1e-9)
    np.testing.assert_allclose(foot[[0, -1], 2], float(pegasus.contact_radius), atol=1e-9)
    stride = np.linalg.norm(END - START)
    x = np.linspace(0.0, stride, POINTS)
    way = (foot[:, :2] - START) @ (END - START) / stride
    inside = (way > CLEARANCE) & (way < stride - CLEARANCE)
    distance = np.hypot(way[inside, None] - x[None], foot[inside, 2][:, None] - np.asarray(local.ground)[None]).min(axis=1)
    assert distance.min() > 0.5 * CLEARANCE
    assert np.all(foot[inside, 2] > np.interp(way[inside], x, local.ground) + 0.3 * CLEARANCE)


@pytest.mark.parametrize("name", list(BOXES))
def test_its_corners_are_the_least_concave_curve_over_the_widened_ground(flown, name):
    """By scipy's hull of the widened points; nothing shorter passes above them."""
    flight, local, _ = flown(BOXES[name], np.zeros(1))
    stride = np.linalg.norm(END - START)
    x, low = np.linspace(0.0, stride, POINTS), np.asarray(local.ground)
    apart = x[:, None] - x[None]
    lift = np.where(np.abs(apart) <= CLEARANCE, np.sqrt(np.maximum(CLEARANCE**2 - apart**2, 0.0)), -np.inf)
    wide = np.max(low[None] + lift, axis=1)
    hull = ConvexHull(np.column_stack([np.append(x, [0.0, stride]), np.append(wide, [-1.0, -1.0])]))
    upper = hull.equations[hull.equations[:, 1] > 1e-9]  # n . p + d <= 0
    top = np.min([(-d - a * x) / b for a, b, d in upper], axis=0)
    route = np.asarray(flight.corner)[1:-1]
    np.testing.assert_allclose(np.interp(x, route[:, 0] * stride, route[:, 1]), top, atol=1e-9)


def test_it_starts_and_ends_at_rest_and_its_acceleration_has_no_jumps(flown):
    shares = np.linspace(0.0, 1.0, 4001)
    foot = np.asarray(flown(BOXES["one"], shares)[2])
    rate = np.gradient(foot, shares, axis=0)
    acceleration = np.gradient(rate, shares, axis=0)
    assert np.abs(rate[[0, -1]]).max() < 1e-2 * np.abs(rate).max()
    jumps = np.abs(np.diff(acceleration, axis=0)).max(axis=1)[3:-3]
    finer = np.asarray(flown(BOXES["one"], np.linspace(0.0, 1.0, 8001))[2])
    again = np.gradient(np.gradient(finer, 0.5 * (shares[1] - shares[0]), axis=0), 0.5 * (shares[1] - shares[0]), axis=0)
    assert np.abs(np.diff(again, axis=0)).max() < 0.7 * jumps.max()  # a jump would stay as it is


def test_it_takes_a_foot_from_where_it_stands(flown, pegasus):
    """A foot found 3 cm lower than planned goes up from there along the same route."""
    flight, _, _ = flown(BOXES["one"], np.zeros(1))
    start, end = (np.append(xy, float(pegasus.contact_radius)) for xy in (START, END))
    at = jax.jit(lambda start, s: fly(start, jnp.asarray(end), flight, s))
    lower = start - np.array([0.0, 0.0, 0.03])
    np.testing.assert_allclose(at(lower, 0.0), lower, atol=1e-9)
    np.testing.assert_allclose(at(lower, 1.0), end, atol=1e-9)
    assert float(at(lower, 0.5)[2]) == pytest.approx(float(at(start, 0.5)[2]), abs=0.02)


def test_its_gradient_is_its_differences(pegasus):
    """By the places of the feet and by the ground's height, at shares off the corners."""
    law = Taut(jnp.asarray(CLEARANCE), jnp.asarray(0.1))
    box = np.asarray(ground(BOXES["one"]).elevation) > 0.0

    def height(numbers, share):
        elevation = jnp.where(box, numbers[0], 0.0)
        near = obstacles(GRID.map(elevation), GRID.resolution, RADIUS, RADIUS)
        start = jnp.stack([numbers[1], jnp.zeros(()), numbers[2]])
        end = jnp.stack([numbers[3], numbers[4], jnp.asarray(0.03)])
        return jnp.sum(fly(start, end, law.flight(pegasus, gait(), near, start, end), share))

    numbers = np.array([0.1, 0.0013, 0.031, 0.2417, 0.1009])
    value, slope = jax.jit(height), jax.jit(jax.grad(height))
    for share in (0.2, 0.45, 0.7):
        steps = 1e-6 * np.eye(5)
        differences = [(value(numbers + h, share) - value(numbers - h, share)) / 2e-6 for h in steps]
        np.testing.assert_allclose(slope(numbers, share), differences, rtol=1e-4, atol=1e-5)


def test_a_foot_that_goes_nowhere_has_finite_gradients(pegasus):
    flight = Flight(jnp.asarray(0.1), jnp.asarray(0.0), jnp.tile(jnp.array([[0.0, 0.1]]), (5, 1)), jnp.asarray(0.02))
    foot = jnp.array([0.1, 0.2, 0.1])
    slope = jax.jacobian(lambda end: fly(foot, end, flight, jnp.asarray(0.4)))(foot)
    assert np.isfinite(slope).all()


def test_a_rounded_corner_leaves_the_polyline_by_no_more_than_said():
    corner, rounding = jnp.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]), 0.1
    points = np.asarray(jax.vmap(lambda s: along(corner, jnp.asarray(rounding), s))(jnp.linspace(0.0, 1.0, 2001)))
    off = np.minimum(np.abs(points[:, 0]), np.abs(1.0 - points[:, 1])).max()
    assert 0.1 * rounding < off <= 0.16 * np.sqrt(2.0) * rounding
    np.testing.assert_allclose(points[[0, -1]], [[0.0, 0.0], [1.0, 1.0]], atol=1e-9)


def test_a_corner_nearer_to_an_end_than_its_rounding_moves_neither_end():
    for corner in ([[0.0, 0.0], [0.0, 1.0], [0.03, 1.0]], [[0.0, 0.0], [0.0, 0.03], [1.0, 0.03]]):
        ends = jax.vmap(lambda s: along(jnp.asarray(corner), jnp.asarray(0.1), s))(jnp.array([0.0, 1.0]))  # noqa: B023
        np.testing.assert_allclose(ends, [corner[0], corner[-1]], atol=1e-9)
