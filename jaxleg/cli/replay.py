"""`jaxleg replay PLAN --engine mjx or mujoco`: a plan in simulation."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from jaxleg.cli.options import nothing_left, take
from jaxleg.cli.start import EXIT_INFEASIBLE, USAGE, configure_jax
from jaxleg.conventions import InputError
from jaxleg.files import check_writable, write_json

FRAME, SPEED = 0.5, 4.0  # between the pictures of a video [s], and how many times as fast it runs


def replay(arguments: list[str]) -> int:
    """Simulate a plan and write `replay.json`. Exit status 1 where the robot falls or does not finish."""
    rest = list(arguments)
    if {"-h", "--help"} & set(rest):
        print(USAGE)
        return 0
    engine = (take(rest, "engine") or ["mjx"])[0]
    out, video = take(rest, "out"), take(rest, "video")
    if engine not in ("mjx", "mujoco"):
        raise InputError(f"command line: --engine is {engine}, but must be mjx or mujoco")
    if not rest or rest[0].startswith("-"):
        raise InputError("command line: PLAN is missing; give the file that `jaxleg plan` wrote")
    source = Path(rest.pop(0))
    nothing_left(rest)
    path, film = Path(out[0]) if out else source.parent / "replay.json", Path(video[0]) if video else None
    configure_jax()
    from rich.console import Console

    from jaxleg.sim.replay import replay_mjx, replay_mujoco
    from jaxleg.walk.plan_file import load_plan

    file = load_plan(source)
    check_outputs(source, path, film)
    with Console().status(f"simulating {float(file.reference.time[-1]):.0f} s"):
        result, frames = {"mjx": replay_mjx, "mujoco": replay_mujoco}[engine](file, FRAME)
    write_json(path, result | {"plan": str(source)})
    show(result)
    print(f"written: {path}")
    if film:
        from jaxleg.viz.animation import animate

        animate(film, file.terrain, frames, file.robot, FRAME, speed=SPEED, goal=file.goal)
        print(f"written: {film}")
    return 0 if result["finished"] else EXIT_INFEASIBLE


def check_outputs(source: Path, result: Path, film: Path | None) -> None:
    """Raises `InputError` for outputs that could not be written, or would replace the plan or each other."""
    if film and film.suffix.lower() != ".gif":
        raise InputError(f"command line: --video is {film}, but must end in .gif")
    paths = [source, result, *([film] if film else [])]
    if len({os.path.realpath(path) for path in paths}) < len(paths):
        raise InputError(f"command line: PLAN, --out and --video must be different files, not {', '.join(map(str, paths))}")
    for path in paths[1:]:
        check_writable(path)


def show(result: dict[str, Any]) -> None:
    """The result in a few lines."""
    energy = ", ".join(f"{name} {value:.0f}" for name, value in result["energy_per_metre"].items())
    ended = "fell" if result["fell"] else "walked" if result["finished"] else "did not finish:"
    print(f"{result['engine']}: {ended} {result['distance']:.2f} m in {result['time']:.1f} s")
    if np.isfinite(result["cost_of_transport"]):
        print(f"energy J/m: {energy}; cost of transport {result['cost_of_transport']:.2f} ({result['power']})")
    else:
        print("energy J/m: none, the walk went no way or is not finite")
    print(f"least stability margin {result['margin']:.3f} m, slip {result['slip']:.3f} m a foot")
    print(f"distance to the goal {result['left']:.3f} m")
    if np.isfinite(result.get("landing_worst", np.nan)):
        print(f"worst touch-down {1e3 * result['landing_worst']:.1f} mm from its foothold")
