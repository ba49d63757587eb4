"""RunFolder: nothing is overwritten, what was saved comes back, and a kill leaves a folder to resume from."""

import csv
import dataclasses
import errno
import json
import multiprocessing
import resource
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.search.run_folder import RunFolder
from jaxleg.settings import load, setting


@dataclasses.dataclass(frozen=True)
class Search:
    starts: int = setting(8, min=1)
    rate: float | None = setting(None)


@dataclasses.dataclass(frozen=True)
class Study:
    name: str = setting("flat")
    search: Search = Search()


class State(NamedTuple):
    point: Any
    moments: Any
    step: Any
    loss: Any = None


CONFIG = Study()
NEW = ["about.json", "checkpoints", "config.toml", "figures"]


def refusal(path: Path, config: Study = CONFIG, resume: bool = False) -> str:
    """The sentence with which opening is refused, having changed nothing."""
    before = contents(path.parent)
    with pytest.raises(InputError) as caught:
        RunFolder.open(path, {"config": config}, resume)
    assert contents(path.parent) == before
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


def contents(folder: Path) -> dict[str, bytes | None]:
    paths = folder.rglob("*") if folder.is_dir() else []
    return {str(path): path.read_bytes() if path.is_file() else None for path in paths}


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder.open(tmp_path / "deep" / "run", {"config": CONFIG}, resume=False)


def again(folder: RunFolder) -> RunFolder:
    folder.close()
    return RunFolder.open(folder.path, {"config": CONFIG}, resume=True)


def state(seed: int = 0) -> State:
    rng = np.random.default_rng(seed)
    moments = {"mean": jnp.asarray(rng.random((2, 3)), dtype=jnp.float32), "empty": jnp.zeros((0, 3))}
    key = jax.random.key_data(jax.random.key(seed))
    return State(point=rng.random((4, 3)), moments=[moments, key], step=np.asarray(seed), loss=0.1 * seed)


def assert_same(found: Any, wanted: Any) -> None:
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for left, right in zip(jax.tree.leaves(found), jax.tree.leaves(wanted)):
        assert type(left) is type(right)
        np.testing.assert_array_equal(left, right, strict=True)


def test_new_folder(folder: RunFolder) -> None:
    assert sorted(path.name for path in folder.path.iterdir() if path.name != ".lock") == NEW
    assert load(Study, folder.config) == CONFIG


def test_empty_folder_is_used(tmp_path: Path) -> None:
    assert RunFolder.open(str(tmp_path), {"config": CONFIG}, resume=False).config.exists()


def test_run_is_not_overwritten(folder: RunFolder) -> None:
    assert "already holds a run; give another --out, or --resume to continue it" in refusal(folder.path)


def test_other_folders_and_files_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert "is not a run folder" in refusal(tmp_path)
    assert "holds no run to resume" in refusal(tmp_path, resume=True)
    assert "is not a run folder" in refusal(tmp_path / "notes.txt")
    assert "Not a directory" in refusal(tmp_path / "notes.txt" / "run")
    assert "holds no run to resume" in refusal(tmp_path / "notes.txt" / "run", resume=True)
    assert "holds no run to resume" in refusal(tmp_path / "missing", resume=True)


def test_folder_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write anywhere, so the system's answer is put in its mouth."""

    def mkdir(path: Path, *_, **__) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "mkdir", mkdir)
    message = refusal(tmp_path / "run")
    assert "Permission denied" in message
    assert str(tmp_path / "run") in message


@pytest.mark.parametrize(
    ("config", "parts"),
    [
        (Study("rough"), ["name is 'flat' in this run, but 'rough' now"]),
        (Study(search=Search(9)), ["search.starts is 8 in this run, but 9 now"]),
        (Study(search=Search(rate=0.5)), ["search.rate is 'not set' in this run, but 0.5 now"]),
    ],
)
def test_resume_with_other_settings(folder: RunFolder, config: Study, parts: list[str]) -> None:
    message = refusal(folder.path, config, resume=True)
    assert [part for part in [*parts, "config.toml", "--out"] if part not in message] == []


@pytest.mark.parametrize("left", [[], [".lock", "about.json"], [".4711.config.toml", "about.json", "robot.toml"]])
def test_what_a_kill_at_the_very_beginning_leaves_is_begun_anew(tmp_path: Path, left: list[str]) -> None:
    (tmp_path / "run").mkdir()
    for name in left:
        (tmp_path / "run" / name).touch()
    tables = {"config": CONFIG, "robot": Search()}
    assert "holds no run to resume" in refusal(tmp_path / "run", resume=True)
    assert RunFolder.open(tmp_path / "run", tables, resume=False).config.exists()


def test_one_process_at_a_time(folder: RunFolder) -> None:
    sentence = "another process is at work in this folder"
    assert sentence in refusal(folder.path, resume=True)
    process = multiprocessing.get_context("spawn").Process(target=save_for_ever, args=(folder.path,))
    process.start()
    process.join()
    assert process.exitcode != 0
    assert newest(folder.checkpoints / "s") == 0
    again(folder)


def test_a_changed_robot_is_noticed(tmp_path: Path) -> None:
    tables = {"config": CONFIG, "robot": Search(8)}
    RunFolder.open(tmp_path, tables, resume=False).close()
    with pytest.raises(InputError, match=r"robot.toml: starts is 8 in this run, but 9 now"):
        RunFolder.open(tmp_path, tables | {"robot": Search(9)}, resume=True)
    RunFolder.open(tmp_path, tables, resume=True).close()


def test_changed_versions_are_told(tmp_path: Path) -> None:
    RunFolder.open(tmp_path, {"config": CONFIG}, False, {"jax": "1", "devices": "2"}).close()
    folder = RunFolder.open(tmp_path, {"config": CONFIG}, True, {"jax": "1", "devices": "1"})
    assert folder.changes == ["devices 2, now 1"]
    folder.close()
    assert RunFolder.open(tmp_path, {"config": CONFIG}, True, {"jax": "1", "new": "3"}).changes == ["new unknown, now 3"]


@pytest.mark.parametrize("text", ["", "[]", "{"])
def test_a_damaged_about(tmp_path: Path, text: str) -> None:
    RunFolder.open(tmp_path, {"config": CONFIG}, False, {"jax": "1"}).close()
    (tmp_path / "about.json").write_text(text)
    with pytest.raises(InputError, match=r"about.json: is not what a run writes there"):
        RunFolder.open(tmp_path, {"config": CONFIG}, True, {"jax": "1"})


@pytest.mark.parametrize("name", ["²", "٣", "01", "1x", "-1"])
def test_folders_that_are_no_checkpoints(folder: RunFolder, name: str) -> None:
    (folder.checkpoints / "s" / name).mkdir(parents=True)
    assert folder.load("s", state()) is None
    folder.save("s", state(1))
    assert_same(folder.load("s", state()), state(1))


WRITES = {
    "checkpoint": lambda folder: folder.save("s", state(2)),
    "history": lambda folder: folder.append_history(step(2)),
    "result": lambda folder: folder.write_result({"new": 2}),
}


def fill_the_disk(paths: dict[str, Path]) -> None:
    """A full disk for this process: no file may grow."""
    folders = {what: RunFolder.open(path, {"config": CONFIG}, resume=True) for what, path in paths.items()}
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    for what, folder in folders.items():
        try:
            WRITES[what](folder)
        except InputError as error:
            if "cannot be" not in str(error) or "\n" in str(error):
                sys.exit(f"{what}: {error}")
        else:
            sys.exit(f"{what} was written")


def test_a_full_disk_is_one_sentence_and_loses_nothing(tmp_path: Path, capfd: Any) -> None:
    folders = {what: RunFolder.open(tmp_path / what, {"config": CONFIG}, resume=False) for what in WRITES}
    for folder in folders.values():
        folder.save("s", state(1))
        folder.append_history(step(1))
        folder.write_result({"old": 1})
        folder.close()
    before = contents(tmp_path)
    paths = {what: folder.path for what, folder in folders.items()}
    process = multiprocessing.get_context("spawn").Process(target=fill_the_disk, args=(paths,))
    process.start()
    process.join()
    assert capfd.readouterr().err == ""  # orbax would log tracebacks
    assert process.exitcode == 0
    after = contents(tmp_path)
    assert {name: after.get(name) for name in before} == before
    for folder in map(again, folders.values()):
        assert_same(folder.load("s", state()), state(1))
        folder.save("s", state(2))
        assert_same(folder.load("s", state()), state(2))


def test_resume_with_a_broken_config(folder: RunFolder) -> None:
    folder.config.write_text("name = ")
    assert "not valid TOML" in refusal(folder.path, resume=True)


def test_checkpoint_comes_back(folder: RunFolder) -> None:
    assert folder.load("flat/iii", state()) is None
    folder.save("flat/iii", state(1))
    folder.save("flat/iii", state(2))
    folder.save("flat", state(3))
    assert_same(again(folder).load("flat/iii", state()), state(2))
    assert_same(again(folder).load("flat", state()), state(3))


def test_checkpoint_into_shapes_only(folder: RunFolder) -> None:
    tree = {"a": jnp.arange(3.0), "empty": jnp.zeros((2, 0))}
    folder.save("s", tree)
    assert_same(folder.load("s", jax.eval_shape(lambda: tree)), tree)


@pytest.mark.parametrize("stage", ["..", ".", "a/../../b", "flat/iii", "flat%2Fiii", "flat--iii", "é ü"])
def test_stage_names_are_one_folder_each(folder: RunFolder, stage: str) -> None:
    folder.save("flat_iii", np.zeros(1))
    folder.save(stage, np.ones(2))
    assert len(list(folder.checkpoints.iterdir())) == 2
    np.testing.assert_array_equal(folder.load(stage, np.zeros(2)), np.ones(2))
    assert sorted(path.name for path in folder.path.iterdir() if path.name != ".lock") == NEW


@pytest.mark.parametrize(
    ("like", "parts"),
    [
        ({"a": np.zeros(3)}, ["((2,), 'float64') as ['a']", "needs ((3,), 'float64')"]),
        ({"a": np.zeros(2, np.float32)}, ["'float64'", "'float32'"]),
        ({"a": np.zeros(2), "b": np.zeros(1)}, ["holds nothing as ['b']"]),
        ({}, ["['a']", "needs nothing"]),
    ],
)
def test_checkpoint_of_another_shape(folder: RunFolder, like: Any, parts: list[str]) -> None:
    folder.save("s", {"a": np.zeros(2)})
    with pytest.raises(InputError) as caught:
        folder.load("s", like)
    assert [part for part in [*parts, str(folder.checkpoints / "s")] if part not in str(caught.value)] == []


def test_unfinished_checkpoint_is_ignored_and_removed(folder: RunFolder) -> None:
    folder.save("s", state(1))
    stale = folder.checkpoints / "s" / "2.orbax-checkpoint-tmp"
    stale.mkdir()
    (stale / "half").write_text("x")
    assert_same(folder.load("s", state()), state(1))
    folder.save("s", state(2))
    assert [path.name for path in (folder.checkpoints / "s").iterdir()] == ["2"]
    assert_same(folder.load("s", state()), state(2))


def test_damaged_checkpoint(folder: RunFolder) -> None:
    folder.save("s", state(1))
    (folder.checkpoints / "s" / "1" / "default" / "_METADATA").unlink()
    with pytest.raises(InputError, match=r"checkpoints/s: cannot be read; delete it"):
        folder.load("s", state())


def rows(folder: RunFolder) -> list[dict[str, str]]:
    with folder.history.open(newline="") as file:
        return list(csv.DictReader(file))


def step(number: int, cost: Any = 1.0) -> dict[str, Any]:
    return {"kind": "descent", "stage": "flat, iii", "step": number, "terrains": 4, "best": cost, "mean": 2.0, "seconds": 0.1}


def test_history_keeps_each_step_once_over_resumes(folder: RunFolder) -> None:
    for number in range(3):
        folder.append_history(step(number))
    folder.append_history(step(2, 9.0))
    resumed = again(folder)
    for number in range(1, 5):
        resumed.append_history(step(number, 2.0))
    assert [(row["step"], row["best"]) for row in rows(folder)] == [
        ("0", "1.0"), ("1", "1.0"), ("2", "1.0"), ("3", "2.0"), ("4", "2.0"),
    ]  # fmt: skip
    assert rows(folder)[0]["stage"] == "flat, iii"


def test_history_cells_are_exact(folder: RunFolder) -> None:
    values = [0.1 + 0.2, np.float64(1 / 3), np.float32(0.1), jnp.asarray(7), float("nan")]
    for number, value in enumerate(values):
        folder.append_history(step(number, value))
    cells = [row["best"] for row in rows(folder)]
    assert [float(cell) for cell in cells[:3]] == [0.1 + 0.2, 1 / 3, float(np.float32(0.1))]
    assert cells[3:] == ["7", ""]


@pytest.mark.parametrize("cut", [1, 5, 25])
def test_history_row_cut_by_a_kill_is_written_again(folder: RunFolder, cut: int) -> None:
    for number in range(2):
        folder.append_history(step(number))
    whole = folder.history.read_bytes()
    folder.history.write_bytes(whole[:-cut])
    resumed = again(folder)
    for number in range(2):
        resumed.append_history(step(number))
    assert folder.history.read_bytes() == whole


def test_history_with_other_columns(folder: RunFolder) -> None:
    """Before any work: a resume would otherwise find out after minutes."""
    folder.history.write_text("kind,stage,step,loss\na,b,1,0.0\n")
    with pytest.raises(InputError, match=r"history.csv: has the columns .*loss.* must have .*mean"):
        again(folder)
    assert folder.history.read_text().endswith("0.0\n")


def test_result(folder: RunFolder) -> None:
    result = {
        "z": 0.1 + 0.2,
        "a": [np.float32(0.5), np.inf],
        "n": {"nan": np.nan},
        "j": jnp.asarray([1, 2]),
        "t": (True,),
    }
    folder.write_result({"old": 1})
    folder.write_result(result)
    found = json.loads(folder.result.read_text())
    assert found == {"z": 0.1 + 0.2, "a": [0.5, None], "n": {"nan": None}, "j": [1, 2], "t": [True]}
    assert list(found) == list(result)
    assert [path.name for path in folder.path.glob(".*")] == [".lock"]


def newest(stage: Path) -> int:
    return max((int(path.name) for path in stage.glob("*") if path.name.isdecimal()), default=0)


def save_for_ever(path: Path) -> None:
    folder = RunFolder.open(path, {"config": CONFIG}, resume=True)
    for number in range(10**6):
        folder.save("s", state(number))


def test_kill_while_saving_leaves_a_whole_checkpoint(folder: RunFolder) -> None:
    folder.close()
    process = multiprocessing.get_context("spawn").Process(target=save_for_ever, args=(folder.path,))
    process.start()
    while process.is_alive() and newest(folder.checkpoints / "s") < 3:
        time.sleep(0.001)
    assert process.is_alive()
    process.kill()
    process.join()
    folder = again(folder)
    found = folder.load("s", state())
    assert_same(found, state(int(found.step)))
    folder.save("s", state(5))
    assert_same(folder.load("s", state()), state(5))
