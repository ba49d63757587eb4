"""The command line: `jaxleg search`, `jaxleg plan`, `jaxleg replay`.

JAX is configured here (`start.configure_jax`) and nowhere else in the package.
"""

import importlib
import os
import sys

from jaxleg.cli.start import EXIT_INPUT, EXIT_INTERRUPTED, EXIT_PIPE, HELP, USAGE, configure_jax
from jaxleg.conventions import InputError

__all__ = ["configure_jax", "main"]
COMMANDS = ("search", "plan", "replay")


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the console script; exits with 0, 1 (nothing feasible), 2 (bad input), 130 (interrupted) or 141 (nobody
    reads on)."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    os.environ["MUJOCO_GL"] = "disable"  # nothing is rendered by MuJoCo; to load OpenGL may fail
    try:
        try:
            sys.exit(dispatch(arguments))
        finally:
            sys.stdout.flush()
    except InputError as error:
        print(f"jaxleg: {error}", file=sys.stderr)
        sys.exit(EXIT_INPUT)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it flushes
        sys.exit(EXIT_PIPE)


def dispatch(arguments: list[str]) -> int:
    """Run the command named first, a module beside this one. Raises `InputError` for what a user wrote that cannot be used."""
    help_asked = bool(HELP.intersection(arguments))
    if not arguments or help_asked:
        print(USAGE)
    if not arguments or arguments[0] in HELP:
        return 0 if arguments else EXIT_INPUT
    name, *rest = arguments
    if name not in COMMANDS:
        raise InputError(f"command line: {name!r} is not a command; there are: {', '.join(COMMANDS)}")
    if help_asked and name != "search":  # which goes on to show the keys of CONFIG
        return 0
    return getattr(importlib.import_module(f"jaxleg.cli.{name}"), name)(rest)
