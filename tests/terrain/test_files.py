"""Map files: what is read back is what was written, far from zero too, and what cannot serve is refused by name."""

from pathlib import Path

import jax
import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.terrain.files import load_map, save_map
from jaxleg.terrain.heightmap import height

SHARED = Path(__file__).parents[3] / "shared" / "data"
GOOD = {"elevation": np.zeros((5, 6)), "resolution": 0.04, "origin_xy": np.array([1.0, 2.0])}


def ground(cells=(7, 5)):
    elevation = np.random.default_rng(0).normal(size=cells)
    elevation[2, 3] = np.nan
    return elevation


def saved(path, **changes):
    np.savez(path, **{key: value for key, value in (GOOD | changes).items() if value is not None})
    return path


def test_a_map_comes_back_as_it_was(tmp_path):
    first = load_map(saved(tmp_path / "one.npz", elevation=ground(), origin_xy=np.array([1.0, -2.0])))
    save_map(first, tmp_path / "two.npz")
    for terrain, datum in (first, load_map(tmp_path / "two.npz")):
        np.testing.assert_array_equal(terrain.elevation, ground())
        np.testing.assert_array_equal(terrain.origin, [1.0, -2.0])
        assert terrain.resolution == 0.04
        assert datum.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("x64", [False, True])
def test_a_map_in_utm_4_km_up_keeps_its_millimetres(tmp_path, x64):
    """The datum by hand: 388096 = 6064 * 64, 3948996 = 61703.06 * 64, 4012 = 62.7 * 64; heights to a tenth of a millimetre."""
    elevation = 4012.0 + ground()
    origin = np.array([388096.0, 3948996.0])
    path = saved(tmp_path / "one.npz", elevation=elevation, origin_xy=origin)
    with jax.enable_x64(x64):
        terrain, datum = load_map(path)
        assert datum.dtype == np.float64
        assert datum.tolist() == [388096.0, 3948992.0, 4032.0]
        np.testing.assert_allclose(terrain.elevation, ground() - 20.0, atol=1e-6)
        np.testing.assert_allclose(terrain.origin, [0.0, 4.0], atol=1e-9)
        dtype = terrain.elevation.dtype
        seen = jax.jit(height)(terrain, np.array([0.2, 4.04], dtype))
        near = load_map(saved(tmp_path / "near.npz", elevation=ground(), origin_xy=None)).terrain
        there = jax.jit(height)(near, np.array([0.2, 0.04], dtype))
        np.testing.assert_allclose(np.asarray(seen) + 20.0, there, atol=1e-5)


def test_the_datum_is_the_one_nearest_to_a_maps_middle(tmp_path):
    """By hand: 100 x 60 cells of 1 m from (960, 960) on have their middle at 1009.5 = 15.8 * 64 and 989.5 = 15.5 * 64."""
    path = saved(tmp_path / "one.npz", elevation=np.zeros((100, 60)), resolution=1.0, origin_xy=np.full(2, 960.0))
    assert load_map(path).datum.tolist() == [1024.0, 960.0, 0.0]


@pytest.mark.parametrize("x64", [False, True])
@pytest.mark.parametrize("middle", [0.0, 31.99, 32.0, 96.0, 160.0, 388096.0])
def test_far_maps_are_read_back_equal_wherever_their_middle_is(tmp_path, x64, middle):
    """Also half-way between two datums, where float32 rounds the middle to either side."""
    resolution, half = 0.04, 0.04 * 3
    elevation = min(middle, 160.0) + ground((7, 7)) - np.nanmedian(ground((7, 7)))
    path = saved(tmp_path / "one.npz", elevation=elevation, resolution=resolution, origin_xy=np.full(2, middle - half))
    with jax.enable_x64(x64):
        first = load_map(path)
        save_map(first, tmp_path / "two.npz")
        again = load_map(tmp_path / "two.npz")
    np.testing.assert_array_equal(again.datum, first.datum)
    jax.tree.map(np.testing.assert_array_equal, again.terrain, first.terrain)
    assert np.abs(first.terrain.origin).max() <= 33.0


def test_a_datum_in_the_file_is_what_its_numbers_count_from(tmp_path):
    terrain, datum = load_map(saved(tmp_path / "a.npz", datum=np.array([640.0, -1e6, 100.5])))
    assert datum.tolist() == [640.0, -1e6, 100.5]
    np.testing.assert_array_equal(terrain.origin, [1.0, 2.0])
    far = load_map(saved(tmp_path / "b.npz", datum=np.array([0.5, 0.0, 0.0]), origin_xy=np.array([6400.0, 2.0])))
    assert far.datum.tolist() == [6400.5, 0.0, 0.0]
    np.testing.assert_allclose(far.terrain.origin, [0.0, 2.0])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"elevation": np.full((5, 6), np.nan)}, ["elevation", "NaN", "5 x 6"]),
        ({"elevation": np.full((5, 6), -9999.0)}, ["elevation is -9999 m in all cells", "NaN"]),
        ({"elevation": np.full((5, 6), np.inf)}, ["elevation", "infinite", "30"]),
        ({"elevation": np.zeros((3, 6))}, ["elevation", "3 x 6", "4 x 4"]),
        ({"elevation": np.zeros((0, 6))}, ["elevation", "0 x 6", "4 x 4"]),
        ({"elevation": np.zeros(6)}, ["elevation", "(6,)", "2 dimensions"]),
        ({"elevation": np.array([["a"] * 5] * 5)}, ["elevation", "numbers"]),
        ({"elevation": np.zeros((5, 6), bool)}, ["elevation", "bool", "numbers"]),
        ({"elevation": np.zeros((5, 6), "m8[s]")}, ["elevation", "timedelta64", "numbers"]),
        ({"elevation": np.zeros((5, 6), "M8[s]")}, ["elevation", "datetime64", "numbers"]),
        ({"elevation": np.zeros((5, 6), complex)}, ["elevation", "complex", "numbers"]),
        ({"elevation": np.zeros((5, 6), object)}, ["elevation", "object", "numbers"]),
        ({"elevation": np.zeros((5, 6), [("z", float)])}, ["elevation", "('z', '<f8')", "numbers"]),
        ({"elevation": np.zeros((5, 6), "V8")}, ["elevation", "V8", "numbers"]),
        ({"resolution": 0.0}, ["resolution", "0 m"]),
        ({"resolution": np.nan}, ["resolution", "nan"]),
        ({"resolution": 40.0}, ["resolution", "40"]),
        ({"resolution": np.ones(1)}, ["resolution", "(1,)", "0 dimensions"]),
        ({"resolution": None}, ["resolution is missing"]),
        ({"origin_xy": np.array([np.nan, 0.0])}, ["origin_xy", "nan"]),
        ({"origin_xy": np.array([1e12, 0.0])}, ["origin_xy", "1000000000000.0", "1e+08"]),
        ({"origin_xy": np.zeros(3)}, ["origin_xy", "(3,)", "(2)"]),
        ({"datum": np.array([0.0, 0.0, np.inf])}, ["datum", "inf"]),
        ({"datum": np.zeros(2)}, ["datum", "(2,)", "(3)"]),
    ],
)
def test_what_cannot_serve_is_refused_by_name(tmp_path, changes, words):
    with pytest.raises(InputError) as error:
        load_map(saved(tmp_path / "bad.npz", **changes))
    for word in ["bad.npz", *words]:
        assert word in str(error.value)


LEVELS = (0.0, -400.0, 4000.0, 8848.0)
CODES = (-9999.0, -32768.0, -32767.0, 9999.0, 32767.0, 1e30, 1e20, np.finfo(np.float32).min)
IMPLAUSIBLE = [(c, h) for c in CODES for h in LEVELS if abs(c - h) > 1500.0]  # 9999 m may be a height beside 8848 m


@pytest.mark.parametrize(("code", "level"), IMPLAUSIBLE)
@pytest.mark.parametrize("resolution", [0.04, 1.0, 10.0])
def test_codes_for_no_data_are_refused_with_their_number_of_cells(tmp_path, level, resolution, code):
    elevation = level + np.random.default_rng(1).normal(size=(20, 30))
    elevation[3:6, 4:9] = code
    with pytest.raises(InputError) as error:
        load_map(saved(tmp_path / "bad.npz", elevation=elevation, resolution=resolution))
    ground = elevation[elevation != code]
    nearest = ground.max() if code > level else ground.min()
    gap = f"nowhere between that and {nearest:g} m" if abs(code) < 3e4 else "which is no height"
    for word in ("bad.npz", f"elevation is {code:g} m in 15 cells", gap, "unseen", "must be NaN"):
        assert word in str(error.value)


@pytest.mark.parametrize(("code", "level"), [(-999.0, 0.0), (-99.0, 0.0), (0.0, 4000.0), (999.0, -30.0)])
def test_small_codes_are_refused_on_maps_of_a_robots_size(tmp_path, code, level):
    """Though most cells hold the code."""
    elevation = np.full((40, 40), code)
    elevation[:5] = level + np.random.default_rng(1).normal(size=(5, 40))
    with pytest.raises(InputError, match=f"elevation is {code:g} m in 1400 cells"):
        load_map(saved(tmp_path / "bad.npz", elevation=elevation))


def mountain(cells, resolution, slope):
    x = resolution * np.arange(cells)
    return slope * x[:, None] + np.sin(x) * np.ones((cells, cells))


@pytest.mark.parametrize(
    ("elevation", "resolution"),
    [
        (np.where(np.arange(50) < 25, 0.0, 45.0) * np.ones((50, 1)), 0.04),  # from the roof of a house
        (np.where(np.arange(50) < 25, 3000.0, 4250.0) * np.ones((50, 1)), 5.0),  # Mount Thor, the highest sheer face
        (mountain(60, 0.04, 3.0) - 430.0, 0.04),  # the shore of the Dead Sea
        (mountain(60, 10.0, 3.0) + 7000.0, 10.0),
        (np.full((4, 4), 8848.9), 0.01),
        (np.full((4, 4), -10984.0), 0.01),
    ],
)
def test_real_ground_is_not_refused(tmp_path, elevation, resolution):
    terrain, datum = load_map(saved(tmp_path / "good.npz", elevation=elevation, resolution=resolution))
    np.testing.assert_allclose(np.asarray(terrain.elevation) + datum[2], elevation, atol=1e-6)


def test_a_real_elevation_model_is_not_refused(tmp_path):
    """SRTM heights that come with matplotlib, in the largest cells allowed."""
    from matplotlib.cbook import get_sample_data

    elevation = get_sample_data("jacksboro_fault_dem.npz")["elevation"]
    terrain, datum = load_map(saved(tmp_path / "good.npz", elevation=elevation, resolution=10.0))
    np.testing.assert_array_equal(np.asarray(terrain.elevation) + datum[2], elevation)


def test_a_file_that_is_no_map_is_refused(tmp_path):
    (tmp_path / "text.npz").write_text("no map")
    np.savez(tmp_path / "other.npz", heights=np.zeros((5, 5)))
    for name, word in (("nowhere.npz", "No such file"), ("text.npz", "cannot be read"), ("other.npz", "elevation is missing")):
        with pytest.raises(InputError, match=word):
            load_map(tmp_path / name)


@pytest.mark.slow  # no default test needs what a fresh clone has not
@pytest.mark.skipif(not SHARED.exists(), reason="no maps from elsewhere here")
def test_real_maps_are_read():
    for path in sorted(SHARED.glob("*.npz")):
        terrain, datum = load_map(path)
        assert np.isfinite(np.asarray(terrain.elevation)).mean() > 0.5
        assert not datum.any()
