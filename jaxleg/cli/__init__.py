"""The command line: `jaxleg search`, `jaxleg plan`, `jaxleg replay`.

JAX is configured here (`start.configure_jax`) and nowhere else in the package.
"""

import os
import sys

from jaxleg.cli.start import EXIT_INPUT, EXIT_INTERRUPTED, EXIT_PIPE, USAGE, configure_jax
from jaxleg.conventions import InputError

__all__ = ["configure_jax", "main"]


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
    """Run the command named first. Raises `InputError` for anything a user wrote that cannot be used."""
    if not arguments or arguments[0] in ("-h", "--help"):
        print(USAGE)
        return 0 if arguments else EXIT_INPUT
    if arguments[0] == "search":
        from jaxleg.cli.search import search

        return search(arguments[1:])
    if arguments[0] == "plan":
        from jaxleg.cli.plan import plan

        return plan(arguments[1:])
    if arguments[0] == "replay":
        from jaxleg.cli.replay import replay

        return replay(arguments[1:])
    raise InputError(f"command line: {arguments[0]!r} is not a command; there are: search, plan, replay")
