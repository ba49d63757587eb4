"""Files that are replaced whole or not at all."""

import contextlib
import json
import math
import os
import stat
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from jaxleg.conventions import InputError


def replace_whole(path: str | Path, write: Callable[[Path], object]) -> None:
    """Let `write` make a file beside `path`, under another name that ends alike, and put it in its place.

    Whatever happens, the earlier file or the new one is there, whole. Missing parent folders are made, a link is followed.
    Raises `InputError`, "{path}: cannot be written: ...", where the place or the disk does not allow it.
    """
    with refusal(path, "written"):
        target, part = _target(path)
        try:
            write(part)
            os.replace(part, target)
        finally:
            with contextlib.suppress(OSError):  # the first failure is the one to tell
                part.unlink(missing_ok=True)


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON whole, null for what is not finite, lists for arrays. Raises `InputError` as `replace_whole`."""
    text = json.dumps(plain(value), indent=2, allow_nan=False) + "\n"
    replace_whole(path, lambda part: part.write_text(text, encoding="utf-8"))


def plain(value: Any) -> Any:
    """As JSON can hold it."""
    if hasattr(value, "tolist"):  # arrays and numbers of numpy and JAX
        value = value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check_writable(path: str | Path) -> None:
    """Raises `InputError` where `replace_whole` would find no place for a file: to be asked before long work."""
    with refusal(path, "written"):
        _, part = _target(path)
        part.touch()
        part.unlink()


def open_file(path: str | Path) -> BinaryIO:
    """A file to be read. Raises `InputError` for what cannot be opened, or is none: to open a pipe would wait for ever."""
    with refusal(path, "read"):
        mode = os.stat(_name(path, "read")).st_mode
        if not stat.S_ISREG(mode):
            raise InputError(f"{path}: cannot be read: it is a {'folder' if stat.S_ISDIR(mode) else 'device or a pipe'}")
        return Path(path).open("rb")


@contextlib.contextmanager
def refusal(path: str | Path, done: str) -> Generator[None]:
    """What the system refuses becomes an `InputError`: "{path}: cannot be {done}: ..."."""
    try:
        yield
    except (OSError, UnicodeError) as error:  # UnicodeError: a text that UTF-8 cannot hold
        raise InputError(f"{path}: cannot be {done}: {getattr(error, 'strerror', None) or error}") from error


def _target(path: str | Path) -> tuple[Path, Path]:
    """The file that is meant, its folder made, and where it is written at first."""
    target = Path(os.path.realpath(_name(path, "written")))
    if target.is_dir():
        raise InputError(f"{path}: cannot be written: it is a folder")
    if target.exists() and not target.is_file():
        raise InputError(f"{path}: cannot be written: it is a device or a pipe")
    with contextlib.suppress(FileExistsError):  # a file in the way; to open one below it says so better
        target.parent.mkdir(parents=True, exist_ok=True)
    return target, target.with_name(f".{os.getpid()}.{target.name}")


def _name(path: str | Path, done: str) -> str | Path:
    if "\0" in str(path):
        raise InputError(f"{str(path)!r}: cannot be {done}: a name holds no null character")
    return path
