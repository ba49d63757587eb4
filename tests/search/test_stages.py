"""The polish on an objective known in closed form, and which lanes it sees."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.search import stages
from jaxleg.search.config import MOVE, Kind, Search, Study, Terrains
from jaxleg.search.contestants import bounds
from jaxleg.search.lanes import Setting
from jaxleg.search.stages import judge, polish
from jaxleg.search.training import Lanes, pooled, spread
from tests.stand_ins import StandInLab, StandInRun

BEST = np.array([0.55, -0.05, 0.12, 0.28, 0.6, 0.38, 0.05, 0.4, 0.5, 0.1])  # of the simulation below
WIDTH = np.array([high - low for low, high in MOVE.values()])


def lanes(*numbers):
    count = len(numbers)
    return Lanes(np.array(numbers, float), Setting(*(np.ones(count) for _ in range(3))))


class Bowl(StandInLab):
    """A simulation that likes `BEST`; terrain 9 is a fall."""

    def __init__(self, counted=(0.0, 1.0)):
        super().__init__(counted=counted)

    def simulate_lanes(self, vectors, site, setting):
        apart = (np.asarray(vectors) - BEST) / WIDTH
        site = np.asarray(site)
        return SimpleNamespace(objective=np.sum(apart**2, axis=1) + site), SimpleNamespace(fell=site == 9)

    def simulate_gradients(self, vectors, site, setting):
        score, meters = self.simulate_lanes(vectors, site, setting)
        return score, meters, 2.0 * (np.asarray(vectors) - BEST) / WIDTH**2


def state(**search):
    return StandInRun(Study(kinds={"flat": Kind()}, search=Search(**search)), Bowl())


def test_the_mean_over_lanes_counts_what_fails_ten_times_the_baseline():
    values = lambda rows, site, setting: np.where(site == 2, np.nan, rows[:, 0] + site)  # noqa: E731
    vectors = np.array([[0.5], [0.7]])
    assert_allclose(judge(values, vectors, lanes(0, 1)), [1.0, 1.2])
    assert_allclose(judge(values, vectors, lanes(0, 1, 2)), [(0.5 + 1.5 + 10.0) / 3, (0.7 + 1.7 + 10.0) / 3])


def test_a_fall_is_never_the_best():
    values = stages.simulated_objective(Bowl(), np.array([BEST, BEST]), np.array([0.0, 9.0]), None)
    assert_allclose(values, [0.0, np.inf])
    value, gradient = stages.simulated_gradient(Bowl(), BEST - 0.1 * WIDTH, lanes(0.0, 9.0))
    assert_allclose(value, (10 * 0.01 + 10.0) / 2)
    assert_allclose(gradient, 0.5 * -0.2 / WIDTH)  # the mean over both lanes, the fallen one's gradient left out


def test_lanes_are_spread_evenly_and_pooled_kind_by_kind():
    assert spread(lanes(*range(11)), 3).site.tolist() == [0, 5, 10]
    assert spread(lanes(1, 2), 5).site.tolist() == [1, 2]
    training = {"a": lanes(0, 1, 2), "b": lanes(10, 11)}
    assert pooled(training, ("a", "b")).site.tolist() == [0, 1, 2, 10, 11]
    assert pooled(training, ("b",)).site.tolist() == [10, 11]


@pytest.mark.parametrize("count", [8, 16, 23, 64, 100, 128, 256])
def test_lanes_spread_over_pooled_kinds_are_of_all_kinds_and_difficulties(count):
    """Four kinds of 128 lanes, in the order of their difficulty."""
    kinds = {name: lanes(*(1000 * i + np.arange(128))) for i, name in enumerate("abcd")}
    seen = spread(pooled(kinds, tuple("abcd")), count).site
    for i in range(4):
        own = np.sort(seen[seen // 1000 == i]) - 1000 * i
        assert abs(len(own) - count / 4) <= 2
        assert abs(own.mean() - 63.5) < 128 / len(own)


def test_a_polish_counts_the_lanes_that_the_search_counts():
    """The dearest half of four lanes: of the one that fell it knows no slope."""
    four = lanes(0.0, 1.0, 2.0, 9.0)
    lab = Bowl(counted=(0.5, 1.0))
    value, gradient = stages.simulated_gradient(lab, BEST - 0.1 * WIDTH, four)
    assert_allclose(value, (2.0 + 10 * 0.01 + 10.0) / 2)
    assert_allclose(gradient, 0.5 * -0.2 / WIDTH)
    values = lambda *x: stages.simulated_objective(lab, *x)  # noqa: E731
    assert_allclose(judge(values, BEST[None], four, lab.counted), [(2.0 + 10.0) / 2])


@pytest.mark.parametrize("one_for_all", [False, True])
def test_the_work_ahead_is_the_most_steps_of_all_rounds(one_for_all):
    """Five and four terrains, two at first: three rounds and two; nine together: three."""
    search, terrains = Search(lanes=2, steps=7), Terrains(train=9)
    study = Study(kinds={"a": Kind(), "b": Kind()}, search=search, terrains=terrains, one_for_all=one_for_all)
    steps = 7 * 3 if one_for_all else 7 * 2 + 7 * 2
    assert stages.work(study) == steps * stages.STEP_UNITS + 18.0 * 2 + 10.0


def test_polish_goes_down_and_keeps_what_is_better():
    begin = BEST - 0.2 * WIDTH * np.array([1, 1, -1, -1, 1, 1, 1, 1, 1, 1])
    best = np.stack([begin - 1.0, begin - 2.0, np.clip(begin, *bounds(state().study, "flat", "best").T)])
    steps = [polish(state(polish_steps=n, polish_rate=0.3), ("flat",), {"flat": lanes(0.0)}, best) for n in (1, 3)]
    apart = [np.sum(((x[-1] - BEST) / WIDTH) ** 2) for x in (best, *steps)]
    assert apart[0] > apart[1] > apart[2]
    for polished in steps:
        np.testing.assert_array_equal(polished[:-1], best[:-1])  # only the last search's answer is polished
    none = polish(state(polish_steps=0), ("flat",), {"flat": lanes(0.0)}, best)
    np.testing.assert_array_equal(none, best)


def test_a_polishing_step_too_long_is_halved_until_it_helps():
    """From next to the bottom a step of ten flies past it; after halvings the answer is no worse than where it began."""
    best = np.stack([BEST, BEST, BEST - 0.02 * WIDTH])
    polished = polish(state(polish_steps=5, polish_rate=10.0), ("flat",), {"flat": lanes(0.0)}, best)[-1]
    before, after = (np.sum(((x - BEST) / WIDTH) ** 2) for x in (best[-1], polished))
    assert after <= before * (1.0 + 1e-6)
    once = polish(state(polish_steps=1, polish_rate=10.0), ("flat",), {"flat": lanes(0.0)}, best)[-1]
    assert_allclose(once, best[-1], rtol=1e-6)


@pytest.mark.parametrize("stage", ["best_i", "best_ii", "best"])
def test_each_search_moves_what_it_says_and_holds_the_rest(stage):
    study = state().study
    span = bounds(study, "flat", stage)
    span = dict(zip(study.search.move, span))
    moved = {name for name, (low, high) in span.items() if high > low}
    assert moved == ({"gait.workspace.high", "gait.foot_offset", "gait.skew"} if stage != "best" else set(MOVE))
    assert tuple(span["gait.workspace.high"]) == ((0.48, 0.52) if stage == "best_i" else MOVE["gait.workspace.high"])
    if stage != "best":
        assert_allclose(span["gait.step_length"], study.contestants.paper.step_length)


def test_the_first_searches_move_what_of_the_stance_a_study_moves():
    study = state(move=("posture.cog.ratio", "gait.skew")).study
    study.bounds["posture.cog.ratio"] = (0.2, 0.8)
    for stage, ratio in (("best_i", (0.5, 0.5)), ("best_ii", (0.5, 0.5)), ("best", (0.2, 0.8))):
        assert_allclose(bounds(study, "flat", stage), [ratio, (0.0, 0.2)])
