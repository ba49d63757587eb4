"""Terrain profiles against scipy, arcs against quadrature, first contacts against dense sampling and bisection."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.optimize import brentq

from jaxleg.swing import profile
from jaxleg.swing.arc import Arc, first_touch, length_to, period, point_at, velocity_at
from jaxleg.swing.contact import skin

N = 10_000
natural_spline, height, slope = (jax.jit(f) for f in (profile.natural_spline, profile.height, profile.slope))
bounds_between, place = jax.jit(profile.bounds_between), jax.jit(point_at)


def terrains(count, seed=0):
    heights = np.random.default_rng(seed).uniform(1.0, 7.0, (count, 15))  # the roughest row of B's tables, literally
    heights[:, 0] = 3.0
    return heights


def arcs(count):
    rise = np.random.default_rng(1).uniform(0.3, 4.0, count)
    start = np.tile([0.0, 3.0 + skin(np.dtype(float))], (count, 1))
    return Arc(start, np.full(count, 8.0), rise, np.zeros(count), np.ones(count))


def test_the_natural_spline_is_scipys_with_its_slope_and_bounds():
    x = np.linspace(0.0, 14.0, 701)
    for heights in terrains(20):
        ours, theirs = natural_spline(heights), CubicSpline(np.arange(15), heights, bc_type="natural")
        np.testing.assert_allclose(height(ours, x), theirs(x), atol=1e-10)
        np.testing.assert_allclose(slope(ours, x), theirs(x, 1), atol=1e-9)
        for start, end in ((2.3, 2.9), (4.5, 5.6), (6.7, 6.2), (1.0, 9.0)):
            steep, bent = (float(v) for v in bounds_between(ours, start, end))
            between = np.linspace(start, end, 500)
            assert np.abs(theirs(between, 1)).max() <= steep * (1 + 1e-9)
            assert np.abs(theirs(between, 2)).max() <= bent * (1 + 1e-9)
            if abs(end - start) > 2.0:
                assert steep < 1.05 * np.abs(theirs(x, 1)).max()
                np.testing.assert_allclose(bent, np.abs(theirs(np.arange(15), 2)).max(), rtol=1e-9)


def test_hermite_is_scipys():
    x, y, m = np.arange(5) * 0.5 + 2.0, *np.random.default_rng(1).normal(size=(2, 5))
    ours, theirs = jax.jit(profile.hermite)(y, m, 2.0, 0.5), CubicHermiteSpline(x, y, m)
    at = np.linspace(2.0, 4.0, 101)
    np.testing.assert_allclose(height(ours, at), theirs(at), atol=1e-12)
    np.testing.assert_allclose(slope(ours, at), theirs(at, 1), atol=1e-11)


@pytest.mark.parametrize(("begin", "end"), [(0.0, 1.0), (0.0, 0.5), (0.5, 1.0)])
def test_an_arc_begins_at_its_start_and_has_the_length_of_its_path(begin, end):
    arc = Arc(np.array([1.0, 2.0]), 3.0, 1.5, begin, end)
    np.testing.assert_allclose(place(arc, arc.begin), [1.0, 2.0])

    def speed(s):
        return np.hypot(3.0 * (1.0 - np.cos(2 * np.pi * s)), 1.5 * np.pi * np.sin(2 * np.pi * s))

    np.testing.assert_allclose(jax.jit(length_to)(arc, arc.end), quad(speed, begin, end)[0], rtol=1e-6)


@pytest.mark.parametrize(("stride", "rise"), [(8.0, 1.5), (2.0, 1.5), (0.0, 2.0), (-0.5, 0.0), (1.0, 0.4502)])
def test_the_period_is_that_of_a_peak_speed_of_one(stride, rise):
    arc = Arc(np.array([1.0, 2.0]), stride, rise, 0.0, 1.0)
    share = np.linspace(0.0, 1.0, 4001)
    speed = np.hypot(*np.gradient(np.asarray(place(arc, share)), share, axis=0).T) / float(jax.jit(period)(arc))
    np.testing.assert_allclose(speed.max(), 1.0, atol=1e-5)
    np.testing.assert_allclose(np.hypot(*np.asarray(jax.jit(velocity_at)(arc, 0.3))), speed[1200], atol=1e-5)


@pytest.fixture(scope="module")
def touched():
    splines = jax.jit(jax.vmap(profile.natural_spline))(terrains(N))
    return jax.device_get((splines, arcs(N), jax.jit(jax.vmap(first_touch))(arcs(N), splines)))


@pytest.mark.parametrize("count", [N // 10, pytest.param(N, marks=pytest.mark.slow)])
def test_no_contact_is_tunnelled_through(touched, count):
    """None of 10,000 paths has been below the terrain, at 1e5 samples each, before the contact that was found."""
    splines, paths, touch = jax.tree.map(lambda x: x[:count], touched)
    assert not np.any(touch.lost)
    assert 0.5 < np.mean(touch.hit) < 1.0

    @jax.jit
    def first_below(spline, path):
        at = jnp.linspace(0.0, 1.0, 100_001)
        point = point_at(path, at)
        below = point[:, 1] < profile.height(spline, point[:, 0])
        return jnp.where(jnp.any(below), at[jnp.argmax(below)], jnp.inf)

    sampled = np.asarray(jax.lax.map(lambda pair: first_below(*pair), (splines, paths)))
    ours = np.where(touch.hit, touch.share, np.inf)
    assert np.all(ours <= sampled)
    both = np.isfinite(sampled) & np.isfinite(ours)
    assert np.mean(sampled[both] - ours[both] < 1.1e-5) > 0.999  # the others only graze the ground first


def test_the_point_is_that_of_bisection(touched):
    _, paths, touch = touched
    heights, checked = terrains(N), 0
    for k in np.flatnonzero(touch.hit)[:200]:
        path = jax.tree.map(lambda x, k=k: x[k], paths)
        terrain = CubicSpline(np.arange(15), heights[k], bc_type="natural")
        rise = float(path.rise)

        def gap(s, terrain=terrain, rise=rise):
            x = 8.0 * (s - np.sin(2 * np.pi * s) / (2 * np.pi))
            return 3.0 + skin(np.dtype(float)) + 0.5 * rise * (1 - np.cos(2 * np.pi * s)) - terrain(x)

        share = float(touch.share[k])
        if gap(share + 1e-4) < 0.0 < gap(share - 1e-4):
            root = brentq(gap, share - 1e-4, share + 1e-4, xtol=1e-13)
            np.testing.assert_allclose(place(path, root), touch.point[k], atol=1e-5)
            checked += 1
    assert checked > 150
