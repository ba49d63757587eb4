"""Savings: pairs, intervals, and who is left out."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.plan import PlanChecks, PlanStatus
from jaxleg.search.contest import ACTIVE, Contest, active_constraints, bootstrap, keeps_limits, savings
from jaxleg.search.lanes import CONSTRAINTS, SCALES, penalty

NAMES = ("traditional", "paper", "best")


def contest(energy, fell=None, infeasible=None, slack=None):
    energy = np.asarray(energy, float)
    zero, no = np.zeros(energy.shape), np.zeros(energy.shape, bool)
    by_constraint = np.full((*energy.shape, len(CONSTRAINTS)), 1.0) if slack is None else slack
    return Contest(
        np.stack([energy, 2 * energy, 3 * energy], axis=-1),
        *(zero, zero, zero, zero, zero, zero),
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


def test_no_pairs_is_null_not_zero():
    held = contest([[1.0], [1.0], [1.0]], infeasible=[[True], [False], [False]])
    assert savings(held, NAMES, "traditional", 100, 0)["best"]["net"] == {"mean": None, "ci95": None}


def test_the_interval_covers_the_mean_as_often_as_it_says():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(200):
        low, high = bootstrap(rng.normal(0, 1, 40), np.mean, 300, 2)["ci95"]
        inside += low < 0 < high
    assert 0.88 <= inside / 200 <= 0.99


def test_what_binds_is_named():
    slack = np.full((3, 2, len(CONSTRAINTS)), 1.0)
    slack[2, 1, CONSTRAINTS.index("margin")] = 0.001
    bounds = np.tile([0.0, 1.0], (10, 1))
    vector = np.full(10, 0.5)
    vector[6] = 0.0
    named = active_constraints(contest(np.ones((3, 2)), slack=slack), 2, vector, bounds)
    assert named == ["margin", "swing_height at its lower bound"]


def test_a_plan_beyond_a_joints_range_is_infeasible_and_punished():
    """A robot with knees from 48 degrees on that is given 20: 28 units of a degree."""
    checks = PlanChecks(*map(np.asarray, (np.deg2rad(20.0), 0.1, 0.5, 1.0, np.deg2rad(-28.0), 0.0, PlanStatus.OK)))
    assert not keeps_limits(checks, np.deg2rad(20.0))
    assert keeps_limits(checks._replace(joint_room=np.asarray(np.deg2rad(-0.1))), np.deg2rad(20.0))
    assert not keeps_limits(checks._replace(joint_room=np.asarray(np.nan)), np.deg2rad(20.0))
    slack = np.where(np.array(CONSTRAINTS) == "joint_range", np.deg2rad(-28.0), 1.0)
    assert penalty(jnp.asarray(slack)) == pytest.approx(2.0 * (np.hypot(1.0, 28.0) - 1.0))
    assert set(ACTIVE) == set(CONSTRAINTS)
    assert len(SCALES) == len(CONSTRAINTS)
