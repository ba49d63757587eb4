"""RunFolder: what a study keeps on disk, written so that a kill at any time leaves a folder to resume from.

config.toml    the settings of the run, complete; what makes a folder a run folder
history.csv    one row per (kind, stage, step)
result.json    the numbers of the finished study
best.toml      the settings of the best answer
figures/
checkpoints/   <stage>/<number>; the highest number counts
"""

import contextlib
import csv
import functools
import io
import json
import math
import shutil
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.conventions import InputError
from jaxleg.settings import dump, load, to_table, write_whole

Tree = TypeVar("Tree")
HISTORY_KEY = ("kind", "stage", "step")


class RunFolder:
    """A study's folder, made by `RunFolder.open`; the attributes are the paths in it."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()  # orbax takes no other
        self.config = self.path / "config.toml"
        self.history = self.path / "history.csv"
        self.result = self.path / "result.json"
        self.best = self.path / "best.toml"
        self.figures = self.path / "figures"
        self.checkpoints = self.path / "checkpoints"
        self._columns: list[str] = []
        self._written: set[tuple[str, ...]] = set()

    @classmethod
    def open(cls, path: str | Path, config: Any, resume: bool) -> "RunFolder":
        """A new folder for the settings `config` (a dataclass), or with `resume` that of an equal run.

        Raises `InputError`, and leaves what is there as it is, if a new run would overwrite something, there
        is no run to resume or it has other settings, or the folder cannot be written.
        """
        folder = cls(Path(path))
        with _using(folder.path):
            if resume:
                folder._require_run_of(config)
                folder._read_history()
            else:
                folder._require_empty()
                folder.path.mkdir(parents=True, exist_ok=True)
                dump(config, folder.config)
            folder.figures.mkdir(exist_ok=True)
            folder.checkpoints.mkdir(exist_ok=True)
        return folder

    def save(self, stage: str, tree: Any) -> None:
        """Checkpoint a pytree of arrays; the stage's earlier one goes once this one is complete.

        Raises `InputError` if it cannot be written.
        """
        folder = self._stage_folder(stage)
        newest = _newest(folder)
        arrays = {name: np.asarray(leaf) for name, leaf in _named_leaves(tree).items() if np.size(leaf)}
        with _using(folder):
            folder.mkdir(parents=True, exist_ok=True)
            _remove_all_but(newest, folder)  # what a killed save left
            _checkpointer().save(folder / str(newest + 1), arrays)
            _remove_all_but(newest + 1, folder)

    def load(self, stage: str, like: Tree) -> Tree | None:
        """The stage's checkpoint as a tree like `like` (of arrays or `jax.ShapeDtypeStruct`), or None.

        Raises `InputError` if it cannot be read, or its arrays differ from `like` in name, shape or type.
        """
        folder = self._stage_folder(stage)
        if not (newest := _newest(folder)):
            return None
        try:
            saved = _checkpointer().restore(folder / str(newest))
        except (OSError, ValueError, KeyError) as error:
            raise InputError(f"{folder}: cannot be read; delete it to run the stage again") from error
        leaves = _named_leaves(like)
        _require_same_arrays(saved, leaves, folder)
        restored = [_like(leaf, saved.get(name)) for name, leaf in leaves.items()]
        return jax.tree.unflatten(jax.tree.structure(like), restored)

    def append_history(self, row: Mapping[str, Any]) -> None:
        """Add a row to history.csv, unless its (kind, stage, step) is there: a resumed run repeats steps.

        What is not finite becomes an empty cell. Raises `InputError` if the columns are not those of the
        first row, or the file cannot be written.
        """
        key = tuple(str(row[name]) for name in HISTORY_KEY)
        if key in self._written:
            return
        if self._columns and list(row) != self._columns:
            raise InputError(f"{self.history}: has the columns {self._columns}, but must have {list(row)}")
        header = [] if self._columns else [list(row)]
        with _using(self.history), self.history.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([*header, _plain(list(row.values()))])
        self._columns = list(row)
        self._written.add(key)

    def write_result(self, result: Mapping[str, Any]) -> None:
        """Write result.json, null for what is not finite. Raises `InputError` if it cannot be written."""
        write_whole(self.result, json.dumps(_plain(result), indent=2, allow_nan=False) + "\n")

    def _require_empty(self) -> None:
        if self.config.exists():
            advice = "give another --out, or --resume to continue it"
            raise InputError(f"{self.path}: already holds a run; {advice}")
        if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
            raise InputError(f"{self.path}: is not a run folder, nor empty; give another --out")

    def _require_run_of(self, config: Any) -> None:
        if not self.config.exists():
            raise InputError(f"{self.path}: holds no run to resume (no config.toml); leave out --resume")
        before, now = _dotted(to_table(load(type(config), self.config))), _dotted(to_table(config))
        for key in {**now, **before}:
            old, new = before.get(key, "not set"), now.get(key, "not set")
            if old != new:
                words = f"{key} is {old!r} in this run, but {new!r} now"
                raise InputError(f"{self.config}: {words}; resume with its settings or give another --out")

    def _read_history(self) -> None:
        text = self.history.read_text("utf-8", "replace") if self.history.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        if whole != text:  # a kill cut the last row
            write_whole(self.history, whole)
        reader = csv.DictReader(io.StringIO(whole, newline=""))
        self._columns = list(reader.fieldnames or [])
        self._written = {tuple(row.get(name, "") for name in HISTORY_KEY) for row in reader}

    def _stage_folder(self, stage: str) -> Path:
        return self.checkpoints / quote(stage, safe="").replace(".", "%2E")  # quote leaves ".." as it is


@contextlib.contextmanager
def _using(path: Path) -> Generator[None, None, None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be used: {error.strerror or error}") from error


@functools.cache
def _checkpointer() -> Any:
    import orbax.checkpoint as ocp  # 1 s, which only a study need pay

    return ocp.Checkpointer(ocp.StandardCheckpointHandler())


def _newest(folder: Path) -> int:
    """Number of the stage's last complete checkpoint (orbax renames it when it is), 0 if there is none."""
    return max((int(path.name) for path in folder.glob("*") if path.name.isdigit()), default=0)


def _remove_all_but(number: int, folder: Path) -> None:
    for path in folder.iterdir():
        if path.name != str(number):
            shutil.rmtree(path)


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


def _dotted(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in table.items():
        flat |= _dotted(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return flat


def _plain(value: Any) -> Any:
    """As JSON can hold it."""
    if isinstance(value, (np.ndarray, np.generic, jax.Array)):
        value = np.asarray(value).tolist()
    if isinstance(value, Mapping):
        return {name: _plain(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
