"""The one idiom for records of numbers with a structure: frozen dataclasses that are pytrees."""

import dataclasses
from typing import Any, TypeVar, dataclass_transform, no_type_check

import jax

T = TypeVar("T")


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def pytree(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass whose fields are leaves or subtrees, but for those declared by `static`.

    Its fields are not checked when it is built: `tree.map` and `vmap` rebuild it with whatever leaves.
    """
    return no_type_check(jax.tree_util.register_dataclass(dataclasses.dataclass(frozen=True)(cls)))


def static(default: Any = dataclasses.MISSING) -> Any:
    """A field that is structure: it takes part in compilation, not in arithmetic."""
    return dataclasses.field(default=default, metadata={"static": True})
