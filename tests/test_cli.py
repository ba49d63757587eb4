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
        (KIND + "[bounds]\nhip_height = [0.58, 0.40]\n", ["bounds.hip_height", "lower end"]),
        (KIND + "[bounds]\nhip_height = [0.20, 0.25]\n", ["bounds.hip_height", "H_COG > L2", "0.26"]),
        (
            KIND + "[bounds]\nhip_height = [0.59, 0.60]\n",
            ["constraint (6)", "bounds.hip_height", "step length of at least 0.12", "than 0.109"],
        ),
        (KIND + "[bounds]\nstep_length = [0.10, 0.14]\n", ["constraint (5)", "search_length", "less than 0.28"]),
        (
            KIND + "[bounds]\nhip_height = [0.55, 0.58]\n[rectangle]\nsearch_length = 0.45\n",
            ["constraint (7)", "search_length is 0.45", "less than 0.420 at bounds.hip_height"],
        ),
        (KIND + "[rectangle]\nsearch_length = 0.9\n", ["search_length", "0.9", "constraint"]),
        (KIND + "[terrains]\nresolution = 0.05\n", ["terrains.resolution", "0.05", "foot", "0.04"]),
        (KIND + "[rectangle]\nsearch_width = 0.01\n", ["terrains.resolution", "search_width", "0.01"]),
        (KIND + "[terrains]\ncells = [12, 52]\n", ["terrains.cells", "12", "rectangle", "0.38"]),
        (KIND + "[contestants.paper]\nhip_height = 0.7\nfoot_offset = 0.0\nskew = 0.1\n", ["paper.hip_height", "0.7", "0.6"]),
        (KIND + "[contestants.paper]\nhip_height = 0.5\nfoot_offset = 0.0\nskew = 0.7\n", ["paper.skew", "0.7", "0.6"]),
        (KIND + "[bounds]\nskew = [0.0, 0.55]\n", ["bounds.skew", "0.55", "stance_length", "0.5"]),
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
