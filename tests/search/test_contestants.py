"""The planners of a study: what sets contestants apart, what a kind has of its own, and the best one put in place."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.foothold.rectangle import Extent
from jaxleg.robot import load_robot
from jaxleg.search.checks import HEADINGS
from jaxleg.search.config import BOUNDS, RULES, Gait, Kind, Search, Simulation, Study, Workspace
from jaxleg.search.contestants import (
    GAIT,
    STAGES,
    WORKSPACE,
    baseline,
    bounds,
    contestant,
    contestants,
    numbers,
    planner_of,
    searched_planner,
    with_best,
)
from jaxleg.search.descent import ranges
from jaxleg.search.leaves import leaf_names, read_leaves
from jaxleg.search.navigate import navigator_of
from jaxleg.settings import dump, load
from tests.search.test_verify import ROBOT

MOVE = ("posture.cog.ratio", "gait.skew", "swing.clearance")
STUDY = Study(
    kinds={
        "flat": Kind(least_knee_bend_deg=35.0, gait=Gait(lift_share=0.2)),
        "rough": Kind("rough", leaves={"swing.clearance": 0.03, "swing.load_share": 0.15}),
    },
    bounds={"posture.cog.ratio": (0.2, 0.8), "swing.clearance": (0.01, 0.1)},
    search=Search(move=MOVE),
)


def values(planner):
    names = leaf_names(planner)
    return dict(zip(names, read_leaves(planner, names).tolist()))


def test_everything_but_the_heading_has_its_limits():
    planner = planner_of(STUDY, Kind(), Gait())
    assert set(leaf_names(planner)) == {*RULES, *HEADINGS}
    assert set(BOUNDS) == set(GAIT)
    assert STUDY.bounds == BOUNDS | {"posture.cog.ratio": (0.2, 0.8), "swing.clearance": (0.01, 0.1)}  # the others' stay


def test_contestants_differ_by_their_stance_alone():
    traditional, paper = (values(contestant(STUDY, "flat", name)) for name in ("traditional", "paper"))
    apart = {name for name in paper if paper[name] != traditional[name]}
    space = dict(zip(WORKSPACE, (-0.20, 0.0, 0.48, 0.52)))
    assert {name: paper[name] for name in apart} == space | {"gait.foot_offset": -0.10, "gait.skew": 0.10}
    assert [traditional[name] for name in WORKSPACE] == [-np.inf, np.inf, 0.0, 0.48]
    own = values(searched_planner(STUDY, "flat"))  # what searches move begins without a workspace
    assert {name for name in own if own[name] != paper[name]} == set(WORKSPACE[:3])
    assert paper["gait.lift_share"] == 0.2
    assert_allclose([paper["limits.knee_bend"], paper["foothold.least_bend"]], np.deg2rad(35.0))
    assert (paper["timing.speed"], paper["swing.clearance"], paper["foothold.rectangle.length"]) == (0.05, 0.02, 0.30)
    assert_allclose(baseline(STUDY, "flat", "paper"), [0.5, 0.1, 0.02])


def test_a_kinds_own_numbers_stand_instead_of_the_studys():
    flat, rough = (values(contestant(STUDY, kind, "paper")) for kind in STUDY.kinds)
    assert (flat["swing.clearance"], flat["swing.load_share"]) == (0.02, 0.1)
    assert (rough["swing.clearance"], rough["swing.load_share"]) == (0.03, 0.15)


def test_all_that_any_planner_looks_at_is_within_the_extent():
    """The rectangle's half sides and one step in cells of 2 cm: 0.19 and 0.04 m, 0.3 m; then 0.29, 0.06 and 0.24 m."""
    extent = lambda study: contestant(study, "flat", "paper").foothold.extent  # noqa: E731
    assert extent(Study(kinds={"flat": Kind()})) == Extent((9, 2), 15)
    leaves = {"foothold.rectangle.longer": 0.18, "foothold.rectangle.width": 0.05}
    wide = {"foothold.rectangle.length": (0.2, 0.4), "foothold.rectangle.width": (0.04, 0.12), "gait.step_length": (0.1, 0.24)}
    study = Study(kinds={"flat": Kind(leaves=leaves)}, bounds=wide, search=Search(move=tuple(wide)))
    assert extent(study) == Extent((14, 3), 12)
    assert extent(dataclasses.replace(study, search=Search(move=("gait.skew",)))) == Extent((12, 2), 10)


@pytest.mark.parametrize("single", [False, True])
def test_the_best_answer_written_and_read_again_is_the_same_planner(tmp_path, single):
    with jax.enable_x64(not single):
        best = {kind: np.array([[0.5, 0.1, 0.02]] * 2 + [[0.3 + 0.1 * i, 0.1 / 3, 0.1]]) for i, kind in enumerate(STUDY.kinds)}
        best = jax.tree.map(lambda x: x.astype(jnp.zeros(()).dtype), best)
        dump(with_best(STUDY, best), tmp_path / "best.toml")
        again = load(Study, tmp_path / "best.toml")
        for kind, table in again.kinds.items():
            found, wanted = planner_of(again, table, table.gait), contestants(STUDY, kind, best[kind])[-1]
            assert values(found) == values(wanted)
            assert found.foothold.extent == wanted.foothold.extent
            assert_allclose(read_leaves(found, MOVE), best[kind][-1])
    assert again.kinds["flat"].leaves == {"posture.cog.ratio": 0.3, "swing.clearance": 0.1}
    assert again.kinds["rough"].leaves == {"posture.cog.ratio": 0.4, "swing.clearance": 0.1, "swing.load_share": 0.15}


def test_a_bound_that_does_not_bind_is_held_where_it_cuts_least():
    """Nothing infinite reaches a search; a kind's own bound stays."""
    own = Workspace(behind=-0.15, high=0.5)
    kinds = {"flat": Kind(), "rough": Kind("rough", gait=Gait(own))}
    study = Study(kinds=kinds, search=Search(move=WORKSPACE))
    behind, ahead, low, high = (BOUNDS[name] for name in WORKSPACE)
    assert bounds(study, "flat", "best").tolist() == [list(x) for x in (behind, ahead, low, high)]
    assert bounds(study, "flat", "best_ii")[:3].tolist() == [[behind[0]] * 2, [ahead[1]] * 2, [low[0]] * 2]
    assert bounds(study, "rough", "best_i")[0].tolist() == [-0.15, -0.15]
    assert np.isfinite(ranges(np.stack([bounds(study, "flat", stage) for stage in STAGES])).box).all()


def test_a_workspace_searched_upside_down_is_written_as_it_is_walked(tmp_path):
    study = Study(kinds={"flat": Kind()}, search=Search(move=WORKSPACE))
    dump(with_best(study, {"flat": np.array([[-0.1, 0.1, 0.5, 0.45]] * 3)}), tmp_path / "best.toml")
    assert load(Study, tmp_path / "best.toml").kinds["flat"].gait.workspace == Workspace(-0.1, 0.1, 0.45, 0.45)


def test_results_name_the_gaits_numbers_and_what_else_moves():
    with jax.enable_x64(False):
        seen = numbers(STUDY, contestant(STUDY, "flat", "implied"))
    gait = dataclasses.asdict(Gait(foot_offset=-0.10, skew=0.10, lift_share=0.2))
    bounds = {f"workspace.{name}": None for name in ("behind", "ahead", "low")} | {"workspace.high": 0.47}
    del gait["workspace"]
    assert seen == gait | bounds | {"posture.cog.ratio": 0.5, "swing.clearance": 0.02}  # and no digits of single precision


def test_paper_cs_planner_takes_the_swing_from_a_kinds_own_numbers():
    study = Study(kinds={"flat": Kind()}, simulation=Simulation(load_share=0.2))
    leaves = {"swing.clearance": 0.05, "posture.cog.ratio": 0.1}
    planner = navigator_of(study, load_robot(Path(ROBOT)), Gait(), 0.04, leaves).planner
    assert (planner.swing.clearance, planner.swing.load_share, planner.posture.cog.ratio) == (0.05, 0.2, 0.5)
