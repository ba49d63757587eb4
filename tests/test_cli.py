"""The command line refuses what it cannot use in one sentence, with status 2, and overwrites nothing."""

import dataclasses
from pathlib import Path

import pytest

from jaxleg.cli import main
from jaxleg.robot import RobotFile
from jaxleg.search.config import Study, robot_path
from jaxleg.search.run_folder import RunFolder
from jaxleg.settings import dump, load

CONFIGS = Path(__file__).parent.parent / "configs"
KIND = "[kinds.flat]\ngenerator = 'flat'\n"


def refused(capsys, *arguments: str) -> str:
    with pytest.raises(SystemExit) as stop:
        main([*arguments])
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    return error


@pytest.fixture
def config(tmp_path):
    def write(text: str) -> str:
        path = tmp_path / "study.toml"
        path.write_text(f"robot = '{CONFIGS / 'robots' / 'pegasus.toml'}'\n{text}")
        return str(path)

    return write


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sped = 0.1\n" + KIND, ["sped", "did you mean speed"]),
        ("speed = 'fast'\n" + KIND, ["speed", "fast", "number"]),
        ("speed = -0.1\n" + KIND, ["speed", "-0.1", "above 0"]),
        ("speed = nan\n" + KIND, ["speed", "nan"]),
        ("speed = 1e-300\n" + KIND, ["speed", "1e-300", "single precision"]),
        ("seed = 4294967296\n" + KIND, ["seed", "4294967296", "at most 4294967295"]),  # else the same as 0
        ("seed = 9223372036854775808\n" + KIND, ["seed", "at most 4294967295"]),
        ("[kinds.'a/b']\n", ["kinds.'a/b'", "letters, digits"]),
        (KIND + "[terrains]\ncells = [4096, 4096]\n", ["terrains.cells", "4.43e+09", "2.15e+09"]),
        ("speed = \n" + KIND, ["not valid TOML", "line 2"]),
        ("power = 'gross'\n" + KIND, ["power", "gross", "net"]),
        ("[kinds.flat]\ngenerator = 'lava'\n", ["kinds.flat.generator", "lava", "flat"]),
        ("[kinds]\n", ["kinds is empty"]),
        ("", ["kinds"]),
        (KIND + "[terrains]\ntrain = 0\n", ["terrains.train", "0", "at least 1"]),
        (KIND + "[bounds]\n'gait.workspace.high' = [0.58, 0.40]\n", ["bounds.gait.workspace.high", "[0.58, 0.4]", "lower end"]),
        (KIND + "[bounds]\ngait.workspace.high = [0.5, 0.5]\n", ["bounds.gait.workspace.high", "[0.5, 0.5]", "lower end"]),
        (KIND + "[bounds]\n'gait.workspace.high' = [0.20, 0.25]\n", ["bounds.gait.workspace.high", "H_COG > L2", "0.26"]),
        (KIND + "[bounds]\n'gait.workspace.high' = 0.5\n", ["bounds.gait.workspace.high", "0.5", "a list of 2, each a number"]),
        (
            KIND + "[bounds]\n'gait.workspace.high' = [0.59, 0.60]\n",
            ["constraint (6)", "bounds.gait.workspace.high", "step length of at least 0.12", "than 0.109"],
        ),
        (KIND + "[bounds]\n'gait.step_length' = [0.10, 0.14]\n", ["constraint (5)", "search_length", "less than 0.28"]),
        (
            KIND + "[bounds]\n'gait.workspace.high' = [0.55, 0.58]\n[rectangle]\nsearch_length = 0.45\n",
            ["constraint (7)", "search_length is 0.45", "less than 0.420 at bounds.gait.workspace.high"],
        ),
        (
            KIND + "[bounds]\ngait.workspace.hihg = [0.4, 0.5]\n",
            ["bounds", "'gait.workspace.hihg'", "did you mean gait.workspace.high?"],
        ),
        (KIND + "[bounds]\nwings = [0.4, 0.5]\n", ["bounds", "'wings'", "there are: gait.workspace.behind, "]),
        (KIND + "[bounds]\n'gait.skew' = [0.4, -1.5]\n", ["bounds.gait.skew[1]", "-1.5", "[m], at least -1.0"]),
        (KIND + "[bounds]\n'posture.cog.ratio' = [0.2, 1.5]\n", ["bounds.posture.cog.ratio[1]", "1.5", "at most 1.0"]),
        (KIND + "[bounds]\n'route.heading' = [0.2, 1.5]\n", ["bounds", "'route.heading'", "along +x"]),
        (KIND + "[bounds]\n" + 3000 * "a." + "a = 1\n", ["bounds.a.a.a", "... is 1, but", "a list of 2"]),
        (KIND + "[search]\nmove = ['swing.clearence']\n", ["search.move", "swing.clearence", "mean swing.clearance?"]),
        (KIND + "[search]\nmove = ['swing.clearance']\n", ["bounds.swing.clearance is missing", "search.move", "[low, high]"]),
        (KIND + "[search]\nmove = ['gait.skew', 'gait.skew']\n", ["search.move", "gait.skew 2 times"]),
        (KIND + "[search]\nmove = []\n", ["search.move is []", "at least one"]),
        (KIND + "[search]\nmove = 'gait.skew'\n", ["search.move", "gait.skew", "a list"]),
        (
            KIND + "[search]\nmove = ['gait.step_length']\n[bounds]\n'gait.step_length' = [0.34, 0.5]\n",
            ["constraint (6)", "contestants.paper.workspace.high 0.52", "at least 0.34", "than 0.299"],
        ),
        (
            KIND + "[search]\nmove = ['gait.stance_length']\n[bounds]\n'gait.stance_length' = [0.05, 0.6]\n",
            ["contestants.paper.skew is 0.1", "gait.stance_length", "0.05"],
        ),
        (KIND + "leaves = { 'gait.skew' = 0.1 }\n", ["kinds.flat.leaves.gait.skew is 0.1", "as kinds.flat.gait.skew"]),
        (KIND + "leaves = { 'swing.clearance' = 3 }\n", ["kinds.flat.leaves.swing.clearance is 3", "at most 0.2"]),
        (KIND + "leaves.swing.clearence = 0.1\n", ["kinds.flat.leaves", "clearence", "mean swing.clearance?"]),
        (KIND + "[rectangle]\nsearch_length = 0.9\n", ["search_length", "0.9", "constraint"]),
        (KIND + "[terrains]\nresolution = 0.05\n", ["terrains.resolution", "0.05", "foot", "0.04"]),
        (KIND + "[rectangle]\nsearch_width = 0.01\n", ["terrains.resolution", "search_width", "0.01"]),
        (KIND + "[terrains]\ncells = [12, 52]\n", ["terrains.cells", "12", "rectangle", "0.38"]),
        (
            KIND + "[contestants.paper]\nworkspace = { high = 0.7 }\nfoot_offset = 0.0\nskew = 0.1\n",
            ["paper.workspace.high", "0.7", "0.6"],
        ),
        (
            KIND + "[contestants.paper]\nworkspace = { high = 0.5 }\nfoot_offset = 0.0\nskew = 0.7\n",
            ["paper.skew", "0.7", "0.6"],
        ),
        (
            KIND
            + "[contestants.paper]\nworkspace = { behind = 0.1, ahead = 0.0, high = 0.5 }\nfoot_offset = 0.0\nskew = 0.1\n",
            ["contestants.paper.workspace: behind is 0.1", "must not exceed ahead, 0"],
        ),
        (KIND + "gait.workspace = { low = 0.5 }\n", ["kinds.flat.gait.workspace: low is 0.5", "must not exceed high, 0.48"]),
        (KIND + "gait.workspace = { ahead = -0.5, low = 0.4 }\n", ["kinds.flat.gait.workspace", "0.64 m", "leg's length, 0.6"]),
        (
            KIND + "[search]\nmove = ['gait.workspace.ahead']\n[kinds.flat.gait.workspace]\nbehind = 0.05\n",
            ["gait.workspace.behind may be 0.05 on flat", "gait.workspace.ahead, 0;"],
        ),
        (
            KIND + "gait.workspace = { low = 0.53, high = 0.56 }\n",
            ["kinds.flat.gait.workspace.low is 0.53", "must not exceed contestants.paper.workspace.high, 0.52"],
        ),
        (KIND + "[rectangle]\nsupport = 'always'\n", ["rectangle.support", "always", "stance", "sweep"]),
        (KIND + "[bounds]\n'gait.skew' = [0.0, 0.55]\n", ["bounds.gait.skew", "0.55", "stance_length", "0.5"]),
        (KIND + "[randomise]\nmass = 1.0\n", ["randomise.mass", "1.0", "below 1.0"]),
        (KIND + "[randomise]\ngains = -0.1\n", ["randomise.gains", "-0.1", "at least 0.0"]),
        (KIND + "[randomise]\nfriction = [0.9, 0.5]\n", ["randomise.friction", "[0.9, 0.5]", "lower end"]),
        (KIND + "[search]\ncounted = [0.9, 0.9]\n", ["search.counted", "[0.9, 0.9]", "lower end"]),
        (KIND + "[search]\ncounted = [0.0, 1.5]\n", ["search.counted", "1.5"]),
        (KIND + "[kinds.rough]\n[randomise]\nlanes = 1\n", ["randomise.lanes is 1", "0 or at least 2"]),
        (KIND + "[randomise]\nlanes = 9\n[simulation]\nengine = 'mjx'\n", ["simulation.engine is 'mjx'", "randomise.lanes"]),
        (KIND + "[randomise]\nlanes = 1000000\n", ["randomise.lanes", "5.82e+09", "2.15e+09"]),
    ],
)
def test_a_bad_config_is_refused_in_one_sentence(config, capsys, text, words):
    error = refused(capsys, "search", config(text))
    assert error.count("\n") == 1
    assert "study.toml" in error
    for word in words:
        assert word in error


def test_a_missing_file_is_named(capsys):
    assert "nowhere.toml" in refused(capsys, "search", "nowhere.toml")


def test_a_missing_robot_is_named(tmp_path, capsys):
    (tmp_path / "study.toml").write_text("robot = 'spot.toml'\n" + KIND)
    assert "spot.toml" in refused(capsys, "search", str(tmp_path / "study.toml"))


@pytest.mark.parametrize("arguments", [["walk"], ["search"], ["search", "--out"], []])
def test_a_wrong_command_is_refused(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2


def test_a_bad_override_is_refused(config, capsys):
    error = refused(capsys, "search", config(KIND), "--search.starts", "0")
    assert "command line" in error
    assert "search.starts" in error


def test_a_folder_that_holds_another_run_is_left_alone(config, tmp_path, capsys):
    out = tmp_path / "run"
    out.mkdir()
    (out / "thesis.txt").write_text("mine")
    error = refused(capsys, "search", config(KIND), "--out", str(out))
    assert str(out) in error
    assert [p.name for p in out.iterdir()] == ["thesis.txt"]


def test_resume_wants_the_same_config(config, tmp_path, capsys):
    source, out = config(KIND), tmp_path / "run"
    out.mkdir()
    dump(dataclasses.replace(load(Study, source), robot="robot.toml"), out / "config.toml")
    error = refused(capsys, "search", source, "--out", str(out), "--resume", "--seed", "7")
    assert "seed" in error
    assert "7" in error


def test_a_file_where_the_folder_should_be_is_refused(config, tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert "taken" in refused(capsys, "search", config(KIND), "--out", str(tmp_path / "taken" / "run"))


def test_a_folders_own_config_and_best_answer_are_configs(config, tmp_path):
    """A run folder holds all that it names: it may be moved, and its robot is the one that it began with."""
    source, path = config(KIND), tmp_path / "run"
    robot = load(RobotFile, CONFIGS / "robots" / "pegasus.toml")
    study = dataclasses.replace(load(Study, source), robot="robot.toml")
    RunFolder.open(path, {"config": study, "robot": robot}, resume=False).close()
    moved = path.rename(tmp_path / "moved")
    assert load(Study, moved / "config.toml") == study
    assert load(RobotFile, robot_path(study, moved / "config.toml")) == robot
