"""What `import jaxleg as jl` offers: each name is there, is what its module has, and costs nothing until it is asked for."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import jaxleg as jl

STUB = Path(jl.__file__).with_suffix(".pyi")
NAMES = {
    alias.name: f"jaxleg.{node.module}" for node in ast.parse(STUB.read_text()).body for alias in getattr(node, "names", [])
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_that_of_its_module(name):
    assert getattr(jl, name) is getattr(importlib.import_module(NAMES[name]), name)
    assert name in dir(jl)


def test_no_name_is_also_that_of_a_room():
    """Importing the room would put the module in its place."""
    rooms = {path.stem for path in Path(jl.__file__).parent.iterdir()}
    assert not rooms & set(NAMES)
    assert set(jl.__all__) == set(NAMES)


def test_the_door_alone_loads_neither_jax_nor_mujoco():
    code = "import sys, jaxleg; print(sorted({'jax', 'mujoco', 'numpy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
