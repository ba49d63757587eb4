"""Archives of arrays (`.npz`): one reader and one writer for maps and plans."""

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.lib import format as npy
from numpy.typing import ArrayLike

from jaxleg.files import replace_whole


def write_npz(path: str | Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write plain arrays, compressed, to exactly this path. Raises `InputError` as `replace_whole`."""

    def write(part: Path) -> None:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            for key, value in arrays.items():
                with archive.open(f"{key}.npy", "w", force_zip64=True) as member:
                    npy.write_array(member, np.asarray(value), allow_pickle=False)

    replace_whole(path, write)
