"""Savings: pairs, intervals, and who is left out."""

import jax
import numpy as np
import pytest

from jaxleg.search import contest as contests
from jaxleg.search.contest import (
    ACTIVE,
    Contest,
    active_constraints,
    bootstrap,
    failed,
    failures,
    keeps_limits,
    nested,
    savings,
    summary,
    workspace,
)
from jaxleg.search.lanes import CONSTRAINTS, SCALES, Score, penalty
from jaxleg.sim.meters import Meters
from jaxleg.status import Status
from jaxleg.walk.data import PlanChecks

NAMES = ("traditional", "paper", "best")


def contest(energy, fell=None, infeasible=None, slack=None):
    energy = np.asarray(energy, float)
    zero, no = np.zeros(energy.shape), np.zeros(energy.shape, bool)
    by_constraint = np.full((*energy.shape, len(CONSTRAINTS)), 1.0) if slack is None else slack
    return Contest(
        np.stack([energy, 2 * energy, 3 * energy], axis=-1),
        *(zero, zero, zero, zero, zero, zero, np.zeros((*energy.shape, 4)), zero, np.zeros((*energy.shape, 4))),
        no if fell is None else np.asarray(fell),
        no if infeasible is None else np.asarray(infeasible),
        by_constraint,
    )


def test_a_known_saving_is_found_under_every_convention():
    rng = np.random.default_rng(0)
    base = rng.uniform(900, 1100, 200)
    held = contest([base, base * 0.8, base * 0.6 + rng.normal(0, 5, 200)])
    for row in savings(held, NAMES, "traditional", 500, 0)["best"].values():
        assert row["mean"] == pytest.approx(0.4, abs=2e-3)
        assert row["ci95"][0] < 0.4 < row["ci95"][1]
        assert row["ci95"][1] - row["ci95"][0] < 0.01
    against = savings(held, NAMES, "paper", 500, 0)["best"]["net"]["mean"]
    assert against == pytest.approx(0.25, abs=3e-3)


def test_a_fallen_or_infeasible_lane_leaves_the_pair_for_both():
    fell = [[False, True, False], [False] * 3, [False] * 3]
    unfit = [[False] * 3, [False] * 3, [True, False, False]]
    held = contest([[1e9, 1e9, 100.0], [1.0] * 3, [1.0, 1.0, 50.0]], fell, unfit)
    row = savings(held, NAMES, "traditional", 100, 0)["best"]["net"]
    assert row == {"mean": 0.5, "ci95": None}  # a single pair has no interval


@pytest.mark.parametrize("convention", [0, 1, 2])
def test_a_lane_without_a_number_under_one_convention_counts_under_none(convention):
    held = contest([[100.0, 100.0], [50.0, 50.0]])
    held.energy[1, 0, convention] = np.nan
    assert held.usable.tolist() == [[True, True], [False, True]]


def test_no_pairs_is_null_not_zero():
    held = contest([[1.0], [1.0], [1.0]], infeasible=[[True], [False], [False]])
    assert savings(held, NAMES, "traditional", 100, 0)["best"]["net"] == {"mean": None, "ci95": None}


def test_the_interval_covers_the_mean_as_often_as_it_says():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(200):
        low, high = bootstrap(rng.normal(0, 1, 40), 300, 2)["ci95"]
        inside += low < 0 < high
    assert 0.88 <= inside / 200 <= 0.99


def test_what_binds_is_named():
    slack = np.full((3, 2, len(CONSTRAINTS)), 1.0)
    slack[2, 1, CONSTRAINTS.index("margin")] = 0.001
    bounds = {"skew": (0.0, 1.0), "swing_height": (0.0, 1.0), "posture.cog.ratio": (0.2, 0.8), "step_length": (0.2, 0.2)}
    params = {"skew": 0.5, "swing_height": 0.0, "posture.cog.ratio": 0.795, "step_length": 0.2, "workspace.high": 0.0}
    named = active_constraints(contest(np.ones((3, 2)), slack=slack), 2, params, bounds)
    assert named == ["margin", "swing_height at its lower bound", "posture.cog.ratio at its upper bound"]


def test_a_plan_beyond_a_joints_range_is_infeasible_and_punished():
    """A robot with knees from 48 degrees on that is given 20: 28 units of a degree."""
    checks = PlanChecks(*map(np.asarray, (np.deg2rad(20.0), 0.1, 0.5, 1.0, np.deg2rad(-28.0), 0.0, None, 1.0, None, Status.OK)))
    assert not keeps_limits(checks, np.deg2rad(20.0))
    assert keeps_limits(checks._replace(joint_room=np.asarray(np.deg2rad(-0.1))), np.deg2rad(20.0))
    assert not keeps_limits(checks._replace(joint_room=np.asarray(np.nan)), np.deg2rad(20.0))
    slack = np.where(np.array(CONSTRAINTS) == "joint_range", np.deg2rad(-28.0), 1.0)
    assert jax.jit(penalty)(slack) == pytest.approx(2.0 * (np.hypot(1.0, 28.0) - 1.0))
    assert set(ACTIVE) == set(CONSTRAINTS)
    assert len(SCALES) == len(CONSTRAINTS)


def test_one_contestants_figures_by_hand():
    """Four lanes: two that count, one that fell, one infeasible. Means over those that count, the rest is counted."""
    rows = lambda *x: np.array([x], float)  # noqa: E731
    held = Contest(
        energy=np.stack([rows(400, 600, 1e6, 1e6), rows(500, 700, 1e6, 1e6), rows(600, 800, 1e6, 1e6)], axis=-1),
        distance=rows(0.4, 0.6, 9.0, 9.0),
        time=rows(8.0, 12.0, 1.0, 1.0),
        slip=rows(0.01, 0.03, 9.0, 9.0),
        margin=rows(0.08, 0.06, -1.0, -1.0),
        bend=np.deg2rad(rows(40.0, 35.0, 1.0, 1.0)),
        lowering=rows(0.0, 0.02, 9.0, 9.0),
        used=np.stack([rows(-0.1, -0.2, -9, -9), rows(0.1, 0.0, 9, 9), rows(0.45, 0.46, 0, 0), rows(0.5, 0.52, 9, 9)], axis=-1),
        inside=rows(1.0, 0.5, 9.0, 9.0),
        found=np.stack([rows(1.0, 0.5, 0, 0), rows(0.0, 0.1, 0, 0), rows(0.0, 0.4, 0, 0), rows(0, 0, 1, 1)], axis=-1),
        fell=np.array([[False, False, True, False]]),
        infeasible=np.array([[False, False, False, True]]),
        slack=np.ones((1, 4, len(CONSTRAINTS))),
    )
    seen = summary(held, 0, {"skew": 0.1}, "positive", 35.0, 200, 0)
    energies = [seen["energy_per_metre"][name]["mean"] for name in ("net", "positive", "absolute")]
    assert energies == [500.0, 600.0, 700.0]
    assert seen["energy_per_metre"]["positive"]["ci95"] == [500.0, 700.0]
    assert seen["cost_of_transport"] == pytest.approx(600.0 / (35.0 * 9.81))
    assert (seen["speed"], seen["mean_power_w"]) == (pytest.approx(0.05), pytest.approx(30.0))
    assert (seen["lanes"], seen["falls"], seen["infeasible"]) == (4, 1, 1)
    assert (seen["min_stability_margin"], seen["min_knee_bend_deg"]) == (0.06, pytest.approx(35.0))
    assert (seen["lowering"], seen["slip"]) == (pytest.approx(0.01), pytest.approx(0.02))
    bounds = {f"workspace.{name}": x for name, x in zip(("behind", "ahead", "low", "high"), (None, 0.1, None, 0.5))}
    space = workspace(held, 0, bounds)
    assert space["bounds"] == {"behind": None, "ahead": 0.1, "low": None, "high": 0.5}
    assert space["used"] == {"behind": -0.2, "ahead": 0.1, "low": 0.45, "high": 0.52}
    assert space["inside"] == pytest.approx(0.75)
    assert list(space["found"].values()) == pytest.approx([0.75, 0.05, 0.2, 0.0])
    assert failures(held, 0) == {"fell": 0.25, "infeasible": 0.25}
    both = held._replace(fell=np.array([[False, False, True, True]]))
    assert failed(both, 0) == {"lanes": 4, "falls": 1, "infeasible": 1}  # what cannot be planned is no fall
    assert seen["params"] == {"skew": 0.1}


def test_lanes_are_arranged_by_contestant_and_judged():
    """Two contestants on three terrains, contestant by contestant."""
    number, three = np.arange(6.0), np.arange(18.0).reshape(6, 3)
    bend = np.deg2rad([20.0, 19.85, 19.7, 30.0, 30.0, 30.0])
    status = np.where(np.arange(6) == 4, Status.NO_FOOTHOLD, Status.OK)
    six, used = np.ones(6), [number] * 4
    checks = PlanChecks(bend, number, number, number, six, number + 0.5, used, number / 6.0, np.ones((6, 4)), status)
    fell = np.arange(6) == 1
    moved, slip = np.stack([number, 0.1 * number], 1), np.stack([number] * 4, 1) * np.arange(4)
    meters = Meters(None, moved, 2 * number, slip, number, 3 * number, number, fell)
    slack = np.ones((6, len(CONSTRAINTS)))
    seen = contests.contest(Score(number, three, slack, checks), meters, np.full(6, np.deg2rad(20.0)), 2)
    np.testing.assert_array_equal(seen.energy, three.reshape(2, 3, 3))
    np.testing.assert_array_equal(seen.distance, number.reshape(2, 3))
    np.testing.assert_array_equal(seen.slip, 1.5 * number.reshape(2, 3))
    np.testing.assert_array_equal(seen.margin, 3 * number.reshape(2, 3))
    np.testing.assert_array_equal(seen.lowering, number.reshape(2, 3) + 0.5)
    np.testing.assert_array_equal(seen.infeasible, [[False, False, True], [False, True, False]])
    np.testing.assert_array_equal(seen.usable, [[True, False, False], [True, False, True]])


def test_the_interval_is_that_of_the_mean():
    """Of 400 normal numbers with deviation 2 it reaches 1.96 * 2 / sqrt(400) to either side."""
    values = np.random.default_rng(3).normal(10.0, 2.0, 400)
    row = bootstrap(values, 4000, 0)
    half = 1.96 * values.std() / 20.0
    assert row["mean"] == pytest.approx(values.mean())
    np.testing.assert_allclose(row["ci95"], [values.mean() - half, values.mean() + half], atol=0.1 * half)
    assert bootstrap(values, 4000, 0) == row  # the seed says all


def test_kinds_and_contestants_change_places():
    assert nested({"flat": {"a": 1, "b": 2}, "rough": {"a": 3, "b": 4}}) == {
        "a": {"flat": 1, "rough": 3},
        "b": {"flat": 2, "rough": 4},
    }
