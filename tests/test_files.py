"""Files are replaced whole or not at all: a full disk, a failure half-way, names that cannot be written."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.files import check_writable, replace_whole, write_json
from jaxleg.npz import write_npz
from jaxleg.settings import write_whole

FULL = """
import resource, signal, sys
import numpy as np
from jaxleg.conventions import InputError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10000, 10000))
"""
TRY = """
{write}
try:
    write(sys.argv[1] + "/{name}/good")
except InputError as error:
    print(error)
"""
ROOT = Path(__file__).parents[1]
NOISE = "np.random.default_rng(0).normal(size=(100, 100))"
WRITERS = {
    "text": "from jaxleg.settings import write_whole\nwrite = lambda path: write_whole(path, 'x' * 20000)",
    "npz": f"from jaxleg.npz import write_npz\nwrite = lambda path: write_npz(path, {{'noise': {NOISE}}})",
    "map": f"""from jaxleg.terrain.files import MapFile, save_map
from jaxleg.terrain.heightmap import HeightMap
write = lambda path: save_map(MapFile(HeightMap({NOISE}, np.zeros(2), np.array(0.04)), np.zeros(3)), path)""",
    "plan": f"""from jaxleg.robot import load_robot
from tests.plans import save_standing
robot = load_robot("configs/robots/pegasus.toml")
write = lambda path: save_standing(path, robot, {NOISE})""",
}


@pytest.fixture(scope="module")
def full_disk(tmp_path_factory):
    """A folder a writer, after one process has tried them all, and what it said."""
    folder = tmp_path_factory.mktemp("full")
    for name in WRITERS:
        (folder / name).mkdir()
        (folder / name / "good").write_text("the earlier one")
    code = FULL + "".join(TRY.format(write=write, name=name) for name, write in WRITERS.items())
    return folder, subprocess.run(
        [sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=False, cwd=ROOT
    )


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_earlier_file(full_disk, name):
    """A limit on the size of files stands for the full disk: writing fails half-way in the same place."""
    folder, done = full_disk
    path = folder / name / "good"
    said = dict(zip(WRITERS, done.stdout.splitlines(), strict=True))
    assert said[name] == f"{path}: cannot be written: File too large", done.stderr
    assert path.read_text() == "the earlier one"
    assert os.listdir(folder / name) == ["good"]


def test_a_failure_half_way_leaves_the_earlier_file_and_nothing_else(tmp_path):
    path = tmp_path / "good"
    path.write_text("the earlier one")

    def fail(part):
        part.write_text("half of")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replace_whole(path, fail)
    assert path.read_text() == "the earlier one"
    assert os.listdir(tmp_path) == ["good"]


def test_who_has_the_earlier_file_open_goes_on_reading_it(tmp_path):
    """As it would be were the process killed while it writes."""
    path = tmp_path / "good"
    path.write_text("the earlier one")
    with path.open() as earlier:
        write_whole(path, "the new one")
        assert earlier.read() == "the earlier one"
    assert path.read_text() == "the new one"


def test_the_path_is_the_one_given_and_its_folder_is_made(tmp_path):
    write_npz(tmp_path / "new" / "folder" / "plan", {"a": np.arange(3)})
    with np.load(tmp_path / "new" / "folder" / "plan") as file:
        np.testing.assert_array_equal(file["a"], np.arange(3))
    assert zipfile.ZipFile(tmp_path / "new/folder/plan").testzip() is None


def test_a_link_goes_on_pointing_to_what_is_replaced(tmp_path):
    (tmp_path / "real").write_text("one")
    (tmp_path / "link").symlink_to("real")
    write_whole(tmp_path / "link", "two")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "two"


def test_what_is_no_place_for_a_file_is_refused_beforehand_too(tmp_path):
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "pipe")
    places = {
        tmp_path: "it is a folder",
        tmp_path / "pipe": "it is a device or a pipe",
        "/dev/null": "it is a device or a pipe",
        tmp_path / "file" / "a": "Not a directory",
        tmp_path / "file" / "a" / "b": "Not a directory",
        tmp_path / ("a" * 300): "File name too long",
        tmp_path / "a\0b": "null character",
    }
    for path, words in places.items():
        for act in (check_writable, lambda path: write_whole(path, "text")):
            with pytest.raises(InputError, match="cannot be written") as caught:
                act(path)
            assert words in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == ["file", "pipe"]


def test_a_check_beforehand_leaves_a_file_as_it_was(tmp_path):
    (tmp_path / "good").write_text("as it was")
    check_writable(tmp_path / "good")
    check_writable(tmp_path / "new" / "one")
    assert (tmp_path / "good").read_text() == "as it was"
    assert os.listdir(tmp_path / "new") == []


def test_json_holds_null_for_what_is_not_finite(tmp_path):
    nan = float("nan")
    value = {
        "a": [nan, 1.0],
        "b": (np.float32(np.inf), 2),
        "c": {"d": np.array([[-np.inf, 3.0]])},
        "e": jnp.array(nan),
        "f": True,
    }
    write_json(tmp_path / "new" / "a.json", value)

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    read = json.loads((tmp_path / "new" / "a.json").read_text(), parse_constant=refuse)
    assert read == {"a": [None, 1.0], "b": [None, 2], "c": {"d": [[None, 3.0]]}, "e": None, "f": True}
