"""A search of numbers outside the gait: its gradients against differences, and the descent that follows them."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.leg.energy import CONVENTIONS
from jaxleg.robot import RobotFile, build_robot
from jaxleg.search.config import Cog, Gait, Kind, Search, Study, Terrains
from jaxleg.search.contestants import STAGES, baseline, bounds, contestant
from jaxleg.search.lanes import settings_of
from jaxleg.search.leaves import read_leaves
from jaxleg.search.run import make_lab
from jaxleg.search.run_folder import RunFolder
from jaxleg.search.stages import search_group
from jaxleg.search.training import training_lanes
from jaxleg.settings import load
from tests.stand_ins import StandInRun

ROBOT = load(RobotFile, Path(__file__).parents[2] / "configs/robots/pegasus.toml")
MOVE = ("posture.cog.ratio", "swing.clearance")
STUDY = Study(
    kinds={"rough": Kind("rough", gait=Gait(swing_height=0.04))},
    terrains=Terrains(train=2, held_out=2),
    cog=Cog(rule="median"),
    bounds={"posture.cog.ratio": (0.2, 0.8), "swing.clearance": (0.02, 0.12)},
    search=Search(move=MOVE, starts=2, lanes=1, steps=4),
)
STEP = 1e-5
pytestmark = pytest.mark.slow  # the proxy is compiled for other numbers than in test_search.py


@pytest.fixture(scope="module")
def state():
    study = dataclasses.replace(STUDY, simulation=dataclasses.replace(STUDY.simulation, chunk=3))
    robot = build_robot(ROBOT)
    return StandInRun(study, make_lab(study, robot), robot)


@pytest.fixture(scope="module")
def lanes(state):
    return training_lanes(state, "rough")


def test_the_baseline_is_the_traditional_planner_whole(state, lanes):
    """Its energy counts as 1, also what of it no search moves; the searched planners hold the paper's."""
    planner = contestant(state.study, "rough", "traditional")
    rows, alone = np.tile(read_leaves(planner, MOVE), (lanes.number, 1)), settings_of(planner, lanes.number)
    energy = state.lab.proxy_gradients(rows, lanes.site, alone)[0].energy[:, CONVENTIONS.index("positive")]
    assert_allclose(lanes.setting.energy, energy.mean())
    assert np.all(np.asarray(alone.planner.gait.workspace.high) == 0.48)
    assert np.all(np.asarray(lanes.setting.planner.gait.workspace.high) == 0.52)


def test_gradients_are_those_of_central_differences(state, lanes):
    at = np.array([0.4, 0.07])
    rows = np.stack([at, *(at + h * STEP * unit for unit in np.eye(2) for h in (1.0, -1.0))])
    many = lanes.take(np.zeros(len(rows), int))
    score, gradient = state.lab.proxy_gradients(rows, many.site, many.setting)
    difference = (score.objective[1::2] - score.objective[2::2]) / (2.0 * STEP)
    assert np.all(np.abs(difference) > 1e-2)
    assert_allclose(gradient[0], difference, rtol=1e-5)


def test_the_descent_moves_them_and_holds_the_rest(state, lanes, tmp_path):
    """The first two searches, which move the stance alone, hold both; the last one gets below the paper's planner."""
    state.folder = RunFolder.open(tmp_path / "run", {"config": state.study, "robot": ROBOT}, resume=False)
    best = search_group(state, ("rough",), {"rough": lanes})
    state.folder.close()
    assert best.shape == (len(STAGES), len(MOVE))
    paper = baseline(state.study, "rough", "paper")
    assert_allclose(paper, [0.5, 0.02])
    assert_allclose(best[:2], np.tile(paper, (2, 1)))
    low, high = bounds(state.study, "rough", "best").T
    assert np.all((best[-1] >= low) & (best[-1] <= high))
    rows = np.stack([paper, best[-1]])
    many = lanes.take(np.zeros(len(rows), int))
    objective = state.lab.proxy_gradients(rows, many.site, many.setting)[0].objective
    assert objective[1] < objective[0]
