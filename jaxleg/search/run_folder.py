"""RunFolder: what a study keeps on disk, written so that a kill at any time leaves a folder to resume from.

config.toml    the settings of the run, complete; what makes a folder a run folder
robot.toml     the robot's numbers as they were read; any further table that the run is made of stands beside it likewise
about.json     the versions and devices that the run began with
history.csv    one row per (kind, stage, step)
result.json    the numbers of the finished study
best.toml      the settings of the best answer
figures/
checkpoints/   <stage>/<number>; the highest number counts
.lock          held by the process that works in the folder
"""

import contextlib
import csv
import errno
import io
import json
import logging
import os
import re
import shutil
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

import filelock
import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.conventions import InputError
from jaxleg.files import plain, refusal, write_json
from jaxleg.settings import dotted, dump, load, to_table, write_whole, written

Tree = TypeVar("Tree")
ROOM = 2**20  # that a checkpoint must find on the disk besides its arrays [bytes]
HISTORY_KEY = ("kind", "stage", "step")
HISTORY = (*HISTORY_KEY, "terrains", "best", "mean", "seconds")  # columns


class RunFolder:
    """A study's folder, made by `RunFolder.open`; the attributes are the paths in it, `changes` what a resume finds changed."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()  # orbax takes no other
        self.config = self.path / "config.toml"
        self.about = self.path / "about.json"
        self.history = self.path / "history.csv"
        self.result = self.path / "result.json"
        self.best = self.path / "best.toml"
        self.figures = self.path / "figures"
        self.checkpoints = self.path / "checkpoints"
        self.changes: list[str] = []
        self._lock = filelock.FileLock(self.path / ".lock", timeout=0)
        self._written: set[tuple[str, ...]] = set()

    @classmethod
    def open(
        cls, path: str | Path, tables: Mapping[str, Any], resume: bool, about: Mapping[str, str] | None = None
    ) -> "RunFolder":
        """A new folder, or with `resume` that of an equal run; it stays locked against other processes until `close`.

        `tables` are the dataclasses that the run is made of, each kept as NAME.toml, "config" among them. `about` is what
        may change the last digits of a result (versions, devices): a resume lists in `changes` what has changed of it.
        Raises `InputError`, and leaves what is there as it is, if a new run would overwrite something, there is no run to
        resume or it has other settings or a history of other columns, another process is at work in the folder, or it
        cannot be written.
        """
        folder = cls(Path(path))
        with refusal(folder.path, "used"):
            folder._require(tables, resume)
            folder.path.mkdir(parents=True, exist_ok=True)
            folder._take()
            try:
                folder._require(tables, resume)  # again: another process may have been here before the lock
                folder._compare(about or {}) if resume else folder._begin(tables, about or {})
                folder.figures.mkdir(exist_ok=True)
                folder.checkpoints.mkdir(exist_ok=True)
            except BaseException:
                folder.close()
                raise
        return folder

    def close(self) -> None:
        """Let other processes have the folder."""
        self._lock.release()

    def save(self, stage: str, tree: Any) -> None:
        """Checkpoint a pytree of arrays (without a number there is none); the earlier one goes once this one is complete.

        Raises `InputError` if it cannot be written.
        """
        folder = self._stage_folder(stage)
        arrays = {name: np.asarray(leaf) for name, leaf in _named_leaves(tree).items() if np.size(leaf)}
        if not arrays:
            return
        with refusal(folder, "used"):
            folder.mkdir(parents=True, exist_ok=True)
            _require_room(folder, sum(x.nbytes for x in arrays.values()))
            _write_checkpoint(folder, arrays)

    def load(self, stage: str, like: Tree) -> Tree | None:
        """The stage's checkpoint as a tree like `like` (of arrays or `jax.ShapeDtypeStruct`), or None.

        Raises `InputError` if it cannot be read, or its arrays differ from `like` in name, shape or type.
        """
        folder = self._stage_folder(stage)
        if not folder.exists():
            return None
        try:
            with _checkpoints(folder) as (manager, content):
                newest = manager.latest_step()
                saved = None if newest is None else manager.restore(newest, args=content.StandardRestore())
        except Exception as error:  # a damaged checkpoint fails in orbax in any way
            raise InputError(f"{folder}: cannot be read; delete it to run the stage again") from error
        if saved is None:
            return None
        leaves = _named_leaves(like)
        _require_same_arrays(saved, leaves, folder)
        restored = [_like(leaf, saved.get(name)) for name, leaf in leaves.items()]
        return jax.tree.unflatten(jax.tree.structure(like), restored)

    def append_history(self, row: Mapping[str, Any]) -> None:
        """Add a row to history.csv, unless its (kind, stage, step) is there: a resumed run repeats steps.

        What is not finite becomes an empty cell. Raises `InputError` if the file cannot be written.
        """
        key = tuple(str(row[name]) for name in HISTORY_KEY)
        if key in self._written:
            return
        header = [] if self._written else [HISTORY]
        with refusal(self.history, "used"), self.history.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([*header, plain([row[name] for name in HISTORY])])
        self._written.add(key)

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Write result.json, null for what is not finite. Raises `InputError` if it cannot be written."""
        write_json(self.result, result)

    def _require(self, tables: Mapping[str, Any], resume: bool) -> None:
        if not resume:
            return self._require_empty(tables)
        if not self.config.exists():
            raise InputError(f"{self.path}: holds no run to resume (no config.toml); leave out --resume")
        for name, table in tables.items():
            self._require_equal(self.path / f"{name}.toml", table)
        self._history_rows()

    def _require_empty(self, tables: Mapping[str, Any]) -> None:
        if self.config.exists():
            advice = "give another --out, or --resume to continue it"
            raise InputError(f"{self.path}: already holds a run; {advice}")
        if self.path.exists() and (not self.path.is_dir() or not self._is_ours(tables)):
            raise InputError(f"{self.path}: is not a run folder, nor empty; give another --out")

    def _is_ours(self, tables: Mapping[str, Any]) -> bool:
        """Whether a folder without a config.toml holds no more than a kill at the very beginning leaves."""
        names = {"about.json", *(f"{name}.toml" for name in tables)}
        begun = (re.sub(r"^\.[0-9]+\.", "", path.name) for path in self.path.iterdir())  # a half-written file: `replace_whole`
        return {".lock", *names}.issuperset(begun)

    def _take(self) -> None:
        try:
            self._lock.acquire()
        except filelock.Timeout as error:
            raise InputError(f"{self.path}: another process is at work in this folder; give another --out") from error

    def _begin(self, tables: Mapping[str, Any], about: Mapping[str, str]) -> None:
        write_json(self.about, about)
        for name in sorted(tables, key="config".__eq__):  # config.toml last: it makes the folder a run's
            dump(tables[name], self.path / f"{name}.toml")

    def _compare(self, about: Mapping[str, str]) -> None:
        try:
            before = json.loads(self.about.read_text("utf-8"))
            pairs = {name: (before.get(name, "unknown"), now) for name, now in about.items()}
            self.changes = [f"{name} {old}, now {new}" for name, (old, new) in pairs.items() if old != new]
        except (ValueError, AttributeError) as error:
            raise InputError(f"{self.about}: is not what a run writes there; restore it or give another --out") from error
        whole = self._history_rows()
        self._written = {tuple(row[:3]) for row in csv.reader(io.StringIO(whole, newline=""))}
        if self.history.exists() and whole != self.history.read_text("utf-8", "replace"):  # a kill cut the last row
            write_whole(self.history, whole)

    def _require_equal(self, path: Path, table: Any) -> None:
        with contextlib.suppress(OSError, ValueError):  # what cannot be read is told by `load`
            if path.read_text("utf-8") == written(table):
                return
        before, now = dotted(to_table(load(type(table), path))), dotted(to_table(table))
        for key in {**now, **before}:
            old, new = before.get(key, "not set"), now.get(key, "not set")
            if old != new:
                words = f"{key} is {old!r} in this run, but {new!r} now"
                raise InputError(f"{path}: {words}; resume with its settings or give another --out")

    def _history_rows(self) -> str:
        """The whole rows of history.csv. Raises `InputError` if it is another's."""
        text = self.history.read_text("utf-8", "replace") if self.history.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        header = whole.partition("\n")[0]
        if whole and header != ",".join(HISTORY):
            words = f"has the columns {header[:60]!r}, but must have {','.join(HISTORY)!r}"
            raise InputError(f"{self.history}: {words}; restore it or delete it")
        return whole

    def _stage_folder(self, stage: str) -> Path:
        return self.checkpoints / quote(stage, safe="").replace(".", "%2E")  # quote leaves ".." as it is


def _require_room(folder: Path, size: int) -> None:
    """Orbax's threads print tracebacks of their own on a disk that fills up under them, so it is asked before."""
    needed, free = 2 * size + ROOM, shutil.disk_usage(folder).free
    if free < needed:
        raise InputError(f"{folder}: cannot be written: {os.strerror(errno.ENOSPC)}: {free} bytes of {needed} are free")


@contextlib.contextmanager
def _checkpoints(folder: Path) -> Generator[tuple[Any, Any], None, None]:
    """Orbax's manager of a stage's checkpoints, the last complete one kept, and its names for what to save and restore.

    Without the tracebacks that orbax logs of errors which it also raises.
    """
    import orbax.checkpoint as ocp  # 1 s, which only a study need pay

    options = ocp.CheckpointManagerOptions(max_to_keep=1, cleanup_tmp_directories=True, enable_async_checkpointing=False)
    logger = logging.getLogger("absl")
    before, logger.disabled = logger.disabled, True
    try:
        with ocp.CheckpointManager(folder, options=options) as manager:
            yield manager, ocp.args
    finally:
        logger.disabled = before


def _write_checkpoint(folder: Path, arrays: Mapping[str, np.ndarray]) -> None:
    try:
        with _checkpoints(folder) as (manager, content):
            manager.save((manager.latest_step() or 0) + 1, args=content.StandardSave(dict(arrays)))
    except Exception as error:  # orbax raises anything for a disk that is full, in many words
        full = os.strerror(errno.ENOSPC)
        reason = full if full in str(error) else (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
        raise InputError(f"{folder}: cannot be written: {reason}") from error


def _named_leaves(tree: Any) -> dict[str, Any]:
    return {jax.tree_util.keystr(path): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(tree)}


def _spec(leaf: Any) -> tuple[tuple[int, ...], str]:
    array = leaf if hasattr(leaf, "dtype") else np.asarray(leaf)
    return tuple(array.shape), str(array.dtype)


def _require_same_arrays(saved: Mapping[str, Any], leaves: Mapping[str, Any], folder: Path) -> None:
    found = {name: _spec(leaf) for name, leaf in saved.items()}
    wanted = {name: _spec(leaf) for name, leaf in leaves.items() if 0 not in _spec(leaf)[0]}
    for name in {**wanted, **found}:
        has, needs = found.get(name, "nothing"), wanted.get(name, "nothing")
        if has != needs:
            words = f"holds {has} as {name or 'its array'}, but this run needs {needs}"
            raise InputError(f"{folder}: {words}; delete it to run the stage again")


def _like(leaf: Any, saved: np.ndarray | None) -> Any:
    array = np.zeros(*_spec(leaf)) if saved is None else saved  # orbax holds no empty arrays
    if isinstance(leaf, (np.ndarray, np.generic)):
        return array
    return jnp.asarray(array) if hasattr(leaf, "dtype") else array.item()
