"""Elevation maps from files: `.npz` with `elevation` [m] (NaN = unseen), `resolution` [m per cell] and `origin_xy` [m]."""

import zipfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxleg.conventions import InputError
from jaxleg.npz import write_npz
from jaxleg.terrain.heightmap import HeightMap

KEYS = {"elevation": 2, "resolution": 0, "origin_xy": 1}  # and their dimensions
LEAST = 4  # cells along each axis that a surface needs
RESOLUTIONS = (1e-3, 10.0)  # [m per cell]; outside it, a unit is wrong


def load_map(path: str | Path) -> HeightMap:
    """Read a map; `origin_xy` is the centre of cell [0, 0] in W, (0, 0) when left out.

    Raises `InputError`, one sentence that names file, key and value, for anything but finite or unseen elevations on a grid.
    """
    arrays = _read(Path(path))
    elevation, resolution = arrays["elevation"], float(arrays["resolution"])
    if min(elevation.shape) < LEAST:
        raise InputError(f"{path}: elevation has {_size(elevation)} cells, but must have at least {LEAST} x {LEAST}")
    if np.isinf(elevation).any():
        raise InputError(f"{path}: elevation is infinite in {np.isinf(elevation).sum()} cells; unseen ones must be NaN")
    if np.isnan(elevation).all():
        raise InputError(f"{path}: elevation is NaN in all {_size(elevation)} cells, but some must have been seen")
    if not RESOLUTIONS[0] <= resolution <= RESOLUTIONS[1]:
        raise InputError(f"{path}: resolution is {resolution:g} m, but must be from {RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g}")
    if not np.isfinite(arrays["origin_xy"]).all() or arrays["origin_xy"].shape != (2,):
        raise InputError(f"{path}: origin_xy is {arrays['origin_xy'].tolist()}, but must be two finite numbers")
    return HeightMap(*(jnp.asarray(x, float) for x in (elevation, arrays["origin_xy"], resolution)))


def save_map(terrain: HeightMap, path: str | Path) -> None:
    """Write a map that `load_map` reads back equal. Raises `InputError` where nothing can be written."""
    write_npz(path, {"elevation": terrain.elevation, "resolution": terrain.resolution, "origin_xy": terrain.origin})


def _read(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, TypeError, AttributeError) as error:
        reason = getattr(error, "strerror", None) or "it is not a .npz file of plain arrays"
        raise InputError(f"{path}: cannot be read: {reason}") from error
    arrays.setdefault("origin_xy", np.zeros(2))
    for key, dimensions in KEYS.items():
        if key not in arrays:
            raise InputError(f"{path}: {key} is missing; the file has {', '.join(sorted(arrays))}")
        value = arrays[key]
        if value.ndim != dimensions or not np.issubdtype(value.dtype, np.number) or np.iscomplexobj(value):
            raise InputError(
                f"{path}: {key} has shape {value.shape} of {value.dtype}, but must be numbers in {dimensions} dimensions"
            )
    return arrays


def _size(elevation: np.ndarray) -> str:
    return " x ".join(map(str, elevation.shape))
