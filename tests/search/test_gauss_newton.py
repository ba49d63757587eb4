"""Descents in lock step on objectives with corners, known in closed form."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.search.convex import Corners, Problem, lowest
from jaxleg.search.gauss_newton import FAILED, Descents, begin, bent, counts, judged, on_others
from jaxleg.search.model import FREE, Model

TARGET = np.array([0.3, 0.7, 0.5])


def lanes(x, shift=(0.0,), failed=()):
    """A bowl round `TARGET` whose way down a corner stops: 100 (x0 + x1 - 1.3) and 100 (x1 - x0) must stay positive."""
    shift = np.asarray(shift, float)[:, None]
    apart = x - TARGET + shift
    rows = 100.0 * np.stack([np.full(len(shift), x[0] + x[1] - 1.3), np.full(len(shift), x[1] - x[0])], axis=1)
    slopes = 100.0 * np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    cost = np.sum(apart**2, axis=1)
    cost[list(failed)] = np.nan
    padded = np.full((len(shift), 1, 3), FREE)
    padded[:, 0, :2] = rows
    along = np.zeros((len(shift), 1, 3, 3))
    along[:, 0, :2] = slopes
    return Model(None, cost, 2.0 * apart, padded, along)


def descended(points, box, steps=40, **options):
    descents, asked = Descents(begin(points), box), []
    for _ in range(steps):
        wanted = descents.ask()
        asked.append(len(wanted))
        if not wanted:
            break
        descents.tell({run: judged(lanes(at, **options), np.ones(3)) for run, at in wanted.items()})
    return descents, asked


def whole(runs):
    return np.tile([0.0, 1.0], (runs, 3, 1))


def test_every_run_finds_the_corner_within_few_steps():
    """The lowest point on x0 + x1 = 1.3 is (0.45, 0.85, 0.5)."""
    rng = np.random.default_rng(0)
    descents, asked = descended(rng.uniform(0.0, 1.0, (6, 3)), whole(6))
    assert_allclose(descents.runs.at, np.tile([0.45, 0.85, 0.5], (6, 1)), atol=1e-2)
    assert_allclose(descents.runs.value, 2 * 0.15**2, atol=3e-4)
    assert len(asked) <= 14
    assert asked == sorted(asked, reverse=True)  # a run that has ended asks for nothing more


def test_each_stays_in_its_box_and_what_is_held_stays():
    box = whole(2)
    box[0, 2] = 0.8  # held
    box[1, 0] = (0.0, 0.2)
    points = np.array([[0.9, 0.9, 0.8], [0.1, 0.1, 0.1]])
    descents, _ = descended(points, box)
    assert_allclose(descents.runs.at, [[0.45, 0.85, 0.8], [0.2, 1.0, 0.5]], atol=0.03)
    assert descents.runs.at[0, 2] == 0.8
    assert descents.runs.at[1, 0] <= 0.2


def test_the_objective_is_the_mean_over_lanes_and_a_lane_that_fails_is_dear():
    at = np.array([0.2, 0.4, 0.5])
    seen = judged(lanes(at, shift=(0.0, 0.1), failed=(1,)), np.ones(3))
    violated = 100.0 * 0.7
    fined = 2.0 * (np.sqrt(1.0 + violated**2) - 1.0)
    assert_allclose(seen.value, (0.1**2 + 0.3**2 + fined + FAILED) / 2)
    assert_allclose(seen.slope, [-0.1, -0.3, 0.0])
    assert seen.rows.shape == (1, 3)
    both = judged(lanes(at, shift=(0.0, 0.1)), np.array([1.0, 10.0, 1.0]))
    assert_allclose(both.slope, [-0.1, -5.0, 0.1])
    assert both.rows.shape == (2, 3)
    assert_allclose(both.slopes[0, 0], [100.0, 1000.0, 0.0])


def test_a_lane_with_a_row_that_is_no_number_cannot_be_judged():
    sound = lanes(np.array([0.45, 0.85, 0.5]), shift=(0.0, 0.1))
    rows = sound.rows.copy()
    rows[1, 0, 0] = np.nan
    seen = judged(sound._replace(rows=rows), np.ones(3))
    assert_allclose(seen.value, (2 * 0.15**2 + FAILED) / 2)


@pytest.mark.parametrize(
    ("counted", "weights"),
    [
        ((0.0, 1.0), [0.2, 0.2, 0.2, 0.2, 0.2]),
        ((0.8, 1.0), [0.0, 1.0, 0.0, 0.0, 0.0]),
        ((0.7, 1.0), [0.0, 2 / 3, 0.0, 0.0, 1 / 3]),  # half of the second dearest
        ((0.0, 0.8), [0.25, 0.0, 0.25, 0.25, 0.25]),
        ((0.1, 0.3), [0.0, 0.0, 0.5, 0.5, 0.0]),
    ],
)
def test_lanes_count_by_their_place_in_the_order_of_cost(counted, weights):
    assert_allclose(counts(np.array([3.0, 9.0, 1.0, 2.0, 4.0]), counted), weights, atol=1e-12)


def test_the_dearest_share_is_what_rockafellar_and_uryasev_minimise():
    """CVaR is the least over t of t + mean(max(0, cost - t)) / share; the least is where t is one of the costs."""
    cost = np.random.default_rng(0).gamma(2.0, size=37)
    for share in (0.05, 0.1, 0.33, 1.0):
        least = min(t + np.maximum(cost - t, 0.0).mean() / share for t in cost)
        assert_allclose(counts(cost, (1.0 - share, 1.0)) @ cost, least)


def test_only_lanes_that_count_are_in_the_model():
    """The dearer of two lanes alone, slope and constraints too; and what may fail costs nothing."""
    at = np.array([0.6, 0.8, 0.5])
    both = lanes(at, shift=(0.0, 0.4))
    dearer, cheaper = (judged(Model(None, *(x[i : i + 1] for x in both[1:])), np.ones(3)) for i in (1, 0))
    for counted, alone in (((0.5, 1.0), dearer), ((0.0, 0.5), cheaper)):
        seen = judged(both, np.ones(3), counted)
        assert seen.value == alone.value
        assert_allclose(seen.slope, alone.slope)
        assert_allclose(seen.weight, alone.weight)
        assert_allclose(seen.rows, alone.rows)
    assert judged(lanes(at, shift=(0.0, 0.4), failed=(1,)), np.ones(3), (0.0, 0.5)).value == cheaper.value


def test_rows_that_cannot_be_the_least_are_left_out_without_changing_a_step():
    """Constraints of 300 rows by six numbers, some out of reach: the step is the lowest point of the model with all of them."""
    rng, box = np.random.default_rng(5), np.tile([0.0, 1.0], (1, 6, 1))
    for _ in range(4):
        rows, slopes = rng.normal(1.5, 0.6, (1, 8, 300)), rng.normal(size=(1, 8, 300, 6))
        rows[0, 6:] += 50.0
        slope = rng.normal(size=(1, 6))
        descents = Descents(begin(np.full((1, 6), 0.5)), box)
        descents.ask()
        descents.tell({0: judged(Model(None, np.zeros(1), slope, rows, slopes), np.ones(6))})
        descents.runs.radius[0] = 0.1
        step = descents.ask()[0] - 0.5
        everything = Problem(slope[0], descents.runs.curvature[0], [Corners(rows[0], slopes[0], np.ones(8))])
        assert_allclose(step, lowest(everything, np.full(6, -0.1), np.full(6, 0.1)), atol=1e-5)


def test_a_step_that_costs_is_not_taken_and_the_next_is_shorter():
    descents = Descents(begin(np.full((1, 3), 0.9)), whole(1))
    descents.ask()
    here = judged(lanes(np.full(3, 0.9)), np.ones(3))
    descents.tell({0: here})
    first = descents.ask()[0]
    descents.tell({0: here._replace(value=here.value + 1.0)})
    assert_allclose(descents.runs.at, 0.9)
    assert descents.runs.radius[0] == pytest.approx(0.4 * np.max(np.abs(first - 0.9)))
    second = descents.ask()[0]
    assert np.max(np.abs(second - 0.9)) <= descents.runs.radius[0] + 1e-9


def test_a_run_goes_on_from_where_it_was_kept():
    """The first question is for where it stands; then it comes to the same end."""
    points = np.array([[0.9, 0.1, 0.3], [0.2, 0.2, 0.2]])
    descents, _ = descended(points, whole(2), steps=4)
    again = Descents(descents.runs, whole(2))
    assert_allclose(list(again.ask().values()), descents.runs.at)
    ends = []
    for one in (descents, again):
        while wanted := one.ask():
            one.tell({run: judged(lanes(at), np.ones(3)) for run, at in wanted.items()})
        ends.append(one.runs)
    assert_allclose(ends[0].at, ends[1].at)
    assert ends[0].steps == ends[1].steps


def test_the_best_go_on_with_what_they_know_of_the_curvature():
    runs = begin(np.eye(3))._replace(radius=np.array([0.5, 0.01, 0.2]), steps=np.array(7, np.int32))
    picked = on_others(runs, np.array([2, 1, 1]))
    assert_allclose(picked.at, np.eye(3)[[2, 1, 1]])
    assert_allclose(picked.radius, [0.2, 0.05, 0.05])
    assert np.all(np.isinf(picked.value))
    assert picked.steps == 7
    assert not picked.ended


def test_curvature_is_learnt_along_the_step_and_stays_positive():
    true = np.diag([4.0, 1.0, 9.0])
    curvature = np.eye(3)
    rng = np.random.default_rng(1)
    for _ in range(60):
        step = rng.standard_normal(3)
        curvature = bent(curvature, step, true @ step)
        assert_allclose(curvature @ step, true @ step, rtol=1e-9)
    assert_allclose(curvature, true, atol=0.2)
    down = bent(curvature, np.array([1.0, 0.0, 0.0]), np.array([-5.0, 0.0, 0.0]))
    assert np.all(np.linalg.eigvalsh(down) > 0.0)
    np.testing.assert_array_equal(bent(curvature, np.zeros(3), np.ones(3)), curvature)
