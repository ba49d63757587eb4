"""`jaxleg search CONFIG`: the main job."""

import dataclasses
import sys
from pathlib import Path
from typing import Any

from jaxleg.cli.options import first, take
from jaxleg.cli.start import EXIT_INFEASIBLE, EXIT_INTERRUPTED, HELP, cache_folder
from jaxleg.cli.study import NO_CONFIG, read_study


def search(arguments: list[str]) -> int:
    """`jaxleg search`: read and check everything first, then run the study in its folder."""
    source, out, resume, overrides = split(arguments)
    if source is None:
        return show_help(overrides)
    study, file, robot = read_study(source, overrides, "jaxleg search CONFIG")
    return run_study(study, robot, file, out or Path("runs") / Path(source).stem, resume)


def show_help(overrides: list[str]) -> int:
    """All keys of a study with their limits."""
    from jaxleg.search.config import Kind, Study
    from jaxleg.settings import from_command_line

    from_command_line(Study, Study(kinds={"flat": Kind()}), overrides, prog="jaxleg search CONFIG")
    return 0


def split(arguments: list[str]) -> tuple[str | None, Path | None, bool, list[str]]:
    """The config file (None where help is asked about none), --out, --resume and the remaining overrides of a command line."""
    rest = list(arguments)
    resume, out = take(rest, "resume", 0) is not None, take(rest, "out")
    named = None if HELP.intersection(rest) and rest[0].startswith("-") else first(rest, NO_CONFIG)
    return named, Path(out[0]) if out else None, resume, rest


def run_study(study: Any, robot: Any, robot_file: Any, out: Path, resume: bool) -> int:
    """Open the run folder, run the study with a progress bar, write the result, a table and figures."""
    from rich.console import Console

    from jaxleg.about import about
    from jaxleg.search.contestants import CONTESTANTS, STAGES, with_best
    from jaxleg.search.run import make_lab
    from jaxleg.search.run_folder import RunFolder
    from jaxleg.search.stages import work
    from jaxleg.search.study import run
    from jaxleg.settings import dump
    from jaxleg.viz.terminal import progress, randomised_lines, result_table

    console = Console(width=None if sys.stdout.isatty() else 110)
    study = dataclasses.replace(study, robot="robot.toml")  # the folder has all that its config.toml names
    made_with = {name: value for table in about().values() for name, value in table.items()}
    folder = RunFolder.open(out, {"config": study, "robot": robot_file}, resume, made_with)
    console.print(f"searching {', '.join(study.kinds)} at {study.speed:g} m/s; results go to {folder.path}")
    for change in folder.changes:
        console.print(f"this run began with {change}: the last digits may differ")
    try:
        with progress(console, work(study)) as report:
            lab = make_lab(study, robot, cache_folder())
            result, chosen = run(study, lab, folder, report)
            folder.write_result(result)
            dump(with_best(study, chosen), folder.best)
            report(work(study), "figures")
            failed = draw(study, lab, result, folder)
    except KeyboardInterrupt:
        console.print(f"interrupted; `--resume --out {out}` goes on from here")
        return EXIT_INTERRUPTED
    finally:
        folder.close()
    console.print(result_table(result))
    for line in randomised_lines(result):
        console.print(line, highlight=False, markup=False)
    console.print(f"result.json, best.toml and figures are in {folder.path}")
    for words in failed:
        console.print(f"no picture: {words}", markup=False)
    empty = empty_workspaces(result)
    for words in empty.values():
        console.print(words, markup=False)
    usable = any(result[name][kind]["speed"] is not None for name in CONTESTANTS for kind in study.kinds)
    if not usable:
        console.print("no contestant walks on any held-out terrain: each lane is infeasible (unfit) or fell")
    fitting = not any(name in STAGES for name, _ in empty)  # a published one that fits nothing is no failure of the search
    return 0 if usable and fitting else EXIT_INFEASIBLE


def empty_workspaces(result: dict[str, Any]) -> dict[tuple[str, str], str]:
    """By contestant and kind, a sentence on each workspace that four footholds together fit on no held-out terrain."""
    lines = {}
    for name, kinds in result["workspace"].items():
        for kind, seen in kinds.items():
            bounds = {end: bound for end, bound in seen["bounds"].items() if end != "high" and bound is not None}
            if bounds and (seen["found"]["nominal"], seen["found"]["widened"]) == (0.0, 0.0):
                words = ", ".join(f"{end} {bound:g}" for end, bound in bounds.items())
                lines[name, kind] = (
                    f"{kind}: on no held-out terrain do four feet of {name} fit its workspace together ({words} m)"
                )
    return lines


def draw(study: Any, lab: Any, result: dict[str, Any], folder: Any) -> list[str]:
    """Draw what can be drawn; returns a line on each picture that cannot. The result is safe by then."""
    failed = []
    try:
        from jaxleg.viz.study import study_pictures  # matplotlib: only once there is something to draw

        pictures = study_pictures(study, lab, result, folder.history)
    except Exception as error:  # whatever fails in a plotting library
        return [f"{folder.figures}: {error}"]
    for name, picture in pictures.items():
        try:
            picture(folder.figures / name)
        except Exception as error:
            failed.append(f"{folder.figures / name}: {error}")
    return failed
