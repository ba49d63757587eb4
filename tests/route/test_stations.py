"""Smoothed paths and the stations along them: lengths, bounded turns, arrival."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.route.stations import Along
from jaxleg.route.stations import smoothed as smooth
from tests.crawls import gait

GAIT = gait(step=0.2, length=0.56, width=0.42)  # 0.35 m from the stance's centre to a foot
ROUTE = Along(jnp.asarray(np.deg2rad(15.0)))
smoothed = jax.jit(lambda points, length, window: smooth(points, length, jnp.array(0.02), window, 400))
placed = jax.jit(lambda line: ROUTE.stations(GAIT, line, 120))


def make(points, length, window=0.5):
    return jax.tree.map(np.asarray, smoothed(points, length, window))


def along(route):
    return jax.tree.map(np.asarray, placed(route))


def corner(angle, cells=60):
    """A path that goes straight for 2 m, then turns by an angle and goes on for 2 m; padded by its end."""
    ahead = np.arange(cells) * 2.0 / (cells - 1)
    first = np.column_stack([ahead, np.zeros(cells)])
    second = first[-1] + ahead[1:, None] * [np.cos(angle), np.sin(angle)]
    path = np.concatenate([first, second])
    return np.concatenate([path, np.repeat(path[-1:], 30, axis=0)]), len(path)


def test_a_straight_path_stays_what_it_is():
    route = make(*corner(0.0))
    np.testing.assert_allclose(route.length, 4.0, atol=1e-9)
    np.testing.assert_allclose(route.xy[:200], np.column_stack([0.02 * np.arange(200), np.zeros(200)]), atol=1e-9)
    np.testing.assert_allclose(route.xy[200:], np.broadcast_to([4.0, 0.0], (200, 2)), atol=1e-9)
    np.testing.assert_allclose(route.direction[:200], 0.0, atol=1e-9)
    found = along(route)
    assert found.count == 40  # half cycles of 0.1 m
    np.testing.assert_allclose(np.diff(found.xy[:40, 0]), 0.1, atol=1e-6)


def test_a_path_that_repeats_its_end_has_gradients():
    """Every path is filled up by its end."""
    points, length = corner(np.deg2rad(30.0), 20)

    @jax.jit
    def slopes(points):
        total = lambda p: jnp.sum(smooth(p, jnp.array(length), jnp.array(0.02), jnp.array(0.5), 50).xy)  # noqa: E731
        return jax.grad(total)(points), jax.jvp(total, (points,), (jnp.ones_like(points),))[1]

    reverse, forward = slopes(jnp.asarray(points))
    assert np.all(np.isfinite(reverse))
    np.testing.assert_allclose(np.sum(reverse), forward, rtol=1e-9)


@pytest.mark.parametrize("degrees", [45.0, 90.0, 135.0])
def test_corners_are_rounded_and_turned_by_bounded_steps(degrees):
    points, length = corner(np.deg2rad(degrees))
    route = make(points, length)
    ends = route.xy[[0, -1]]
    np.testing.assert_allclose(ends, points[[0, -1]], atol=1e-9)
    apart = np.min(np.linalg.norm(route.xy[:, None] - points, axis=-1), axis=1)
    assert apart.max() < 0.5 * 0.5  # nowhere further from the path than half the window
    assert np.abs(np.diff(route.direction)).max() < np.deg2rad(degrees) / 3.0  # the path's own corner is one jump
    found = along(route)
    yaw, xy, count = found.yaw, found.xy, int(found.count)
    turn, stride = np.abs(np.diff(yaw)), np.linalg.norm(np.diff(xy, axis=0), axis=1)
    assert turn.max() <= np.deg2rad(7.5) + 1e-9  # half a cycle's
    assert np.all(stride[: count - 1] + 0.35 * turn[: count - 1] <= 0.1 + 1e-6)
    np.testing.assert_allclose(yaw[count + 5], np.deg2rad(degrees), atol=np.deg2rad(8.0))
    np.testing.assert_allclose(xy[count:], np.broadcast_to(ends[1], xy[count:].shape), atol=1e-6)


def test_a_path_that_crosses_west_does_not_jump_by_a_full_turn():
    points, length = corner(np.deg2rad(40.0))
    west = points @ np.array([[-np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), -np.cos(0.3)]])
    route = make(west, length)
    assert np.abs(np.diff(route.direction)).max() < 0.3


def test_a_path_of_one_cell_has_arrived():
    points = 0.3 + 0.0 * corner(0.0)[0]
    found = along(make(points, 1))
    assert found.count == 0
    assert np.all(np.isfinite(found.xy))
    assert np.all(np.isfinite(found.yaw))
