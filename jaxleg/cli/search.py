"""`jaxleg search CONFIG`: the main job."""

import dataclasses
import os
import sys
from pathlib import Path
from typing import Any

from jaxleg.cli.start import EXIT_INFEASIBLE, EXIT_INTERRUPTED, USAGE, configure_jax, quietly
from jaxleg.conventions import InputError


def search(arguments: list[str]) -> int:
    """`jaxleg search`: read and check everything first, then run the study in its folder."""
    from jaxleg.robot import load_robot
    from jaxleg.search.checks import check_study
    from jaxleg.search.config import Kind, Study, robot_path
    from jaxleg.settings import from_command_line, load

    source, out, resume, overrides = split(arguments)
    study = load(Study, source) if source else Study(kinds={"flat": Kind()})  # no CONFIG: only to show the help
    study = from_command_line(Study, study, overrides, prog="jaxleg search CONFIG")
    if source is None:
        raise InputError("command line: CONFIG is missing; give a TOML file such as configs/quickstart.toml")
    path = robot_path(study, source)
    configure_jax()
    robot = load_robot(path)
    check_study(study, source, leg_numbers(robot))
    return run_study(study, robot, path, out or Path("runs") / Path(source).stem, resume)


def split(arguments: list[str]) -> tuple[str | None, Path | None, bool, list[str]]:
    """The config file, --out, --resume and the remaining overrides of a command line."""
    rest, out, resume = list(arguments), None, "--resume" in arguments
    if resume:
        rest.remove("--resume")
    if "--out" in rest:
        at = rest.index("--out")
        if at + 1 >= len(rest):
            raise InputError("command line: --out is given without a value, but a folder must follow it")
        out = Path(rest[at + 1])
        del rest[at : at + 2]
    if {"-h", "--help"} & set(rest):
        print(USAGE)
    named = [] if not rest or rest[0].startswith("-") else [rest.pop(0)]
    if not named and not {"-h", "--help"} & set(rest):
        raise InputError("command line: CONFIG is missing; give a TOML file such as configs/quickstart.toml")
    return named[0] if named else None, out, resume, rest


def leg_numbers(robot: Any) -> Any:
    """Lengths of the robot's legs, for the check of the study."""
    from jaxleg.search.checks import Legs
    from jaxleg.stance import leg_length

    return Legs(float(leg_length(robot)), float(-robot.link_offset[0, 1, 2]), float(robot.foot_radius))


def run_study(study: Any, robot: Any, robot_file: Path, out: Path, resume: bool) -> int:
    """Open the run folder, run the study with a progress bar, write the result, its figures and a table."""
    from rich.console import Console

    quietly()

    from jaxleg.search.run import CONTESTANTS, make_lab, work
    from jaxleg.search.run_folder import RunFolder
    from jaxleg.search.study import run
    from jaxleg.viz.terminal import progress, result_table

    console = Console(width=None if sys.stdout.isatty() else 110)
    folder = RunFolder.open(out, study, resume)
    console.print(f"searching {', '.join(study.kinds)} at {study.speed:g} m/s; results go to {folder.path}")
    try:
        with progress(console, work(study)) as report:
            result, chosen = run(study, robot, folder, report)
            report(work(study), "figures")
            from jaxleg.viz.study import draw_study  # matplotlib: only once there is something to draw

            draw_study(study, make_lab(study, robot), result, folder.history, folder.figures)
    except KeyboardInterrupt:
        console.print(f"interrupted; `--resume --out {out}` goes on from here")
        return EXIT_INTERRUPTED
    folder.write_result(result)
    write_best(study, robot_file, folder, chosen)
    console.print(result_table(result))
    console.print(f"result.json, best.toml and figures are in {folder.path}")
    usable = any(result[name][kind]["speed"] is not None for name in CONTESTANTS for kind in study.kinds)
    if not usable:
        console.print("no contestant walks on any held-out terrain: each lane is infeasible (unfit) or fell")
    return 0 if usable else EXIT_INFEASIBLE


def write_best(study: Any, robot_file: Path, folder: Any, chosen: dict) -> None:
    """`best.toml`: the study with each kind's best gait in place."""
    from jaxleg.search.config import PARAMETERS, Gait
    from jaxleg.settings import dump

    gaits = {kind: Gait(**dict(zip(PARAMETERS, map(float, best[-1])))) for kind, best in chosen.items()}
    kinds = {kind: dataclasses.replace(table, gait=gaits[kind]) for kind, table in study.kinds.items()}
    robot = os.path.relpath(robot_file, folder.path)
    dump(dataclasses.replace(study, kinds=kinds, robot=robot), folder.best)
