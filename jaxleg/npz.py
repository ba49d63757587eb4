"""Archives of arrays (`.npz`): one reader and one writer for maps and plans.

Nothing of a file is believed before it is checked: an array's type and shape are those of its header, compared with what is
wanted before any of its data is unpacked; only what is wanted is read, at most `LARGEST` numbers and `LONGEST` characters.
"""

import contextlib
import os
import zipfile
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike

from jaxleg.conventions import InputError
from jaxleg.files import open_file, replace_whole

LARGEST = 25_000_000  # numbers in all arrays together: a map of 5000 x 5000 cells, 0.2 GB
LONGEST = 1_000_000  # characters of a text
_KINDS = {"numbers": "fiu", "booleans": "b", "a text": "U"}  # dtype.kind; not complex, not times, not objects
_TAIL, _CONTENTS = 65_557, 1_000_000  # bytes: where an archive's end record may stand, and most of its table of contents
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what numpy writes
Header = tuple[tuple[int, ...], np.dtype]  # the shape and the type that an array's header declares
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


class Layout(NamedTuple):
    """What an array must be. A name in the shape is any length, but the same wherever it stands in the file."""

    shape: tuple[int | str, ...]
    kind: Literal["numbers", "booleans", "a text"] = "numbers"
    optional: bool = False


def read_npz(path: str | Path, layouts: Mapping[str, Layout], about: str) -> dict[str, Any]:
    """Read the arrays of `layouts`: numbers as float64, booleans as bool, a text as str; an optional one may be left out.

    Raises `InputError`, one sentence that names the file (and the key), whatever is wrong; `about` ends that of a missing key.
    """
    path = Path(path)
    with _reading(path):
        archive = _open(path)
    with archive:
        present = _members(path, archive, layouts)
        for key in layouts:
            if key not in present and not layouts[key].optional:
                raise InputError(f"{path}: {key} is missing; {about}")
        headers = {key: _header(path, archive, key, member) for key, member in present.items()}
        _check_shapes(path, headers, {key: layouts[key] for key in headers})
        return {key: _data(path, archive, key, member, layouts[key]) for key, member in present.items()}


@contextlib.contextmanager
def _reading(path: Path, key: str = "") -> Generator[None]:
    """Whatever is raised is said in a sentence: what the parsers of zip, npy and their codecs raise is not documented."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        reason = "it is damaged or holds no plain array" if key else "it is not a .npz file of plain arrays"
        if isinstance(error, MemoryError):
            reason = "it does not fit into memory"
        elif isinstance(error, OSError) and not key:
            reason = error.strerror or reason
        raise InputError(f"{path}: {key}{' ' if key else ''}cannot be read: {reason}") from error


def _open(path: Path) -> zipfile.ZipFile:
    """The archive, if its table of contents is of a size that a list of arrays may have."""
    with open_file(path) as file:
        file.seek(-min(_TAIL, file.seek(0, os.SEEK_END)), os.SEEK_END)
        tail = file.read()
    end = tail[tail.rfind(b"PK\5\6") :]  # the zip format's end record: the size of the table stands at byte 12
    if int.from_bytes(end[12:16], "little") > _CONTENTS:
        raise ValueError("a table of contents as long as that is none of a few arrays")
    return zipfile.ZipFile(path)


def _members(path: Path, archive: zipfile.ZipFile, layouts: Mapping[str, Layout]) -> dict[str, zipfile.ZipInfo]:
    """Where the archive holds the arrays that it has."""
    found: dict[str, zipfile.ZipInfo] = {}
    for info in archive.infolist():
        key = info.filename.removesuffix(".npy")
        if key not in layouts or key == info.filename:
            continue
        if key in found:
            raise InputError(f"{path}: {key} is there more than once")
        if info.compress_type not in _METHODS:
            raise InputError(f"{path}: {key} is compressed by method {info.compress_type}, which numpy does not write")
        if info.flag_bits & 0x1:
            raise InputError(f"{path}: {key} is encrypted")
        found[key] = info
    return found


def _header(path: Path, archive: zipfile.ZipFile, key: str, member: zipfile.ZipInfo) -> Header:
    with _reading(path, key), archive.open(member) as stream:
        shape, _, dtype = _HEADERS[npy.read_magic(stream)](stream)
    return shape, dtype


def _check_shapes(path: Path, headers: Mapping[str, Header], layouts: Mapping[str, Layout]) -> None:
    lengths: dict[str, int] = {}
    total = 0
    for key, (shape, dtype) in headers.items():
        layout = layouts[key]
        fits = dtype.kind in _KINDS[layout.kind] and len(shape) == len(layout.shape)
        fits = fits and all(a == (lengths.get(b, a) if isinstance(b, str) else b) for a, b in zip(shape, layout.shape))
        if not fits:
            raise InputError(f"{path}: {key} {_has(shape, dtype)}, but must be {_words(layout, lengths)}")
        lengths |= {b: a for a, b in zip(shape, layout.shape) if isinstance(b, str)}
        total += abs(int(np.prod(shape, dtype=object)))
        if total > LARGEST or (dtype.kind == "U" and dtype.itemsize > 4 * LONGEST):
            limit = f"{LONGEST} characters" if dtype.kind == "U" else f"{LARGEST} numbers in the whole file"
            raise InputError(f"{path}: {key} {_has(shape, dtype)}, more than {limit}")


def _data(path: Path, archive: zipfile.ZipFile, key: str, member: zipfile.ZipInfo, layout: Layout) -> Any:
    with _reading(path, key), archive.open(member) as stream, np.errstate(over="ignore"):
        value = npy.read_array(stream, allow_pickle=False)
        if stream.read(1):  # to meet the end is also what makes zipfile compare the checksum
            raise ValueError("it goes on behind its array")
        return str(value) if layout.kind == "a text" else value.astype(float if layout.kind == "numbers" else bool, copy=False)


def _words(layout: Layout, lengths: Mapping[str, int]) -> str:
    shape = ", ".join(str(lengths.get(x, x)) if isinstance(x, str) else str(x) for x in layout.shape)
    return f"{layout.kind} in {len(layout.shape)} dimension{'' if len(layout.shape) == 1 else 's'}, ({shape})"


def _has(shape: tuple[int, ...], dtype: np.dtype) -> str:
    texts = (text if len(text) <= 60 else f"{text[:57]}..." for text in map(str, (shape, dtype)))
    return "has shape {} of {}".format(*texts)


def write_npz(path: str | Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write plain arrays, compressed, to exactly this path. Raises `InputError` as `replace_whole`."""

    def write(part: Path) -> None:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            for key, value in arrays.items():
                with archive.open(f"{key}.npy", "w", force_zip64=True) as member:
                    npy.write_array(member, np.asarray(value), allow_pickle=False)

    replace_whole(path, write)
