"""Elevation maps from files: `.npz` with `elevation` [m] (NaN = unseen), `resolution` [m per cell] and `origin_xy` [m].

Float32 cannot hold centimetres at the coordinates of UTM, nor millimetres 4 km up, so a map is read as one near zero and its
**datum**: the point of W, in float64 and outside all compiled code, that the map's coordinates and heights count from. It is a
multiple of 64 m along each axis, which float32 holds exactly, the nearest to the map's middle and median height; maps near
zero keep theirs. A file may have a `datum` (x, y, z) of its own, that its origin and heights count from, as plans have.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxleg.conventions import InputError
from jaxleg.npz import Layout, read_npz, write_npz
from jaxleg.terrain.heightmap import HeightMap

LAYOUTS = {"elevation": Layout(("nx", "ny")), "resolution": Layout(())}
LAYOUTS |= {"origin_xy": Layout((2,), optional=True), "datum": Layout((3,), optional=True)}
LEAST = 4  # cells along each axis that a surface needs
RESOLUTIONS = (1e-3, 10.0)  # [m per cell]; outside it, a unit is wrong
FARTHEST = 1e8  # of any coordinate from zero [m]: five times the greatest of the maps of the earth
HIGHEST = 3e4  # of any height from zero [m]: three times that of the earth
NO_DATA = -9999.0  # [m], by a wide-spread habit; others are no heights, or lie far from the rest
CLIFF = 1500.0  # [m]; no greater range of heights is empty on the earth
STEEPEST, LEAST_RELIEF = 10.0, 50.0  # all heights of a map lie within so many times its diagonal, or within so much [m]
UNIT = 64.0  # of a datum [m]
NEAR = 128.0  # a map's middle may be so far from the datum that its file names [m]


class MapFile(NamedTuple):
    """A map as read: `terrain` counts from `datum` (x, y, z) in W [m], float64."""

    terrain: HeightMap
    datum: np.ndarray


def load_map(path: str | Path) -> MapFile:
    """Read a map; `origin_xy` is the centre of cell [0, 0], (0, 0) when left out.

    Raises `InputError`, one sentence that names file, key and value, for anything but finite or unseen elevations on a grid.
    """
    arrays = read_npz(path, LAYOUTS, "a map has elevation, resolution and origin_xy")
    named = "datum" in arrays
    arrays = {"origin_xy": np.zeros(2), "datum": np.zeros(3)} | arrays
    median = check_map(path, arrays)
    middle = arrays["origin_xy"] + 0.5 * arrays["resolution"] * (np.array(arrays["elevation"].shape) - 1)
    shift = _shift(np.array([*middle, median]), named)
    datum, origin = arrays["datum"] + shift, arrays["origin_xy"] - shift[:2]
    return MapFile(to_terrain(arrays["elevation"] - shift[2], origin, arrays["resolution"]), datum)


def to_terrain(elevation: np.ndarray, origin: np.ndarray, resolution: np.ndarray) -> HeightMap:
    """The map of arrays in float64, in JAX's own precision."""
    return HeightMap(*(jnp.asarray(x, float) for x in (elevation, origin, resolution)))


def save_map(file: MapFile, path: str | Path) -> None:
    """Write a map that `load_map` reads back equal. Raises `InputError` where nothing can be written."""
    write_npz(path, map_arrays(*file))


def map_arrays(terrain: HeightMap, datum: np.ndarray) -> dict[str, np.ndarray]:
    """A map as the arrays of a file."""
    arrays = {"elevation": terrain.elevation, "resolution": terrain.resolution, "origin_xy": terrain.origin, "datum": datum}
    return {key: np.asarray(value) for key, value in arrays.items()}


def check_map(path: str | Path, arrays: Mapping[str, np.ndarray]) -> float:
    """The median height [m] of a map's arrays. Raises `InputError` for what no ground is."""
    elevation, resolution = arrays["elevation"], float(arrays["resolution"])
    if min(elevation.shape) < LEAST:
        raise InputError(f"{path}: elevation has {_size(elevation)} cells, but must have at least {LEAST} x {LEAST}")
    if not RESOLUTIONS[0] <= resolution <= RESOLUTIONS[1]:
        raise InputError(f"{path}: resolution is {resolution:g} m, but must be from {RESOLUTIONS[0]:g} to {RESOLUTIONS[1]:g}")
    for key in ("origin_xy", "datum"):
        if not np.all(abs(arrays[key]) <= FARTHEST):
            raise InputError(f"{path}: {key} is {arrays[key].tolist()}, but must be finite, at most {FARTHEST:g} m from 0")
    return _check_heights(path, elevation, resolution * float(np.hypot(*elevation.shape)))


def _check_heights(path: str | Path, elevation: np.ndarray, diagonal: float) -> float:
    """The median of the heights seen; `diagonal` of the map [m]."""
    seen = elevation[~np.isnan(elevation)]
    if not len(seen):
        raise InputError(f"{path}: elevation is NaN in all {_size(elevation)} cells, but some must have been seen")
    if np.isinf(seen).any():
        raise InputError(f"{path}: elevation is infinite in {np.isinf(seen).sum()} cells; unseen ones must be NaN")
    seen.sort()
    low, high = float(seen[0]), float(seen[-1])
    worst = high if high > -low else low
    if abs(worst) > HIGHEST:
        cells = np.sum(seen == worst)
        raise InputError(f"{path}: elevation is {worst:g} m in {cells} cells, which is no height; unseen ones must be NaN")
    if low == high == NO_DATA:
        raise InputError(f"{path}: elevation is {low:g} m in all cells seen; unseen ones must be NaN")
    steps = np.diff(seen)
    at = int(np.argmax(steps))
    if steps[at] > CLIFF or high - low > max(STEEPEST * diagonal, LEAST_RELIEF):
        raise InputError(f"{path}: {_apart(seen[: at + 1], seen[at + 1 :])}; unseen cells must be NaN")
    return float(seen[len(seen) // 2])


def _apart(low: np.ndarray, high: np.ndarray) -> str:
    """What is wrong with heights, sorted, in two groups far apart: the group that looks most like one value is named."""
    odd, other = sorted((low, high), key=lambda part: (np.ptp(part), len(part)))
    value, next_to = (odd[-1], other[0]) if odd is low else (odd[0], other[-1])
    return f"elevation is {value:g} m in {len(odd)} cells and nowhere between that and {next_to:g} m, as no ground is"


def _shift(middle: np.ndarray, named: bool) -> np.ndarray:
    """From a map's middle and median height (x, y, z) [m], how far its datum moves."""
    return np.where(named & (abs(middle) <= NEAR), 0.0, UNIT * np.round(middle / UNIT))


def _size(elevation: np.ndarray) -> str:
    return " x ".join(map(str, elevation.shape))
