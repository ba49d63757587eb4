"""A search's rounds: where it starts, who goes on to more terrains, what is kept, and that it finds the bottom."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.search.descent import Keep, ranges, rounds, searched, starts_of
from jaxleg.search.lanes import Setting
from jaxleg.search.model import FREE, Model
from jaxleg.search.training import Lanes
from tests.stand_ins import StandInLab

WIDE = np.array([[0.4, 0.6], [-0.2, 0.1], [0.3, 0.3]])  # the last one is held
NARROW = np.array([[0.48, 0.52], [-0.2, 0.1], [0.3, 0.3]])
TARGET = np.array([0.45, 0.0, 0.3])


class Bowl(StandInLab):
    """A lab whose cost is a bowl round `TARGET`, tilted by the terrain's number; no constraint binds."""

    def __init__(self):
        super().__init__(seen=[], counted=(0.0, 1.0))

    def models(self, vectors, site, setting, reach):
        site = site[:]
        self.seen.append(np.asarray(site).tolist())
        apart, tilt = np.asarray(vectors, float) - TARGET, 0.02 * (np.asarray(site) - 3.5)[:, None]
        lanes = len(apart)
        cost = 10.0 * np.sum(apart**2, axis=1) + np.sum(tilt * apart, axis=1)
        return Model(cost, cost, 20.0 * apart + tilt, np.full((lanes, 1, 2), FREE), np.zeros((lanes, 1, 2, 3)))


def lanes(number):
    return Lanes(np.arange(number), Setting(*(np.ones(number) for _ in range(3))))


def test_ranges_scale_by_the_widest_and_hold_what_is_held():
    span = ranges(np.stack([NARROW, WIDE]))
    assert_allclose(span.box[0, 0], [0.4, 0.6])
    assert_allclose(span.box[1, :2], [[0.0, 1.0], [0.0, 1.0]])
    assert_allclose(span.box[:, 2], 0.0)
    assert_allclose(span.vectors(span.scaled(TARGET[None])), TARGET[None])


def test_more_terrains_and_fewer_starts_round_by_round():
    assert rounds(88, 4, 4) == [(4, 4), (16, 2), (64, 1), (88, 1)]
    assert rounds(1, 4, 5) == [(1, 5), (1, 5)]
    assert rounds(16, 4, 1) == [(4, 1), (16, 1)]
    assert rounds(6, 8, 3) == [(6, 3), (6, 3)]


def test_searches_start_at_what_is_known():
    """Two searches with three starts each: the known sets come first in either, the third is drawn."""
    known = np.array([[0.5, 0.0, 0.3], [0.55, -0.1, 0.3]])
    span = ranges(np.stack([WIDE, NARROW]))
    points = span.vectors(starts_of(jax.random.key(0), known, span, 3))
    assert_allclose(points[[0, 1]], known, atol=1e-12)
    assert_allclose(points[[3, 4]], [[0.5, 0.0, 0.3], [0.52, -0.1, 0.3]], atol=1e-12)  # as far as the band allows
    assert abs(points[2, 1] - points[5, 1]) > 1e-3  # each draws its own
    inside = points.reshape(2, 3, 3)
    for search, bounds in enumerate((WIDE, NARROW)):
        assert np.all((inside[search] >= bounds[:, 0] - 1e-12) & (inside[search] <= bounds[:, 1] + 1e-12))
    assert starts_of(jax.random.key(0), known, span, 1).shape == (2, 3)


def test_each_search_finds_its_bottom_on_all_terrains():
    """Eight terrains' tilts cancel; the first round's four do not."""
    bowl, span = Bowl(), ranges(np.stack([NARROW, WIDE]))
    points = starts_of(jax.random.key(1), np.zeros((0, 3)), span, 2)
    best, value = searched(bowl, lanes(8), span, points, rounds(8, 4, 2), steps=12)
    assert_allclose(best, [[0.48, 0.0, 0.3], [0.45, 0.0, 0.3]], atol=5e-3)
    assert_allclose(value, [10 * 0.03**2, 0.0], atol=5e-4)
    assert len(bowl.seen[0]) == 4 * 4
    assert set(bowl.seen[0]) == {0, 2, 5, 7}  # spread evenly
    assert len(bowl.seen[-1]) <= 2 * 8


def test_a_search_goes_on_from_a_narrower_ones_end():
    """The wider search begins where it gains nothing; the narrower one's end is handed on, and the other way it is not."""
    span = ranges(np.stack([NARROW, WIDE]))
    points = span.scaled(np.array([[0.5, -0.2, 0.3], [0.6, 0.1, 0.3]]))
    best, value = searched(Bowl(), lanes(1), span, points, [(1, 1), (1, 1)], steps=1)
    assert value[1] <= value[0]
    assert 0.48 - 1e-9 <= best[0, 0] <= 0.52 + 1e-9


def test_a_narrower_ones_end_beyond_its_own_bounds_is_not_handed_on():
    """The second search's bounds lie beside the first's, and where it may go it costs more."""
    beside = np.array([[0.55, 0.6], [-0.2, 0.1], [0.3, 0.3]])
    span = ranges(np.stack([NARROW, beside]))
    points = starts_of(jax.random.key(3), np.zeros((0, 3)), span, 2)
    best, value = searched(Bowl(), lanes(1), span, points, [(1, 2), (1, 1)], steps=12)
    assert best[1, 0] == pytest.approx(0.55, abs=2e-3)
    assert value[1] > value[0]


class Kept(Keep):
    """Keeps every round in a dictionary, and is killed after so many saves."""

    def __init__(self, rounds, saves=None):
        self.rounds, self.left, self.steps = rounds, saves, []

    def load(self, number, like):
        if number in self.rounds:
            assert jax.tree.map(np.shape, like) == jax.tree.map(np.shape, self.rounds[number])
        return self.rounds.get(number)

    def save(self, number, runs):
        self.rounds[number] = runs
        if self.left is not None:
            self.left -= 1
            if not self.left:
                raise KeyboardInterrupt

    def report(self, number, terrains, runs):
        self.steps.append((number, terrains, int(runs.steps)))


@pytest.mark.parametrize("saves", [1, 2, 3])
def test_a_search_killed_again_and_again_reaches_the_same_answer(saves):
    span = ranges(WIDE[None])
    points = starts_of(jax.random.key(2), np.zeros((0, 3)), span, 3)
    plan, alone = rounds(8, 2, 3), Kept({})
    wanted = searched(Bowl(), lanes(8), span, points, plan, 5, alone)
    rounds_kept, killed = {}, 0
    while True:
        try:
            got = searched(Bowl(), lanes(8), span, points, plan, 5, Kept(rounds_kept, saves))
            break
        except KeyboardInterrupt:
            killed += 1
    assert killed >= len(alone.steps) // saves
    for a, b in zip(wanted, got):
        np.testing.assert_array_equal(a, b)
    steps = [step for _, _, step in alone.steps]
    assert steps == sorted(set(steps))  # counted through all rounds
