"""The numbers of a planner by name, as "gait.workspace.high" or "posture.levelling": what a search may move."""

import dataclasses
import difflib
import operator
from collections.abc import Collection, Iterable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.conventions import InputError

Tree = TypeVar("Tree")


def leaf_names(tree: Any) -> list[str]:
    """Dotted names of all real numbers of a planner."""
    paths = jax.tree_util.tree_leaves_with_path(tree)
    return [".".join(str(key.name) for key in path) for path, leaf in paths if jnp.issubdtype(leaf.dtype, jnp.floating)]


def read_leaves(tree: Any, names: Sequence[str]) -> Float[Array, "leaf"]:
    """The numbers of these names. Raises `InputError`, which suggests the nearest name, for one that does not exist."""
    require_known(names, leaf_names(tree))
    return jnp.stack([operator.attrgetter(name)(tree) for name in names])


def require_known(names: Iterable[str], known: Collection[str]) -> None:
    """Raises `InputError`, which suggests the nearest name, for one that is not known."""
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(known)}"
            raise InputError(f"{name[:100]!r} names no number of the planner; {hint}")


def with_leaves(tree: Tree, names: Sequence[str], values: Float[Array, "leaf"]) -> Tree:
    """The planner with the numbers of these names replaced; differentiable in them."""
    for i, name in enumerate(names):
        tree = _put(tree, name.split("."), values[i])
    return tree


def _put(tree, path, value):
    if not path:
        return value
    part = {path[0]: _put(getattr(tree, path[0]), path[1:], value)}
    return tree._replace(**part) if isinstance(tree, tuple) else dataclasses.replace(tree, **part)
