"""Imports point one way, and nobody but the command line configures JAX."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "jaxleg"
ORDER = (
    ("about", "conventions", "files", "npz", "numerics", "pytree", "rotations", "settings", "status", "vectors"),
    ("batch", "programs"),
    ("robot",),
    ("leg",),
    ("terrain",),
    ("gait", "route"),
    ("swing",),
    ("foothold", "posture", "series"),
    ("planner",),
    ("walk",),
    ("control",),
    ("sim",),
    ("search",),
    ("viz",),
    ("cli",),
)
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
FILES = sorted(path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py")


def room(parts: tuple[str, ...]) -> str:
    return parts[0].removesuffix(".py")


def imported(tree: ast.AST) -> set[str]:
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    modules |= {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    return {module.split(".")[1] for module in modules if module.startswith("jaxleg.")}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path):
    here = room(path.relative_to(ROOT).parts)
    for other in imported(ast.parse(path.read_text())):
        assert other == here or LEVEL[other] <= LEVEL[here]
        assert here in ("viz", "cli") or other != "viz"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_only_the_command_line_configures_jax(path):
    assert room(path.relative_to(ROOT).parts) == "cli" or "jax.config" not in path.read_text()
