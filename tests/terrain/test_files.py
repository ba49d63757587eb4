"""Map files: what is read back is what was written, and what cannot serve is refused by name."""

from pathlib import Path

import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.terrain.files import load_map, save_map

SHARED = Path(__file__).parents[3] / "shared" / "data"
GOOD = {"elevation": np.zeros((5, 6)), "resolution": 0.04, "origin_xy": np.array([1.0, 2.0])}


def test_a_map_comes_back_as_it_was(tmp_path):
    elevation = np.random.default_rng(0).normal(size=(7, 5))
    elevation[2, 3] = np.nan
    np.savez(tmp_path / "one.npz", elevation=elevation, resolution=0.04, origin_xy=np.array([1.0, -2.0]))
    terrain = load_map(tmp_path / "one.npz")
    save_map(terrain, tmp_path / "two.npz")
    again = load_map(tmp_path / "two.npz")
    for map_ in (terrain, again):
        np.testing.assert_array_equal(map_.elevation, elevation)
        np.testing.assert_array_equal(map_.origin, [1.0, -2.0])
        assert map_.resolution == 0.04


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"elevation": np.full((5, 6), np.nan)}, ["elevation", "NaN", "5 x 6"]),
        ({"elevation": np.full((5, 6), np.inf)}, ["elevation", "infinite", "30"]),
        ({"elevation": np.zeros((3, 6))}, ["elevation", "3 x 6", "4 x 4"]),
        ({"elevation": np.zeros(6)}, ["elevation", "(6,)"]),
        ({"elevation": np.array([["a"] * 5] * 5)}, ["elevation", "numbers"]),
        ({"resolution": 0.0}, ["resolution", "0 m"]),
        ({"resolution": np.nan}, ["resolution", "nan"]),
        ({"resolution": 40.0}, ["resolution", "40"]),
        ({"origin_xy": np.array([np.nan, 0.0])}, ["origin_xy", "nan"]),
        ({"origin_xy": np.zeros(3)}, ["origin_xy", "0.0"]),
    ],
)
def test_what_cannot_serve_is_refused_by_name(tmp_path, changes, words):
    np.savez(tmp_path / "bad.npz", **(GOOD | changes))
    with pytest.raises(InputError) as error:
        load_map(tmp_path / "bad.npz")
    for word in ["bad.npz", *words]:
        assert word in str(error.value)


def test_a_file_that_is_no_map_is_refused(tmp_path):
    (tmp_path / "text.npz").write_text("no map")
    np.savez(tmp_path / "other.npz", heights=np.zeros((5, 5)))
    for name, word in (("nowhere.npz", "No such file"), ("text.npz", "cannot be read"), ("other.npz", "elevation is missing")):
        with pytest.raises(InputError, match=word):
            load_map(tmp_path / name)


@pytest.mark.skipif(not SHARED.exists(), reason="no maps from elsewhere here")
def test_real_maps_are_read():
    for path in sorted(SHARED.glob("*.npz")):
        terrain = load_map(path)
        assert np.isfinite(np.asarray(terrain.elevation)).mean() > 0.5
