"""Settings: TOML files and command lines as nested frozen dataclasses, checked field by field.

A field's annotation says which TOML value it takes, `setting` what is allowed:

    starts: int = setting(8, min=1, help="random starts of the descent")
    span: tuple[float, float] = setting(above=0.0, unit="m")  # no default: must be given

Annotations: `int`, `float`, `bool`, `str`, `Literal` of strings, `tuple` (a TOML list), a dataclass (table),
`dict[str, X]` (a table with free names, dotted ones too) and `X | None`, whose default is None because TOML has no null. The
limits of a tuple or a dict hold for each number in it.
"""

import copy
import dataclasses
import difflib
import functools
import json
import operator
import sys
import tomllib
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar

import tomli_w

from jaxleg.conventions import InputError
from jaxleg.files import open_file, refusal, replace_whole

T = TypeVar("T")
_TYPES = {float: (int, float), int: int, bool: bool, str: str}  # what may stand for each
LONGEST = 1_000_000  # file [characters]
SINGLE = (1e-37, 1e37)  # magnitudes that JAX's usual precision holds
_NOUNS = {float: "a number", int: "an integer", bool: "true or false", str: "a text"}
_LIMITS = {
    "min": ("at least", operator.ge),
    "max": ("at most", operator.le),
    "above": ("above", operator.gt),
    "below": ("below", operator.lt),
    "choices": ("one of", lambda value, choices: value in choices),
}


def setting(
    default: Any = dataclasses.MISSING,
    *,
    min: int | float | None = None,
    max: int | float | None = None,
    above: int | float | None = None,
    below: int | float | None = None,
    choices: Sequence[Any] | None = None,
    unit: str | None = None,
    help: str = "",
) -> Any:
    """A dataclass field with its limits, unit and help in the metadata; required if it has no default."""
    rule = {"min": min, "max": max, "above": above, "below": below, "choices": choices, "unit": unit}
    metadata = {**rule, "help": _describe(help, rule).lstrip(", ") or None}  # tyro prints "help"
    if type(default).__hash__ is None:  # mutable: a copy for each instance
        return dataclasses.field(default_factory=functools.partial(copy.deepcopy, default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def load(cls: type[T], path: str | Path) -> T:
    """Read a `cls` from a TOML file. Raises `InputError` if it cannot be read, is not TOML, or as `build`."""
    with refusal(path, "read"), open_file(path) as file:
        text = file.read(LONGEST + 1).decode("utf-8-sig")  # an editor's byte order mark is no part of it
    if len(text) > LONGEST:
        raise InputError(f"{path}: cannot be read: it is longer than {LONGEST} characters")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        words = str(error).replace("end of document", f"the end, line {len(text.splitlines())}")
        raise InputError(f"{path}: is not valid TOML: {words}") from error
    return build(cls, table, str(path))


def build(cls: type[T], table: dict[str, Any], source: str) -> T:
    """Make a `cls` from a table as `tomllib` reads it; `source` begins the sentence of an error.

    Raises `InputError` for an unknown or missing key, and for a value of the wrong type or out of its limits.
    """
    return _Place(source, "", cls, {}).table(table)


def check(instance: T, source: str) -> T:
    """The same instance, made again by `build`. Raises `InputError` if a value is not allowed."""
    return build(type(instance), to_table(instance), source)


def convert(kind: Any, value: Any, source: str, key: str, rule: Mapping[str, Any]) -> Any:
    """One value of a kind by the rule of a `setting`. Raises `InputError` for the wrong type or beyond its limits."""
    return _Place(source, "", None, {}).at(key, kind, rule).convert(value)


def dotted(table: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a table of tables by their dotted names."""
    flat = dict(table)
    while any(isinstance(value, Mapping) for value in flat.values()):  # level by level: no table is too deep
        flat = {name: value for pair in flat.items() for name, value in _opened(*pair)}
    return flat


def _opened(name: str, value: Any) -> list[tuple[str, Any]]:
    return [(f"{name}.{key}", inner) for key, inner in value.items()] if isinstance(value, Mapping) else [(name, value)]


def from_command_line(cls: type[T], default_instance: T, args: Sequence[str], prog: str) -> T:
    """`default_instance` with the overrides in `args`, such as `--search.starts 8`.

    Raises `InputError` for a value that is not allowed, and `SystemExit` from tyro: 2, after a message on
    stderr, for a flag it cannot parse or does not know or a `__post_init__` that refuses; 0 after `--help`.
    """
    import tyro  # 0.3 s, which reading a file need not pay

    config = (tyro.conf.AvoidSubcommands,)
    instance = tyro.cli(cls, default=default_instance, args=list(args), prog=prog, config=config)
    return check(instance, "command line")


def to_table(instance: Any) -> dict[str, Any]:
    """The dataclass as the table that `build` takes; what is None is left out."""
    return dataclasses.asdict(instance, dict_factory=lambda items: {k: v for k, v in items if v is not None})


def dump(instance: Any, path: str | Path) -> None:
    """Write the dataclass as TOML that `load` reads back equal. Raises `InputError` as `write_whole`."""
    write_whole(path, written(instance))


def written(instance: Any) -> str:
    """The dataclass as TOML."""
    return tomli_w.dumps(to_table(instance))


def write_whole(path: str | Path, text: str) -> None:
    """Write a text so that a kill leaves the earlier file or the new one. Raises `InputError` as `replace_whole`."""
    replace_whole(path, lambda part: part.write_text(text, encoding="utf-8"))


@dataclasses.dataclass(frozen=True)
class _Place:
    """A dotted key of a source, with the type and the limits of the value there."""

    source: str
    key: str
    kind: Any
    rule: Mapping[str, Any]

    def at(self, name: str, kind: Any, rule: Mapping[str, Any]) -> "_Place":
        if typing.get_origin(kind) in (typing.Union, types.UnionType):
            kind = next(part for part in typing.get_args(kind) if part is not type(None))
        if typing.get_origin(kind) is Literal:
            kind, rule = str, {**rule, "choices": typing.get_args(kind)}
        return _Place(self.source, f"{self.key}.{name}".lstrip(".").replace(".[", "["), kind, rule)

    def error(self, words: str) -> InputError:
        return InputError(f"{self.source}: {_shortened(self.key, 200)} {words}")

    def require(self, holds: bool, value: Any) -> None:
        if not holds:
            raise self.error(f"is {_show(value)}, but must be {self.allowed()}")

    def convert(self, value: Any) -> Any:
        if dataclasses.is_dataclass(self.kind):
            return self.table(value)
        special = {tuple: self.entries, dict: self.named}
        return special.get(typing.get_origin(self.kind), self.scalar)(value)

    def table(self, value: Any) -> Any:
        """A dataclass from a table; raises `InputError` for a key that is unknown or missing."""
        self.require(isinstance(value, dict), value)
        places = {name: self.at(name, kind, field.metadata) for name, (field, kind) in _fields(self.kind).items()}
        for name in value:
            if name not in places:
                raise self.unknown(name, value[name], places)
        for name, (field, _) in _fields(self.kind).items():
            if name not in value and field.default is field.default_factory:  # both are MISSING
                raise places[name].error(f"is missing; it must be {places[name].allowed()}")
        values = {name: places[name].convert(entry) for name, entry in value.items()}
        try:
            return self.kind(**values)
        except ValueError as error:  # from the dataclass's __post_init__
            raise InputError(": ".join(filter(None, (self.source, self.key, str(error))))) from error

    def unknown(self, name: str, value: Any, places: Mapping[str, "_Place"]) -> InputError:
        near = [places[match].key for match in difflib.get_close_matches(name, places, n=1)]
        hint = f"did you mean {near[0]}?" if near else f"allowed here: {', '.join(places)}"
        return self.at(name, None, {}).error(f"= {_show(value)} is not a setting; {hint}")

    def entries(self, value: Any) -> tuple[Any, ...]:
        kinds = typing.get_args(self.kind)
        open_ended = kinds[-1] is ...
        self.require(isinstance(value, (list, tuple)) and (open_ended or len(value) == len(kinds)), value)
        pairs = enumerate(zip(kinds[:1] * len(value) if open_ended else kinds, value))
        return tuple(self.at(f"[{i}]", kind, self.rule).convert(entry) for i, (kind, entry) in pairs)

    def named(self, value: Any) -> dict[str, Any]:
        self.require(isinstance(value, dict), value)
        kind = typing.get_args(self.kind)[1]
        value = value if dataclasses.is_dataclass(kind) else dotted(value)  # a.b = 1 names the same as "a.b" = 1
        return {name: self.at(name, kind, self.rule).convert(entry) for name, entry in value.items()}

    def scalar(self, value: Any) -> Any:
        """A number, flag or string within its limits; raises `InputError` for any other."""
        fits = isinstance(value, _TYPES[self.kind]) and isinstance(value, bool) is (self.kind is bool)
        # no NaN passes the comparison, nor an integer that float() refuses
        self.require(fits and (self.kind is str or abs(value) <= sys.float_info.max), value)
        self.require(all(test(value, limit) for _, test, limit in _limits(self.rule)), value)
        if self.kind is float and value and not SINGLE[0] <= abs(value) <= SINGLE[1]:
            raise self.error(f"is {_show(value)}, but single precision holds numbers from {SINGLE[0]} to {SINGLE[1]} only")
        return self.kind(value)

    def allowed(self) -> str:
        """What may stand here, in words."""
        origin, kinds = typing.get_origin(self.kind), typing.get_args(self.kind)
        if dataclasses.is_dataclass(self.kind):
            return f"a table with the keys {', '.join(_fields(self.kind))}"
        if origin is dict:
            return f"a table of names, each {self.at('', kinds[1], self.rule).allowed()}"
        if origin is tuple:
            each = dict.fromkeys(self.at("", kind, self.rule).allowed() for kind in kinds if kind is not ...)
            return f"a list{'' if kinds[-1] is ... else f' of {len(kinds)}'}, each {' or '.join(each)}"
        return _describe(_NOUNS[self.kind], self.rule)


@functools.cache
def _fields(cls: Any) -> dict[str, tuple[dataclasses.Field, Any]]:
    """Field and annotation by name."""
    hints = typing.get_type_hints(cls)
    return {field.name: (field, hints[field.name]) for field in dataclasses.fields(cls)}


def _limits(rule: Mapping[str, Any]) -> list[tuple[str, Callable[[Any, Any], bool], Any]]:
    return [(*_LIMITS[name], rule[name]) for name in _LIMITS if rule.get(name) is not None]


def _describe(words: str, rule: Mapping[str, Any]) -> str:
    unit = f"[{rule['unit']}]" if rule.get("unit") else ""
    return ", ".join([f"{words} {unit}".strip(), *(f"{is_} {_show(limit)}" for is_, _, limit in _limits(rule))])


def _show(value: Any) -> str:
    """The value about as TOML would have it, shortened."""
    try:
        text = repr(value) if isinstance(value, float) else json.dumps(value, default=str, ensure_ascii=False)
    except RecursionError:
        text = "a table in a table in a table ..."
    return _shortened(text, 60)


def _shortened(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."
