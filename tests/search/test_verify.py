"""The contest on held-out terrains: who walks where, what margins are measured against, which lanes the referee gets."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from jaxleg.robot import load_robot
from jaxleg.search import referees, verify
from jaxleg.search.config import Kind, Search, Study, Terrains
from jaxleg.search.contestants import CONTESTANTS, baseline
from jaxleg.search.lanes import CONSTRAINTS
from jaxleg.search.verify import empty_contest, held_out_lanes, referee, with_margin_slack
from tests.stand_ins import StandInLab, StandInRun

STUDY = Study(
    kinds={"flat": Kind(), "rough": Kind("rough", least_knee_bend_deg=25.0)},
    terrains=Terrains(train=8, held_out=10, cells=(24, 12), resolution=0.04),
    search=Search(referee_terrains=5),
)
ROBOT = Path(__file__).parents[2] / "configs/robots/pegasus.toml"
BEST = np.arange(30.0).reshape(3, 10)


def copied(lanes):
    """The lanes with a map each."""
    return lanes.take(np.arange(lanes.number))


def state():
    return StandInRun(STUDY, StandInLab(), load_robot(ROBOT))


def test_every_contestant_walks_on_every_held_out_terrain():
    vectors, lanes = held_out_lanes(state(), "rough", BEST)
    assert CONTESTANTS == ("traditional", "implied", "paper", "best_i", "best_ii", "best")
    assert vectors.shape == (6 * 5, 10)
    np.testing.assert_array_equal(vectors[:5], np.tile(baseline(STUDY, "rough", "traditional"), (5, 1)))
    np.testing.assert_array_equal(vectors[15:20], np.tile(BEST[0], (5, 1)))
    np.testing.assert_array_equal(vectors[25:], np.tile(BEST[2], (5, 1)))
    maps = copied(lanes).site.terrain.elevation.reshape(6, 5, 24, 12)
    assert np.all(maps == maps[:1])
    assert len(np.unique(maps[0], axis=0)) == 5
    np.testing.assert_allclose(lanes.setting.least_bend, np.deg2rad(25.0))
    assert held_out_lanes(state(), "flat", BEST)[0].shape == (6, 10)


def test_what_does_not_move_is_each_contestants_own():
    """The searched ones hold the paper's."""
    study = dataclasses.replace(STUDY, search=Search(move=("gait.skew", "gait.lift_share")))
    best = np.array([[0.01, 0.1], [0.02, 0.1], [0.03, 0.2]])
    vectors, lanes = held_out_lanes(StandInRun(study, StandInLab(), load_robot(ROBOT)), "flat", best)
    np.testing.assert_allclose(vectors, [[0.0, 0.05], [0.1, 0.05], [0.1, 0.05], *best])
    np.testing.assert_allclose(lanes.setting.planner.gait.workspace.high, [0.48, 0.47, 0.52, 0.52, 0.52, 0.52])
    np.testing.assert_allclose(lanes.setting.planner.gait.foot_offset, [0.0, -0.1, -0.1, -0.1, -0.1, -0.1])


def test_margins_are_measured_against_the_traditional_gaits_on_the_same_terrain():
    slack = np.ones((6, 2, len(CONSTRAINTS)))
    margin = np.array([[0.08, 0.06], [0.05, 0.05], [0.09, 0.09], [0.08, 0.07], [0.0, 0.0], [0.1, 0.1]])
    seen = with_margin_slack(empty_contest(6, 2)._replace(slack=slack), margin)
    at = CONSTRAINTS.index("margin")
    np.testing.assert_allclose(seen.slack[..., at], margin - margin[0])
    assert np.all(np.delete(seen.slack, at, axis=-1) == 1.0)
    assert np.all(slack == 1.0)


@pytest.mark.parametrize(("kind", "count"), [("flat", 1), ("rough", 2)])
def test_the_referee_gets_its_share_spread_over_the_held_out_terrains(monkeypatch, kind, count):
    """Five in all: three for flat ground, which has only one, and two for rough ground, its first and its last."""
    seen = []
    monkeypatch.setattr(referees, "replay_contest", lambda *x: seen.append(x) or empty_contest(6, count))
    referee(state(), kind, BEST)
    _, vectors, lanes, contestants = seen[0]
    everyone, everywhere = held_out_lanes(state(), kind, BEST)
    total = len(everyone) // 6
    pick = [0] if kind == "flat" else [0, total - 1]
    index = [i * total + j for i in range(6) for j in pick]
    assert contestants == 6
    np.testing.assert_array_equal(vectors, everyone[index])
    np.testing.assert_array_equal(lanes.site.terrain.elevation, copied(everywhere).site.terrain.elevation[index])


def test_an_empty_contest_has_the_shapes_of_a_full_one():
    seen = verify.empty_contest(6, 4)
    assert seen.energy.shape == (6, 4, 3)
    assert seen.slack.shape == (6, 4, len(CONSTRAINTS))
    assert seen.usable.shape == (6, 4)
