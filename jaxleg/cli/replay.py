"""`jaxleg replay PLAN --engine mjx or mujoco`: a plan in simulation."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxleg.cli.options import check_outputs, first, nothing_left, take
from jaxleg.cli.start import EXIT_INFEASIBLE, configure_jax
from jaxleg.conventions import InputError
from jaxleg.files import write_json

FRAME, SPEED = 0.5, 4.0  # between the pictures of a video [s], and how many times as fast it runs


def replay(arguments: list[str]) -> int:
    """Simulate a plan and write `replay.json`. Exit status 1 where the robot falls or does not finish."""
    rest = list(arguments)
    engine = (take(rest, "engine") or ["mjx"])[0]
    out, video = take(rest, "out"), take(rest, "video")
    if engine not in ("mjx", "mujoco"):
        raise InputError(f"command line: --engine is {engine}, but must be mjx or mujoco")
    source = Path(first(rest, "PLAN is missing; give the file that `jaxleg plan` wrote"))
    nothing_left(rest)
    path, film = Path(out[0]) if out else source.parent / "replay.json", Path(video[0]) if video else None
    configure_jax()
    from rich.console import Console

    from jaxleg.sim.replay import replay_mjx, replay_mujoco
    from jaxleg.walk.plan_file import load_plan

    file = load_plan(source)
    check_outputs({"PLAN": source, "--out": path, "--video": film}, {"--video": ".gif"})
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
