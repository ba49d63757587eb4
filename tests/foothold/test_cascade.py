"""The cascade against a plain search cell by cell, its ties, its statuses, and its soft form."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.foothold.cascade import Reachable, choose_stance, reachable_heights
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.foothold.rectangle import Extent, SearchRectangle, extent_of, feasible_score
from jaxleg.leg.kinematics import Reach, knee_bend, leg_angles
from jaxleg.terrain import HeightMap
from jaxleg.terrain.heightmap import nearest_cell
from jaxleg.terrain.site import Site
from tests.crawls import gait

SIZE, STEP = 0.02, 0.2
EXTENT = extent_of(0.38, 0.08, STEP, SIZE, heading=None)
ORIGIN = np.array([-0.8, -0.5])
NOMINAL = np.array([[0.34, 0.18], [0.24, -0.18], [-0.26, 0.18], [-0.36, -0.18]])
REACHABLE = Reachable(*map(np.asarray, (-0.05, 0.04, STEP)))
ANYWHERE = Reachable(*map(np.asarray, (-9.0, 9.0, STEP)))


def rectangle(heading=0.0, w1=0.5):
    return SearchRectangle(*map(jnp.asarray, (0.30, 0.08, 0.08, w1, heading)))


def site(valid, elevation=None):
    elevation = np.zeros(valid.shape) if elevation is None else elevation
    return Site(HeightMap(elevation, ORIGIN, np.asarray(SIZE)), valid)


def one(nominal, ground, box, reachable=ANYWHERE, extent=EXTENT):
    return choose_stance(nominal, ground.valid, ground.terrain, box, reachable, extent)


chosen = jax.jit(one, static_argnames="extent")
many = jax.jit(jax.vmap(one, in_axes=(0, 0, 0, None)))


def plain_cascade(nominal, valid, elevation, heading, w1, low=-9.0, high=9.0):
    """Brute force over every cell of the map, in the words of paper A and its readings (A10, A11)."""
    cells = np.argwhere(np.ones(valid.shape, bool))
    seen = valid & np.isfinite(elevation)
    start = np.round((nominal - ORIGIN) / SIZE).astype(int)
    c, s = math.cos(heading), math.sin(heading)

    def along(leg):  # (ahead, left) of every cell
        offset = (cells - start[leg]) * SIZE
        return c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]

    def inside(leg, length):
        ahead, left = along(leg)
        return (abs(ahead) <= length / 2 + 2e-5) & (abs(left) <= 0.04 + 2e-5)

    def mean_height(leg):
        return elevation[seen & inside(leg, 0.38).reshape(valid.shape)]

    def preference(ahead, left, first):
        return (-round(first * 1e5), -round(ahead * 1e6), abs(round(left * 1e6)), -round(left * 1e6))

    level = []
    for leg in range(4):
        means = [h.mean() for h in (mean_height(mate) for mate in ((0, 1) if leg < 2 else (2, 3))) if h.size]
        level.append(np.mean(means) if means else np.nan)
    usable = []
    for leg in range(4):
        above = (elevation - level[leg]).reshape(-1)
        with np.errstate(invalid="ignore"):
            usable.append(seen.reshape(-1) & ~(above < low) & ~(above > high))
    for length, status in ((0.30, FootholdStatus.NOMINAL), (0.38, FootholdStatus.WIDENED)):
        found = [
            {tuple(o) for o in cells[usable[leg] & inside(leg, length)] - start[leg]} if usable[leg].any() else set()
            for leg in range(4)
        ]
        common = set.intersection(*found)

        def rank(o, length=length):
            ahead, left = c * o[0] * SIZE + s * o[1] * SIZE, c * o[1] * SIZE - s * o[0] * SIZE
            f = 1 - w1 * (abs(ahead) + abs(left)) / ((length + 0.08) / 2) - (1 - w1) * abs(left) / 0.04
            return preference(ahead, left, f)

        if common:
            return [min(common, key=rank)] * 4, [status] * 4
    places, states = [], []
    for leg in range(4):
        ahead, left = along(leg)
        squared = ahead**2 + left**2
        pools = (usable[leg] & inside(leg, 0.38), usable[leg] & (squared <= (STEP + 2e-5) ** 2))
        pool = next((np.flatnonzero(p) for p in pools if p.any()), [])
        best = min(pool, key=lambda k: preference(ahead[k], left[k], -100 * squared[k]), default=None)
        places.append((0, 0) if best is None else tuple(cells[best] - start[leg]))
        states.append(FootholdStatus.NONE if best is None else FootholdStatus.NEAREST)
    return places, states


def random_case(rng, shape):
    """A map with holes and bumps, sparse or dense, some legs off its border, a heading that is often a multiple of 45 deg."""
    share = rng.choice([0.0, 0.005, 0.02, 0.1, 0.4, 0.8, 0.97])
    valid = rng.random(shape) < share
    elevation = 0.02 * rng.normal(size=shape) + 0.1 * (rng.random(shape) < 0.1)
    elevation[rng.random(shape) < 0.1] = rng.choice([np.nan, np.inf])
    if rng.random() < 0.3:  # nothing valid round one leg: its last resort
        i, j = np.round((NOMINAL[rng.integers(4)] - ORIGIN) / SIZE).astype(int)
        valid[max(i - 10, 0) : i + 10, max(j - 5, 0) : j + 5] = False
    heading = rng.choice([0.0, np.pi / 4, np.pi / 2, -np.pi, rng.uniform(-np.pi, np.pi)])
    nominal = NOMINAL + rng.uniform(-0.3, 0.3, 2) * (rng.random() < 0.5) + rng.choice([0.0, 0.7, 3.0], p=[0.8, 0.15, 0.05])
    return nominal, valid, elevation, heading, rng.choice([0.0, 0.3, 0.5, 0.8, 1.0])


@pytest.mark.parametrize("number", [300, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("shape", [(80, 50), (56, 40), (70, 90), (24, 61), (9, 9)])
def test_the_cascade_is_the_plain_search(shape, number):
    """Identical cells and statuses on random maps, ten thousand in all."""
    rng, seen = np.random.default_rng(shape[1]), set()
    cases = [random_case(rng, shape) for _ in range(number)]
    nominal, valid, elevation, heading, w1 = (np.stack(x) for x in zip(*cases))
    grounds = Site(HeightMap(elevation, np.tile(ORIGIN, (number, 1)), np.full(number, SIZE)), valid)
    boxes = SearchRectangle(*(jnp.asarray(x) for x in (*np.full((3, number), [[0.30], [0.08], [0.08]]), w1, heading)))
    ours = jax.tree.map(np.asarray, many(nominal, grounds, boxes, REACHABLE))
    for k, case in enumerate(cases):
        places, states = plain_cascade(*case, low=-0.05, high=0.04)
        assert list(ours.status[k]) == states, k
        assert [tuple(c) for c in np.round(ours.offset[k] / SIZE).astype(int)] == places, k
        seen |= set(states)
    assert len(seen) == (4 if shape[0] >= 56 else 2)  # the small maps lie under one pair of legs only


@pytest.mark.parametrize(
    ("cells", "best"),
    [([(2, 0), (-2, 0)], (2, 0)), ([(0, 1), (0, -1)], (0, 1)), ([(1, 1), (2, 0)], (2, 0)), ([(0, 0), (1, 0)], (0, 0))],
)
def test_ties_go_forward_then_to_the_centre_line_then_left(cells, best):
    start = np.round((NOMINAL - ORIGIN) / SIZE).astype(int)
    valid = np.zeros((80, 50), bool)
    for i, j in cells:
        for a, b in start:
            valid[a + i, b + j] = True
    ours = chosen(NOMINAL, site(valid), rectangle())
    assert tuple(np.round(np.asarray(ours.offset)[0] / SIZE).astype(int)) == best


def test_the_rectangle_turns_with_the_heading():
    valid = np.random.default_rng(3).random((80, 50)) < 0.7
    offset = np.asarray(chosen(NOMINAL, site(valid), rectangle(np.pi / 2)).offset)[0]
    assert abs(offset[0]) <= 0.04 + 1e-9  # across the heading lies x now
    assert abs(offset[1]) <= 0.19 + 1e-9


def test_paper_figure_7_finds_the_cell_and_then_the_longer_rectangle():
    """Fig. 7: 3 x 5 cells; the common cell with the best score wins (d); if there is none, 3 x 7 cells do (g)."""
    box = SearchRectangle(*map(jnp.asarray, (0.08, 0.04, 0.04, 0.5, 0.0)))
    extent = Extent((3, 1), 10)
    start = np.round((NOMINAL - ORIGIN) / SIZE).astype(int)
    for common, status in (((1, 1), FootholdStatus.NOMINAL), ((-3, 0), FootholdStatus.WIDENED)):
        valid = np.zeros((80, 50), bool)
        valid[start[0][0] + 2, start[0][1]] = True  # valid for one leg only: forms no stance
        for a, b in start:
            valid[a + common[0], b + common[1]] = True
        ours = chosen(NOMINAL, site(valid), box, extent=extent)
        assert set(np.asarray(ours.status)) == {status}
        np.testing.assert_allclose(ours.offset, np.tile(np.array(common) * SIZE, (4, 1)), atol=1e-12)


def test_twelve_footholds_in_one_call_are_three_stances():
    ground = site(np.random.default_rng(3).random((80, 50)) < 0.6)
    nominal = NOMINAL - 0.2 + 0.2 * np.arange(3.0)[:, None, None] * [1.0, 0.0]
    along = jax.jit(jax.vmap(one, in_axes=(0, None, None)))(nominal, ground, rectangle())
    for offset, place in zip(np.asarray(along.offset), nominal):
        np.testing.assert_array_equal(offset, chosen(place, ground, rectangle()).offset)


def test_a_map_that_nobody_has_seen_gives_no_foothold():
    for hole in (np.nan, np.inf):
        ours = chosen(NOMINAL, site(np.ones((80, 50), bool), np.full((80, 50), hole)), rectangle())
        assert set(np.asarray(ours.status)) == {FootholdStatus.NONE}
        assert np.all(np.asarray(ours.offset) == 0.0)


@pytest.mark.parametrize(("height", "offset", "step"), [(0.5, -0.1, 0.2), (0.45, 0.05, 0.3)])
def test_the_lowest_foothold_is_where_the_leg_has_its_least_bend(pegasus, height, offset, step):
    """With the hip as low as the thigh is long over the ground, and the foot at the end of its sweep."""
    bend, thigh, ahead = 0.35, 0.26, abs(offset) + 0.5 * step
    ours = jax.jit(reachable_heights)(pegasus, gait(height=height, offset=offset, step=step), bend)
    axis, link = (np.asarray(x)[0] for x in (pegasus.joint_axis, pegasus.link_offset))
    foot = np.array([ahead, link[:, 1].sum(), ours.lowest - thigh])
    angles, status = jax.jit(leg_angles)(axis, link, pegasus.knee_sign, foot)
    assert status == Reach.OK
    np.testing.assert_allclose(jax.jit(knee_bend)(axis, link, angles), bend, atol=1e-9)
    np.testing.assert_allclose([ours.highest, ours.step], [height - thigh, step], atol=1e-12)


def test_the_score_is_one_at_nominal_and_zero_in_the_corner():
    box, score = rectangle(), jax.jit(feasible_score)
    assert score(np.zeros(2), box, 0.0) == 1.0
    assert abs(score(np.array([0.15, 0.04]), box, 0.0)) < 1e-12  # both distances at their largest: f = 0
    assert abs(score(np.array([0.19, 0.04]), box, 0.08)) < 1e-12


@pytest.mark.parametrize("nowhere", [np.nan, np.inf, -np.inf, 1e30])
def test_a_nominal_foothold_that_is_nowhere_finds_none(nowhere):
    """Not the map's first cell, which converting NaN to an integer gives."""
    ground = site(np.ones((80, 50), bool))
    nominal = NOMINAL.copy()
    nominal[1, 0] = nowhere
    found = chosen(nominal, ground, rectangle())
    assert np.asarray(found.status)[1] == FootholdStatus.NONE
    assert np.isfinite(found.offset).all()
    cell = np.asarray(jax.jit(nearest_cell)(ground.terrain, np.array([nowhere, 0.0])))
    assert not 0 <= cell[0] < 80
