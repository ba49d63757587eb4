"""How the command line starts: whatever the environment holds, no traceback, no stray output."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from jaxleg.cli.start import cache_folder

ROOT = Path(__file__).parents[1]
NAMES = ("JAXLEG_CACHE", "JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME", "HOME")


def python(code: str, **environment: str) -> subprocess.CompletedProcess:
    """The code run by itself, in one device, with these variables."""
    variables = os.environ | {"JAX_PLATFORMS": "cpu"} | environment
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, env=variables, check=False)


@pytest.fixture
def environment(monkeypatch, tmp_path):
    """Sets the variables that name a cache, by folder under tmp_path; the others are not set."""

    def put(**folders):
        for name in NAMES:
            monkeypatch.delenv(name, raising=False)
        for name, folder in folders.items():
            monkeypatch.setenv(name, str(tmp_path / folder))

    return put


@pytest.mark.parametrize(
    ("folders", "wanted"),
    [
        (dict(JAXLEG_CACHE="a", JAX_COMPILATION_CACHE_DIR="b", XDG_CACHE_HOME="c", HOME="d"), "a"),
        (dict(JAX_COMPILATION_CACHE_DIR="b", XDG_CACHE_HOME="c", HOME="d"), "b"),
        (dict(XDG_CACHE_HOME="c", HOME="d"), "c/jaxleg"),
        (dict(HOME="d"), "d/.cache/jaxleg"),
    ],
)
def test_compiled_programs_are_kept_where_the_environment_says(environment, tmp_path, folders, wanted):
    environment(**folders)
    assert cache_folder() == tmp_path / wanted


def test_no_cache_where_none_can_be(environment, tmp_path, monkeypatch):
    environment(HOME="file")
    (tmp_path / "file").touch()
    assert cache_folder() is None
    environment()
    monkeypatch.setattr(Path, "home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))  # HOME unset, unknown user
    assert cache_folder() is None


def test_a_platform_that_is_not_there_is_one_sentence():
    code = "from jaxleg.cli import main; main(['search', 'configs/quickstart.toml', '--out', '/nowhere'])"
    seen = python(code, JAX_PLATFORMS="tpu")
    assert seen.returncode == 2
    assert seen.stderr.strip().count("\n") == 0
    assert seen.stderr.startswith("jaxleg: JAX_PLATFORMS is 'tpu'")


def test_a_reader_that_goes_away_is_no_error():
    command = f"{sys.executable} -m jaxleg.cli search --help | head -n 1"
    seen = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=ROOT, check=False)
    assert seen.stdout.count("\n") == 1
    assert seen.stderr == ""


def test_imports_print_nothing():
    seen = python("import jaxleg.sim.engine, jaxleg.search.study, jaxleg.viz.study")
    assert (seen.returncode, seen.stdout, seen.stderr) == (0, "", "")


def test_a_notebooks_back_end_does_not_reach_the_figures():
    code = "from jaxleg.cli.start import configure_jax; configure_jax(); import jaxleg.viz.study"
    assert python(code, MPLBACKEND="module://nowhere.backend").returncode == 0
