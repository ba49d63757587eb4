"""Traced programs kept from process to process: a later one neither traces nor lowers them again, which takes it longer than
fetching what XLA compiled of them.

A program is kept under a name that tells its function from all others, the package's sources, the versions of what it is made
with, and the structure and types of its arguments. What these do not tell, such as a planner's part written elsewhere, is
traced as ever.
"""

import contextlib
import dataclasses
import functools
import hashlib
import io
import pickle
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from jaxleg.about import about
from jaxleg.conventions import InputError
from jaxleg.files import replace_whole

PACKAGE = Path(__file__).parent
OWN = {PACKAGE.name, "builtins", "collections", "numpy"}  # where what a program is made of may come from


class Kept(NamedTuple):
    """Where a function's programs are kept, and what tells it from all others of the same sources."""

    folder: Path
    name: str


def of_method(thing: Any, name: str) -> Kept | None:
    """Where a program of a dataclass's method is kept, in the folder that is its `programs`; None if it has none.

    What the thing holds is in the program, so it is in the name. A thing of a class from elsewhere, or one that holds such,
    has none: what that computes is not in the package's sources.
    """
    if thing.programs is None:
        return None
    held = {field.name: getattr(thing, field.name) for field in dataclasses.fields(thing) if field.name != "programs"}
    text = _told((type(thing), held))
    return None if text is None else Kept(thing.programs, f"{name} {text}")


def kept(function: Callable[..., Any], where: Kept, shardings: tuple[Any, ...], out: Any) -> Callable[..., Any]:
    """A compiled function (of arrays in trees, none of them static) whose programs are kept; `shardings` of its arguments, one
    for each, and that of what comes `out`. It has no gradient."""
    programs: dict[Any, Callable[..., Any]] = {}

    def call(*arguments: Any) -> Any:
        """The function, by the program for arguments of this structure, these shapes and types."""
        leaves, tree = jax.tree.flatten(arguments)
        shapes = tuple((x.shape, str(jax.dtypes.canonicalize_dtype(x.dtype))) for x in leaves)
        if (tree, shapes) not in programs:
            text = _told((_structure(tree), shapes))
            wanted = jax.tree.leaves(jax.tree.map(lambda s, part: jax.tree.map(lambda _: s, part), shardings, arguments))
            programs[tree, shapes] = function if text is None else made(text, tree, wanted, leaves)
        return programs[tree, shapes](*arguments)

    def made(text: str, tree, wanted, leaves) -> Callable[..., Any]:
        file = where.folder / f"{_digest(where.name, text)}.program"
        traced, outputs = _read(file) or _write(file, function, tree, wanted, leaves)
        run, structure = jax.jit(traced.call, in_shardings=wanted, out_shardings=out), jax.tree.structure(outputs)
        return lambda *arguments: jax.tree.unflatten(structure, run(*jax.tree.leaves(arguments)))

    return call


class _Own(pickle.Pickler):
    """Writes what is the package's own, arrays as NumPy's."""

    def reducer_override(self, obj: Any) -> Any:
        """Raises `PicklingError` for what is from elsewhere."""
        if isinstance(obj, jax.Array):
            return np.asarray(obj).__reduce__()
        if (obj if isinstance(obj, type | FunctionType) else type(obj)).__module__.partition(".")[0] not in OWN:
            raise pickle.PicklingError(f"{obj} is from elsewhere")
        return NotImplemented


def _told(thing: Any) -> str | None:
    """What tells a thing from others, None for one that is from elsewhere or holds such."""
    text = io.BytesIO()
    pickler = _Own(text)
    pickler.fast = True  # alike whichever parts of it are one object
    try:
        pickler.dump(thing)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    return hashlib.sha256(text.getvalue()).hexdigest()


def _structure(tree: Any) -> Any:
    """A tree's structure in lists: type, what is static and the children of each node."""
    data = tree.node_data()
    return data and [*data, [_structure(child) for child in tree.children()]]


def _write(file: Path, function, tree, shardings: list[Any], leaves: list[Any]) -> tuple[export.Exported, Any]:
    """Trace the function of leaves and keep it, and what it returns: a tree of numbers, that a function of leaves cannot."""
    outputs = []

    def of_leaves(*leaves):
        found, structure = jax.tree.flatten(function(*jax.tree.unflatten(tree, leaves)))
        outputs.append(jax.tree.unflatten(structure, range(len(found))))
        return found

    traced = export.export(jax.jit(of_leaves, in_shardings=shardings))(*leaves)
    data = pickle.dumps((outputs[-1], bytes(traced.serialize())))
    with contextlib.suppress(InputError):  # a full disk is no reason to stop
        replace_whole(file, lambda part: part.write_bytes(data))
    return traced, outputs[-1]


def _read(file: Path) -> tuple[export.Exported, Any] | None:
    """What `_write` wrote, or None where there is nothing, or nothing whole."""
    try:
        outputs, data = pickle.loads(file.read_bytes())
        return export.deserialize(bytearray(data)), outputs
    except Exception:  # a file that is cut off fails in any way; it is written anew
        return None


def _digest(*texts: str) -> str:
    """Of these texts, the sources, the versions and how JAX is set."""
    square = jnp.zeros((2, 2))
    settings = str(jax.make_jaxpr(jnp.matmul)(square, square))  # shows precision and width
    every = (*texts, _sources(), settings, str(about()))
    return hashlib.sha256("\0".join(every).encode()).hexdigest()


@functools.cache
def _sources() -> str:
    """Of all sources of the package."""
    found = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        found.update(file.read_bytes())
    return found.hexdigest()
