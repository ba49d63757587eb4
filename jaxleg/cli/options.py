"""Options of a command that are not keys of its CONFIG."""

import os
from collections.abc import Mapping
from pathlib import Path

from jaxleg.conventions import InputError
from jaxleg.files import check_writable


def take(rest: list[str], name: str, count: int = 1) -> list[str] | None:
    """Take `--name` and its `count` values out of a command line, None where it is not given. Raises `InputError`."""
    flag = f"--{name}"
    if flag not in rest:
        return None
    at = rest.index(flag)
    values = rest[at + 1 : at + 1 + count]
    if len(values) < count or any(value.startswith("--") for value in values):
        raise InputError(f"command line: {flag} must be followed by {count} value{'s' if count > 1 else ''}")
    del rest[at : at + 1 + count]
    return values


def numbers(values: list[str], name: str) -> list[float]:
    """Finite numbers. Raises `InputError` naming the option and the value."""
    try:
        found = [float(value) for value in values]
    except ValueError as error:
        raise InputError(f"command line: --{name} is {' '.join(values)}, but must be numbers") from error
    if not all(abs(x) < float("inf") for x in found):
        raise InputError(f"command line: --{name} is {' '.join(values)}, but must be finite")
    return found


def needed(value: list[str] | None, name: str, what: str) -> list[str]:
    """The value, or `InputError` that it is missing."""
    if value is None:
        raise InputError(f"command line: --{name} is missing; give {what}")
    return value


def first(rest: list[str], what: str) -> str:
    """Take what a command begins with. Raises `InputError` that `what` is missing."""
    if not rest or rest[0].startswith("-"):
        raise InputError(f"command line: {what}")
    return rest.pop(0)


def check_outputs(outputs: Mapping[str, Path | None], endings: Mapping[str, str]) -> None:
    """Raises `InputError` for outputs, by option, that end wrongly, would replace each other or could not be written.

    What is no option, as PLAN, is read.
    """
    paths = {name: path for name, path in outputs.items() if path}
    for name, ending in endings.items():
        if name in paths and paths[name].suffix.lower() != ending:
            raise InputError(f"command line: {name} is {paths[name]}, but must end in {ending}")
    if len({os.path.realpath(path) for path in paths.values()}) < len(paths):
        *others, last = paths
        alike = ", ".join(map(str, paths.values()))
        raise InputError(f"command line: {', '.join(others)} and {last} must be different files, not {alike}")
    for name in filter(lambda name: name.startswith("--"), paths):
        check_writable(paths[name])


def nothing_left(rest: list[str]) -> None:
    """Raises `InputError` for what nobody has taken."""
    if rest:
        raise InputError(f"command line: {' '.join(rest)} is not understood; see jaxleg --help")
