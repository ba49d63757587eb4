"""From map to goal and back from the file: paper C's planner, MJX and the referee, on one small map."""

import dataclasses
import functools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.cli import main
from jaxleg.route.path import BodyPath
from jaxleg.search.config import Gait, Kind, Study, Workspace
from jaxleg.search.navigate import navigate, navigator_of, on_valid_cells, simulate_all, survey_all
from jaxleg.sim.contact import Ground
from jaxleg.sim.legged import legged_engine
from jaxleg.status import Status
from jaxleg.terrain import Grid, TerrainSettings, terrain
from jaxleg.terrain.heightmap import HeightMap

GRID = Grid(75, 50, 0.04, (0.02, 0.02))
START, GOAL = np.array([[0.8, 0.9]]), np.array([[2.2, 1.1]])
ROBOT = Path(__file__).parents[2] / "configs/robots/pegasus.toml"


def small(study):
    """A study whose walks are short."""
    path = dataclasses.replace(study.navigation.path, steps=60, cells=90)
    return dataclasses.replace(study, navigation=dataclasses.replace(study.navigation, path=path))


@pytest.fixture(scope="module")
def planned(pegasus):
    navigator = navigator_of(
        small(Study(kinds={"flat": Kind()})), pegasus, Gait(workspace=Workspace(high=0.46)), GRID.resolution
    )
    ground = terrain("cuboids", GRID, jax.random.key(3), 0.5, TerrainSettings())
    surveys = survey_all(navigator, jax.tree.map(lambda x: np.asarray(x)[None], ground))
    walked, _ = navigate(navigator, surveys, START, GOAL)
    return navigator, surveys, walked


@pytest.mark.parametrize(("metres", "allowed"), [(0.8, True), (1.2, False), (2.8, False)])
def test_a_walk_of_more_steps_than_allowed_is_seen_to_be(pegasus, metres, allowed):
    """20 steps are 10 half cycles of 0.1 m."""
    navigation = Study(kinds={"flat": Kind()}).navigation
    navigation = dataclasses.replace(navigation, path=dataclasses.replace(navigation.path, steps=20, cells=90))
    study = dataclasses.replace(Study(kinds={"flat": Kind()}), navigation=navigation)
    navigator = navigator_of(study, pegasus, Gait(step_length=0.2), GRID.resolution)
    cells = round(metres / GRID.resolution) + 1
    path = np.stack([np.minimum(np.arange(90), cells - 1), np.full(90, 20)], axis=1)
    ground = jax.tree.map(jnp.asarray, terrain("flat", GRID, jax.random.key(0), 0.0, TerrainSettings()))
    whole = [jnp.asarray(x, jnp.int32) for x in (path, np.zeros(90), cells, Status.OK)]
    found = BodyPath(*whole[:3], jnp.asarray(0.0), whole[3])
    count = int(jax.jit(navigator.stations)(ground, found).count)
    assert (2 * count <= 20) == allowed
    assert count == min(round(metres / 0.1), 13)


def test_a_walk_reaches_its_goal_on_valid_cells(planned):
    _, surveys, walked = planned
    assert walked.status[0] == Status.OK
    assert on_valid_cells(surveys, walked)[0]
    count = int(walked.choices.count[0])
    assert np.linalg.norm(walked.walk.poses[0, count, :2] - GOAL[0]) < 0.2
    moved = np.abs(np.diff(walked.walk.feet[0, : count + 1], axis=0)).max(axis=-1) > 0
    assert np.all(moved.sum(axis=1) <= 1)  # one foot a step
    assert [int(np.argmax(m)) for m in moved[:4]] == [3, 1, 2, 0]  # RH, RF, LH, LF


def test_the_walk_in_simulation_keeps_to_the_plan(planned, pegasus):
    navigator, surveys, walked = planned
    seen = simulate_all(navigator, legged_engine(pegasus), Ground(), surveys, walked, GOAL)
    assert seen.finished[0]
    assert seen.landing[0].max() < 0.02
    assert seen.left[0] < 0.2
    assert seen.followed.meters.margin[0] > 0.0


@pytest.mark.slow
def test_plan_and_replay_from_the_command_line(tmp_path, capsys):
    config = tmp_path / "study.toml"
    config.write_text(
        f"robot = '{ROBOT}'\n[kinds.flat]\ngait.workspace = {{ high = 0.46 }}\n[navigation.path]\nsteps = 60\ncells = 90\n"
    )
    out, figure, video = tmp_path / "plan.npz", tmp_path / "plan.png", tmp_path / "walk.gif"
    ends = ("--start", "1.0", "1.0", "--goal", "2.0", "1.2", "--difficulty", "0.4")
    run("plan", str(config), "--terrain", "cuboids", *ends, "--out", str(out), "--figure", str(figure))
    assert figure.stat().st_size > 10000
    results = {}
    for engine, more in (("mjx", ("--video", str(video))), ("mujoco", ())):
        path = tmp_path / f"{engine}.json"
        run("replay", str(out), "--engine", engine, "--out", str(path), *more)
        results[engine] = json.loads(path.read_text())
    assert video.stat().st_size > 10000
    for result in results.values():
        assert not result["fell"]
        assert result["left"] < 0.25
    energy = [results[engine]["energy_per_metre"]["positive"] for engine in ("mjx", "mujoco")]
    np.testing.assert_allclose(energy[1], energy[0], rtol=0.2)
    with np.load(out) as file:
        assert set(file["leg_order"]) == {"LF", "RF", "LH", "RH"}
        assert file["joint_pos"].shape[1:] == (4, 3)
        assert file["footholds"].shape[1:] == (4, 3)


def run(*arguments):
    with pytest.raises(SystemExit) as stop:
        main([*arguments])
    assert stop.value.code == 0


@pytest.mark.slow
def test_a_walled_goal_is_said_to_be_out_of_reach(tmp_path, capsys):
    elevation = np.zeros((75, 50))
    elevation[40:42] = 1.0
    np.savez(tmp_path / "map.npz", elevation=elevation, resolution=0.04)
    (tmp_path / "study.toml").write_text(f"robot = '{ROBOT}'\n[kinds.flat]\n[navigation.path]\nsteps = 60\ncells = 90\n")
    ends = ("--start", "0.7", "1.0", "--goal", "2.4", "1.0")
    with pytest.raises(SystemExit) as stop:
        main(["plan", str(tmp_path / "study.toml"), "--terrain", str(tmp_path / "map.npz"), *ends])
    assert stop.value.code == 1
    assert "no path leads from start to goal" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_a_survey_takes_little_memory(pegasus):
    """Bytes a cell beyond its result: the scores of eight features for one leg and heading at a time, not for all 32."""
    navigator = navigator_of(Study(kinds={"flat": Kind()}), pegasus, Gait(), 0.04)
    number = functools.partial(jax.ShapeDtypeStruct, dtype=jax.numpy.float32)
    cells = 200
    ground = jax.tree.map(number, HeightMap((cells, cells), (2,), ()), is_leaf=lambda x: isinstance(x, tuple))
    single = jax.tree.map(lambda x: x.astype(np.float32) if x.dtype == np.float64 else x, navigator.robot)
    memory = jax.jit(dataclasses.replace(navigator, robot=single).survey).lower(ground).compile().memory_analysis()
    assert memory.temp_size_in_bytes / cells**2 < 2000.0
