"""`jaxleg plan` and `jaxleg replay` refuse what they cannot use in one sentence, with status 2, before anything is compiled."""

import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.cli.plan import find_terrain, notes, read
from jaxleg.cli.planning import FAULTS, STEP_FAULTS, reasons
from jaxleg.search.config import Gait, Kind, Study
from jaxleg.series.tree import CAUSES
from jaxleg.status import Status
from jaxleg.terrain import KINDS, Grid
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.config import Navigation, PoseSettings
from tests.test_cli import CONFIGS, KIND, refused

PLAN = ("--start", "0.5", "0.5", "--goal", "2.5", "1.0")


@pytest.fixture
def config(tmp_path):
    def write(text: str = KIND) -> str:
        path = tmp_path / "study.toml"
        path.write_text(f"robot = '{CONFIGS / 'robots' / 'pegasus.toml'}'\n{text}")
        return str(path)

    return write


@pytest.fixture
def map_file(tmp_path):
    def write(elevation=None, resolution: float = 0.04, **more) -> str:
        path = tmp_path / "map.npz"
        elevation = np.zeros((80, 40)) if elevation is None else elevation
        np.savez(path, elevation=elevation, resolution=resolution, **more)
        return str(path)

    return write


def holed():
    elevation = np.zeros((80, 40))
    elevation[10:15, 10:15] = np.nan  # round (0.5, 0.5)
    return elevation


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        (("--start", "-0.5", "0.5", "--goal", "2", "1"), ["--start", "-0.5", "outside the map", "0.00 to 3.16"]),
        (("--start", "0.5", "1.0", "--goal", "9", "1"), ["--goal", "9", "outside"]),
        (("--start", "0.5", "0.5", "--goal", "2", "1"), ["--start", "0.5", "nobody has seen"]),
        (("--start", "0.5", "--goal", "2", "1"), ["--start", "2 values"]),
        (("--start", "a", "b", "--goal", "2", "1"), ["--start", "a b", "numbers"]),
        (("--start", "nan", "1", "--goal", "2", "1"), ["--start", "nan", "finite"]),
        (("--goal", "2", "1"), ["--start is missing"]),
    ],
)
def test_ends_that_cannot_be_used(config, map_file, capsys, ends, words):
    error = refused(capsys, "plan", config(), "--terrain", map_file(holed()), *ends)
    assert error.count("\n") == 1
    for word in words:
        assert word in error


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (dict(elevation=np.zeros((20, 12))), ["0.76 x 0.44 m", "0.8"]),
        (dict(resolution=0.05), ["map.npz: resolution is 0.05 m", "foot", "0.04"]),
        (dict(elevation=np.full((80, 40), np.nan)), ["NaN in all"]),
        (dict(elevation=np.zeros(5)), ["elevation", "2 dimensions"]),
        (dict(resolution=-1.0), ["resolution", "-1"]),
    ],
)
def test_maps_that_cannot_be_used(config, map_file, capsys, options, words):
    error = refused(capsys, "plan", config(), "--terrain", map_file(**options), *PLAN)
    assert error.count("\n") == 1
    for word in words:
        assert word in error


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[navigation.tree]\ndepth = 0\n", ["navigation.tree.depth", "0", "at least 1"]),
        ("[navigation.path]\nmu_cost = 0.7\n", ["mu_distance and mu_cost", "0.4 and 0.7", "sum to 1"]),
        ("[navigation.path]\nmu_distance = 0.0\nmu_cost = 1.0\n", ["navigation.path.mu_distance", "0.0", "above 0"]),
        ("[navigation.cost]\nbody_weights = [1.0, 1.0, 0.0]\n", ["body_weights", "sum to 1"]),
        ("[navigation.cost]\nlambda_body = 0.9\n", ["lambda_body and lambda_feet", "sum to 1"]),
        ("[navigation.cost.foot_weights]\nLF = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]\n", ["LF", "weights sum to 2"]),
        ("[navigation.pace]\nshift_samples = 100\n", ["shift_samples is 100", "0.0012 s apart in least_shift", "0.0025 s"]),
        ("[navigation.tree]\norder = 'cheapest'\n", ["navigation.tree.order", "cheapest", "paper"]),
        ("[navigation.tree]\ndept = 3\n", ["navigation.tree.dept", "did you mean navigation.tree.depth"]),
    ],
)
def test_settings_that_cannot_be_used(config, map_file, capsys, text, words):
    error = refused(capsys, "plan", config(KIND + text), "--terrain", map_file(), *PLAN)
    assert error.count("\n") == 1
    for word in words:
        assert word in error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--terrain", "lava"), ["lava", "cuboids", "fractal"]),
        (("--terrain", "nowhere.npz"), ["nowhere.npz", "cannot be read"]),
        (("--terrain", "flat", "--difficulty", "2"), ["--difficulty", "2", "from 0 to 1"]),
        (("--terrain", "flat", "--gait", "trot"), ["--gait", "trot", "flat"]),
        ((), ["--terrain is missing"]),
    ],
)
def test_options_that_cannot_be_used(config, capsys, arguments, words):
    error = refused(capsys, "plan", config(), *PLAN, *arguments)
    assert error.count("\n") == 1
    for word in words:
        assert word in error


def test_a_replay_wants_a_plan(tmp_path, map_file, capsys):
    assert "PLAN is missing" in refused(capsys, "replay")
    assert "--engine is bullet, but must be mjx or mujoco" in refused(capsys, "replay", "x.npz", "--engine", "bullet")
    assert "cannot be read" in refused(capsys, "replay", str(tmp_path / "nowhere.npz"))
    assert "is missing; is this a plan" in refused(capsys, "replay", map_file())
    (tmp_path / "text.npz").write_text("no plan")
    assert "not a .npz file" in refused(capsys, "replay", str(Path(tmp_path / "text.npz")))
    assert "--fast is not understood" in refused(capsys, "replay", "x.npz", "--fast")


@pytest.mark.parametrize(
    ("robot", "text", "words"),
    [
        # a knee cannot bend 100 deg at 0.48 m, nor at any height within two steps of 0.03 m
        ({}, "[navigation.pose]\nleast_knee_bend_deg = 100.0\n", ["kinds.flat.gait", "a knee bends", "least_knee_bend_deg"]),
        ({"torque_limit = ": "torque_limit = 8.0  # "}, "", ["kinds.flat.gait", "0.48 m", "of its torque limit"]),
        ({"[masses]": "knee_range_deg = [100.0, 150.0]\n\n[masses]"}, "", ["kinds.flat.gait", "beyond its range"]),
    ],
)
def test_a_robot_that_cannot_stand_is_not_blamed_on_the_ground(tmp_path, capsys, robot, text, words):
    file = (CONFIGS / "robots" / "pegasus.toml").read_text()
    for old, new in robot.items():
        assert old in file
        file = file.replace(old, new)
    (tmp_path / "robot.toml").write_text(file)
    (tmp_path / "study.toml").write_text("robot = 'robot.toml'\n" + KIND + text)
    error = refused(capsys, "plan", str(tmp_path / "study.toml"), "--terrain", "flat", *PLAN, "--out", str(tmp_path / "p.npz"))
    assert error.count("\n") == 1
    for word in words:
        assert word in error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "{folder}"), ["it is a folder"]),
        (("--out", "{folder}/file/plan.npz"), ["plan.npz", "cannot be written", "Not a directory"]),
        (("--figure", "{folder}/walk.pdf"), ["--figure", "walk.pdf", ".png"]),
        (("--out", "{folder}/same.png", "--figure", "{folder}/same.png"), ["--out and --figure", "different"]),
    ],
)
def test_outputs_are_checked_before_any_work(config, tmp_path, capsys, arguments, words):
    (tmp_path / "file").touch()
    arguments = [word.format(folder=tmp_path) for word in arguments]
    error = refused(capsys, "plan", config(), "--terrain", "flat", *PLAN, *arguments)
    assert error.count("\n") == 1
    assert [word for word in words if word not in error] == []


def test_plan_checks_the_study_as_search_does(config, capsys):
    error = refused(capsys, "plan", config(KIND + "[bounds]\ngait.workspace.high = [0.58, 0.40]\n"), "--terrain", "flat", *PLAN)
    assert "bounds.gait.workspace.high" in error


def test_a_kind_is_made_with_configs_settings():
    """By its name in CONFIG or its generator's; steps of 0.12 m, not the 0.08 m that nobody asked for."""
    study = Study(kinds={"flat": Kind(), "steep": Kind("stairs", rise=0.24, run=0.5)})
    for name in ("steep", "stairs"):
        elevation = np.asarray(find_terrain(study, name, 0.5, 0.04).terrain.elevation)
        np.testing.assert_allclose(np.unique(np.diff(elevation[:, 0]).round(6)), [0.0, 0.12], atol=1e-6)
    lumps = Study(kinds={"lumps": Kind("cuboids", cuboid=1.0, cuboid_height=0.3)})
    assert 0.15 < np.abs(np.asarray(find_terrain(lumps, "cuboids", 1.0, 0.04).terrain.elevation)).max() <= 0.3


def test_an_own_generator_is_a_kind(monkeypatch, config, tmp_path):
    """README: write your own terrain."""

    def ridge(grid: Grid, key, difficulty, settings) -> HeightMap:
        return grid.map(0.1 * difficulty * jnp.exp(-(grid.points()[..., 0] ** 2)))

    monkeypatch.setitem(KINDS, "ridge", ridge)
    out = ("--out", str(tmp_path / "plan.npz"))
    task = read([config("[kinds.mine]\ngenerator = 'ridge'\n"), "--terrain", "mine", *PLAN, *out])
    assert float(task.map.terrain.elevation.max()) == pytest.approx(0.05, rel=1e-2)


def test_a_map_made_here_has_cells_as_wide_as_the_foot(tmp_path):
    """Pegasus's, 0.04 m, would be too coarse for a narrower one, and no key changes it."""
    file = (CONFIGS / "robots" / "pegasus.toml").read_text()
    (tmp_path / "robot.toml").write_text(re.sub("(?m)^foot_radius = [0-9.]+", "foot_radius = 0.015", file))
    (tmp_path / "study.toml").write_text("robot = 'robot.toml'\n" + KIND)
    task = read([str(tmp_path / "study.toml"), "--terrain", "flat", *PLAN, "--out", str(tmp_path / "plan.npz")])
    assert float(task.map.terrain.resolution) == pytest.approx(0.03, rel=1e-6)


def test_what_is_not_used_of_a_gait_is_said():
    study = Study(kinds={"a": Kind(), "b": Kind(gait=Gait(foot_offset=-0.1, skew=0.1, swing_height=0.1))})
    assert notes(study, "a") == []
    (note,) = notes(study, "b")
    assert "kinds.b.gait" in note
    assert "foot_offset -0.1, skew 0.1" in note
    assert "swing_height" not in note
    (note,) = notes(Study(kinds={"c": Kind(leaves={"posture.cog.ratio": 0.4, "swing.clearance": 0.03})}), "c")
    assert "kinds.c.leaves, paper C's planner has its own: posture.cog.ratio 0.4" in note
    assert "clearance" not in note


def test_a_knee_bend_that_is_not_used_is_said():
    (note,) = notes(Study(kinds={"steep": Kind(least_knee_bend_deg=35.0)}), "steep")
    assert note == "not used of kinds.steep, navigation.pose.least_knee_bend_deg is 20: least_knee_bend_deg 35"
    own = Navigation(pose=PoseSettings(least_knee_bend_deg=25.0))
    assert notes(Study(kinds={"usual": Kind()}, navigation=own), "usual") == []  # nobody set it


class Walk:
    status, visited = Status.DEAD_END, 12
    causes = np.zeros(CAUSES, int)


def test_a_dead_ends_causes_are_counted():
    Walk.causes[[Status.OK, Status.KINEMATICS, Status.STABILITY]] = 4, 3, 5
    lines = reasons(None, Walk, np.zeros(2), np.zeros(2))
    assert "no series of gaits" in lines[0]
    assert "12 candidate states" in lines[1]
    assert [line.split(maxsplit=1) for line in lines[2:]] == [
        ["5", STEP_FAULTS[Status.STABILITY]],
        ["3", STEP_FAULTS[Status.KINEMATICS]],
    ]
    assert {*STEP_FAULTS, *FAULTS, Status.OK} == set(Status)
    assert max(STEP_FAULTS) < CAUSES


def test_far_maps_take_far_ends(config, map_file, tmp_path, capsys):
    """Start and goal are read in W, where float32 could not hold them."""
    far = np.array([388096.0, 3948996.0])
    ends = ["--start", "388096.5", "3948996.5", "--goal", "388098.5", "3948997"]
    task = read([config(), "--terrain", map_file(origin_xy=far), *ends, "--out", str(tmp_path / "plan.npz")])
    for name, xy in (("start", far + 0.5), ("goal", far + np.array([2.5, 1.0]))):
        np.testing.assert_array_equal(task.ends[name] + task.map.datum[:2], xy)
        assert np.abs(task.ends[name]).max() < 128.0
    error = refused(capsys, "plan", config(), "--terrain", map_file(origin_xy=far), *PLAN)
    assert "388096.00 to 388099.16" in error
