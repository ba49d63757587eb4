"""Foothold features against NumPy's `eigh` from their definitions, cell by cell; and the cost under the feet."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import HEADINGS, LEG_END, LEGS, InputError
from jaxleg.terrain import HeightMap
from jaxleg.terrain.cost_map import CostSettings, cost_weights
from jaxleg.terrain.foothold_cost import (
    FEATURES,
    FeetSettings,
    FootWeights,
    LegWeights,
    foothold_cost,
    foothold_scores,
    windows,
)
from jaxleg.terrain.foothold_features import FootholdSettings, foothold_features, uphill

SHAPE, SIZE = (18, 18), 0.04
COST, UPHILL = jax.jit(foothold_cost), jax.jit(uphill)
SETTINGS = FootholdSettings()
LIMIT = np.array([0.1, 0.6, 0.4, 0.6])
STANCE = ((0.12, 0.10), (0.12, -0.10), (-0.14, 0.10), (-0.14, -0.10))
FEET = FeetSettings(length=0.16, width=0.08)  # as the fixture has it


def weights(seed=0):
    return FootWeights(np.random.default_rng(seed).dirichlet(np.ones(8), 4), LIMIT)


ALL = cost_weights(CostSettings())._replace(feet=weights())


@pytest.fixture(scope="module")
def compute(costs):
    """Foothold features of an elevation."""
    return lambda elevation: jax.device_get(costs(elevation, ALL)[0])


def ground(seed):
    rng = np.random.default_rng(seed)
    elevation = 3.0 * rng.normal() + np.cumsum(0.02 * rng.normal(size=SHAPE), axis=seed % 2)
    elevation[rng.random(SHAPE) < (0.0, 0.1, 0.5)[seed % 3]] = (np.nan, np.inf)[seed // 2 % 2]
    return elevation


def weights(seed=0):
    return FootWeights(np.random.default_rng(seed).dirichlet(np.ones(8), 4), LIMIT)


def surface(elevation, a, b):
    """Linear between the cells round a place; NaN if one of them is unseen or beyond the border."""
    total = 0.0
    for i, j in {(i, j) for i in (math.floor(a), math.ceil(a)) for j in (math.floor(b), math.ceil(b))}:
        seen = 0 <= i < SHAPE[0] and 0 <= j < SHAPE[1] and math.isfinite(elevation[i, j])
        total += (1 - abs(a - i)) * (1 - abs(b - j)) * (elevation[i, j] if seen else math.nan)
    return total


def plain(elevation, i, j, radius):
    """Curvature, slope, concavity, normal, and the gap l1 - l0 in parts of the trace, that the normal hangs on."""
    none = (math.nan, math.nan, math.nan, np.full(3, math.nan), math.nan)
    places = [(a, b) for a, b in np.ndindex(*SHAPE) if np.isfinite(elevation[a, b])]
    points = np.array([(SIZE * (a - i), SIZE * (b - j), elevation[a, b] - elevation[i, j]) for a, b in places])
    points = points[np.linalg.norm(points, axis=1) <= radius + 1e-4 * SIZE] if np.isfinite(elevation[i, j]) else points[:0]
    if len(points) < 3 or np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=1e-6) < 2:
        return none
    values, vectors = np.linalg.eigh(np.cov(points.T))
    normal = vectors[:, 0] * math.copysign(1.0, vectors[2, 0])
    angles = []
    for k in range(8):
        x, y = radius * math.cos(k * math.pi / 4), radius * math.sin(k * math.pi / 4)
        way = np.array([x, y, surface(elevation, round(i + x / SIZE, 9), round(j + y / SIZE, 9)) - elevation[i, j]])
        angles.append(math.acos(normal @ way / np.linalg.norm(way)))
    hollow = np.nanmean(angles) if not np.all(np.isnan(angles)) else math.nan
    return values[0] / values.sum(), math.acos(min(normal[2], 1.0)), hollow, normal, (values[1] - values[0]) / values.sum()


def oracle(elevation):
    rows = [[plain(elevation, i, j, radius) for i, j in np.ndindex(*SHAPE)] for radius in SETTINGS.radii]
    return [np.array([[row[k] for row in scale] for scale in rows]) for k in range(5)]


@pytest.mark.parametrize(("dtype", "least_gap"), [("float64", 1e-4), pytest.param("float32", 0.05, marks=pytest.mark.slow)])
def test_features_are_their_definitions(compute, dtype, least_gap):
    """Single precision keeps five digits of the critical values where the points show which way the normal goes."""
    rtol, sharp = (1e-5, 1e-5 * LIMIT) if dtype == "float32" else (1e-8, np.full(4, 1e-7))
    for seed in range(3):
        elevation = ground(seed).astype(dtype)
        ours, exact = compute(elevation), oracle(elevation.astype(float))
        clear = ~(exact[4] < least_gap)  # a normal that any direction would do for is nobody's error
        for name, critical, expected in zip(("curvature", "slope", "concavity"), sharp, exact):
            found = np.asarray(getattr(ours, name), float).reshape(2, -1)
            kept = clear | (name == "curvature")
            np.testing.assert_allclose(found[kept], expected[kept], rtol=rtol, atol=critical, err_msg=name)
        for heading in (0.0, 2.5):
            rise = np.arctan2(-exact[3] @ [math.cos(heading), math.sin(heading), 0.0], exact[3][..., 2])
            found = np.asarray(UPHILL(ours.normal, heading), float).reshape(2, -1)
            np.testing.assert_allclose(found[clear], rise[clear], rtol=rtol, atol=sharp[3])


def test_planes_hollows_and_bumps(compute):
    x = SIZE * np.arange(SHAPE[0])[:, None] + np.zeros(SHAPE)
    plane = compute(0.3 * x)
    inner = (slice(None), slice(5, -5), slice(5, -5))
    np.testing.assert_allclose(plane.curvature, 0.0, atol=1e-12)
    np.testing.assert_allclose(plane.slope, math.atan(0.3), rtol=1e-9)
    np.testing.assert_allclose(plane.concavity[inner], math.pi / 2, rtol=1e-9)
    for heading in (0.0, 1.0, math.pi):
        expected = math.atan(0.3 * math.cos(heading))
        np.testing.assert_allclose(UPHILL(plane.normal, heading), expected, rtol=1e-9)
    middle = np.hypot(*(np.mgrid[: SHAPE[0], : SHAPE[1]] - np.array([8, 6])[:, None, None])) * SIZE
    assert np.all(compute(0.5 * middle**2 / 0.1).concavity[:, 8, 6] < math.pi / 2)  # the bottom of a bowl
    assert np.all(compute(-0.5 * middle**2 / 0.1).concavity[:, 8, 6] > math.pi / 2)


def test_nothing_is_known_of_an_unseen_map(costs):
    features, cost = jax.device_get(costs(np.full(SHAPE, np.nan), ALL))
    assert all(np.all(np.isnan(x)) for x in features[:4])
    assert np.all(np.isinf(np.asarray(COST(features, weights(), 0, 0.0))))
    assert np.all(np.isinf(cost.feet))


def test_front_feet_like_it_uphill_and_hind_feet_downhill(compute):
    slope = 0.2 * SIZE * np.arange(SHAPE[0])[:, None] + np.zeros(SHAPE)
    features, only_uphill = compute(slope), np.array([0, 0, 0, 0.5, 0, 0, 0, 0.5])
    chosen = FootWeights(np.tile(only_uphill, (4, 1)), LIMIT)
    up = np.array([np.asarray(COST(features, chosen, leg, 0.0))[8, 6] for leg in range(4)])
    down = np.array([np.asarray(COST(features, chosen, leg, math.pi))[8, 6] for leg in range(4)])
    expected = 0.5 - 0.5 * np.array(LEG_END) * math.atan(0.2) / 0.6
    np.testing.assert_allclose(up, expected, rtol=1e-9)
    np.testing.assert_allclose(up + down, 1.0, rtol=1e-9)


def test_scores_and_costs_lie_between_0_and_1_in_the_order_of_their_names(compute):
    features = compute(ground(1))
    scores = np.asarray(jax.jit(foothold_scores)(features, LIMIT, 3, 0.7))
    seen = np.isfinite(ground(1))
    assert np.all(np.isnan(scores[:, ~seen]))
    assert np.all((scores[:, seen] >= 0) & (scores[:, seen] <= 1))
    for name, ours in zip(FEATURES, scores):
        kind, size = name.split("_")
        scale = ("small", "large").index(size)
        if kind in ("curvature", "slope"):
            critical = LIMIT[("curvature", "slope").index(kind)]
            expected = np.nan_to_num(np.clip(getattr(features, kind)[scale] / critical, 0, 1), nan=1.0)
            np.testing.assert_allclose(ours, np.where(seen, expected, np.nan), rtol=1e-12)
    cost = np.asarray(COST(features, weights(), 3, 0.7))
    expected = np.tensordot(weights().weight[3], scores, 1)
    np.testing.assert_allclose(cost, np.where(np.isnan(expected), np.inf, expected), rtol=1e-12)


def inside(window, along, across):
    """Within the window, by the corners of the rectangle or the triangle whose centre of area is the origin."""
    long, wide, near = FEET.length, FEET.width, 1e-6
    if window == "rectangle":
        return abs(along) <= long / 2 + near and abs(across) <= wide / 2 + near
    left = (2 / 3 * long - along) * wide / 2 / long  # half the width so far ahead
    return along >= -long / 3 - near and abs(across) <= left + 2 * near


def test_a_spike_and_a_wall_are_the_worst_footholds_but_known(compute):
    elevation = np.zeros(SHAPE)
    elevation[8, 6], elevation[:, 16:] = 1.0, 4.0 * SIZE * np.arange(2)
    elevation[3, 3] = np.nan
    cost = np.asarray(COST(compute(elevation), weights(), 0, 0.0))
    np.testing.assert_allclose(cost[[8, 8], [6, 17]], 1.0, rtol=1e-12)
    assert np.isinf(cost[3, 3])
    assert cost[12, 6] < 0.5


@pytest.mark.parametrize("window", ["rectangle", "triangle"])
def test_windows_turn_with_the_heading(window):
    settings = FeetSettings(window, FEET.length, FEET.width)
    for (dx, dy), row in zip(HEADINGS, windows(settings, STANCE, SIZE)):
        c, s = np.array([dx, dy]) / math.hypot(dx, dy)
        for (x, y), cells in zip(STANCE, row):
            middle = np.array([c * x - s * y, s * x + c * y])
            expected = set()
            for cell in np.ndindex(31, 31):
                from_middle = SIZE * (np.array(cell) - 15) - middle
                if inside(window, from_middle @ [c, s], from_middle @ [-s, c]):
                    expected.add((cell[0] - 15, cell[1] - 15))
            assert set(cells) == expected
            assert len(cells) == len(expected) > 0


def test_a_window_smaller_than_a_cell_is_the_nearest_one():
    stance = ((0.30, 0.17), (0.30, -0.17), (-0.30, 0.17), (-0.30, -0.17))
    assert windows(FeetSettings("rectangle", 0.01, 0.01), stance, SIZE)[0] == [((8, 4),), ((8, -4),), ((-8, 4),), ((-8, -4),)]


def test_feet_cost_is_the_mean_over_the_windows(costs):
    features, cost_map = costs(ground(1), ALL)
    expected = np.full((8, *SHAPE), np.inf)
    for k, row in enumerate(windows(FEET, STANCE, SIZE)):
        cost = [np.asarray(COST(features, ALL.feet, leg, k * math.pi / 4)) for leg in range(len(LEGS))]
        for i, j in np.ndindex(*SHAPE):
            legs = []
            for leg, cells in enumerate(row):
                there = [cost[leg][i + a, j + b] for a, b in cells if 0 <= i + a < SHAPE[0] and 0 <= j + b < SHAPE[1]]
                legs.append(np.mean([c for c in there if np.isfinite(c)] or [np.inf]))
            expected[k, i, j] = np.mean(legs)
    assert 0.05 < np.isfinite(expected).mean() < 1.0
    np.testing.assert_allclose(cost_map.feet, expected, rtol=1e-10)


@jax.jit
def derivatives(elevation, direction):
    """Along a direction: forward and reverse mode; the gradient, the value."""

    def total(z):
        features = foothold_features(HeightMap(z, jnp.zeros(2), jnp.array(SIZE)), SIZE, SETTINGS)
        return sum(jnp.nansum(x) for x in features[:3]) + jnp.nansum(uphill(features.normal, 0.4))

    gradient = jax.grad(total)(elevation)
    value, forward = jax.jvp(total, (elevation,), (direction,))
    return forward, jnp.sum(gradient * direction), gradient, value


@pytest.mark.slow  # long to compile; the analysis of the points has its own in test_principal
def test_derivatives():
    elevation = ground(1)
    direction = np.where(np.isfinite(elevation), np.random.default_rng(5).normal(size=SHAPE), 0.0)
    forward, reverse, gradient, _ = derivatives(elevation, direction)
    assert np.all(np.isfinite(gradient))
    step = 1e-7
    ends = [derivatives(elevation + s * direction, direction)[3] for s in (step, -step)]
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), forward, rtol=1e-5)
    for level in (np.zeros(SHAPE), 0.3 * SIZE * np.mgrid[: SHAPE[0], : SHAPE[1]][1]):
        assert np.all(np.isfinite(derivatives(level, direction)[2]))


def test_weights_that_do_not_sum_to_one_are_refused():
    with pytest.raises(InputError, match=r"^LH: weights sum to 0.9, but must sum to 1$"):
        LegWeights(LH=(0.9, *(0.0,) * 7))
    np.testing.assert_allclose(np.sum(LegWeights(RF=(0.3333, 0.6664, *(0.0,) * 6)).table(), axis=1), 1.0, rtol=1e-12)
