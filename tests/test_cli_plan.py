"""`jaxleg plan` and `jaxleg replay` refuse what they cannot use in one sentence, with status 2, before anything is compiled."""

from pathlib import Path

import numpy as np
import pytest

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
        (dict(resolution=0.05), ["0.05", "foot", "0.04"]),
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
