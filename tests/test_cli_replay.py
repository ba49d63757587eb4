"""`jaxleg replay` knows before it simulates what it cannot write, and writes JSON that is JSON."""

import json
import os

import numpy as np
import pytest

from jaxleg.cli import main
from jaxleg.sim import replay
from tests.plans import save_standing
from tests.test_cli import refused

FIGURES = {"power": "positive", "time": 1.0, "slip": 0.0, "left": 0.1, "distance": 0.0, "margin": 0.1}


@pytest.fixture
def plan(tmp_path, pegasus):
    return save_standing(tmp_path / "plan.npz", pegasus)


@pytest.fixture
def never(monkeypatch):
    def simulate(*_):
        raise AssertionError("simulated, though the outputs cannot be written")

    monkeypatch.setattr(replay, "replay_mjx", simulate)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "{folder}"], "{folder}: cannot be written: it is a folder"),
        (["--out", "{folder}/file/a/b.json"], "{folder}/file/a/b.json: cannot be written: Not a directory"),
        (["--out", "/dev/full"], "/dev/full: cannot be written: it is a device or a pipe"),
        (["--out", "{folder}/plan.npz"], "must be different files"),
        (["--out", "{folder}/link"], "must be different files"),
        (["--out", "{folder}/a.gif", "--video", "{folder}/a.gif"], "must be different files"),
        (["--video", "{folder}/walk.mp4"], "--video is {folder}/walk.mp4, but must end in .gif"),
        (["--video", "{folder}/walk"], "must end in .gif"),
        (["--video", "{folder}/file/walk.gif"], "{folder}/file/walk.gif: cannot be written: Not a directory"),
    ],
)
def test_outputs_are_checked_before_the_simulation(plan, never, tmp_path, capsys, options, words):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to(plan)
    before = sorted(os.listdir(tmp_path)), plan.read_bytes()
    error = refused(capsys, "replay", str(plan), *(option.format(folder=tmp_path) for option in options))
    assert words.format(folder=tmp_path) in error
    assert error.count("\n") == 1
    assert (sorted(os.listdir(tmp_path)), plan.read_bytes()) == before


def test_a_plan_that_is_a_folder_is_refused(never, capsys):
    for name in (".", "..", "/"):
        assert "cannot be read: it is a folder" in refused(capsys, "replay", name)


def test_what_is_not_finite_is_null(plan, tmp_path, monkeypatch, capsys):
    """Also in a folder that was not there; nothing else is left in it."""
    nan, inf = float("nan"), float("inf")
    result = {
        "engine": "mjx",
        "fell": True,
        "finished": False,
        "energy_per_metre": {"net": nan, "positive": inf},
        "cost_of_transport": np.float64(-inf),
    }
    monkeypatch.setattr(replay, "replay_mjx", lambda *_: (FIGURES | result, np.zeros((0, 19))))
    out = tmp_path / "new" / "folder" / "result"
    with pytest.raises(SystemExit) as stop:
        main(["replay", str(plan), "--out", str(out)])
    assert stop.value.code == 1

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    read = json.loads(out.read_text(), parse_constant=refuse)
    assert read == FIGURES | result | {
        "energy_per_metre": {"net": None, "positive": None},
        "cost_of_transport": None,
        "plan": str(plan),
    }
    assert os.listdir(out.parent) == ["result"]
