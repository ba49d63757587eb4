"""What a search shows in the terminal: a progress bar with the time to go, and the table of results."""

import contextlib
from collections.abc import Callable, Generator
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

NAMES = {
    "traditional": "traditional",
    "implied": "implied",
    "paper": "paper's own",
    "best_i": "(i) paper's band",
    "best_ii": "(ii) stance alone",
    "best": "(iii) everything",
}


@contextlib.contextmanager
def progress(console: Console, total: float) -> Generator[Callable[[float, str], None]]:
    """A progress bar over `total` units of work; yields the function that reports (done, text).

    Where there is no terminal, a line is printed for each new text instead.
    """
    columns = (
        TextColumn("[progress.percentage]{task.percentage:>3.0f}%"),
        BarColumn(bar_width=24),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal, speed_estimate_period=120.0) as bar:
        task = bar.add_task("compiling", total=total)

        def report(done: float, text: str) -> None:
            bar.update(task, completed=min(done, total), description=text)
            if not console.is_terminal:
                console.print(f"{100.0 * min(done / total, 1.0):3.0f} %  {text}", highlight=False)

        yield report


def result_table(result: dict[str, Any]) -> Table:
    """Energy per metre, savings with 95 % intervals and what was lost on the way, a row a contestant and kind of terrain."""
    power = result["power"]
    title = f"held-out terrains (their number), {result['speed']:g} m/s, {power} power, savings in % with 95 % intervals"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for column in ("terrain", "contestant"):
        table.add_column(column, no_wrap=True)
    for column in ("J/m", "saving", "C MuJoCo", "margin m", "knee deg", "falls", "unfit"):
        table.add_column(column, justify="right", overflow="fold")
    for kind in result["bounds"]:
        for name, label in NAMES.items():
            first = kind_and_number(result, kind) if name == "traditional" else ""
            table.add_row(first, label, *_cells(result, name, kind, power), end_section=name == "best")
    return table


def randomised_lines(result: dict[str, Any]) -> list[str]:
    """A line a kind of terrain: what the best gait saves on randomised lanes, and how many of its and of the traditional
    gait's fell; none where a study has none."""
    if "randomised" not in result:
        return []
    seen, power, lines = result["randomised"], result["power"], []
    for kind in result["bounds"]:
        ours, theirs = (_percent(seen["saving"][engine]["best"][kind][power], True) for engine in ("simulation", "mujoco"))
        failed = [seen["failed"]["simulation"][name][kind] for name in ("traditional", "best")]
        falls, lanes = (sum(each[key] for each in failed) for key in ("falls", "lanes"))
        lines.append(f"{kind}, randomised: saves {ours} %, in C MuJoCo {theirs} %; {falls} of {lanes} lanes fell")
    return lines


def kind_and_number(result: dict[str, Any], kind: str) -> str:
    """A kind of terrain and how many different ones the contestants were compared on."""
    number = result["terrains"]["by_kind"]["held_out"][kind]
    return f"{kind} ({number})"


def _cells(result: dict[str, Any], name: str, kind: str, power: str) -> list[str]:
    row = result[name][kind]
    cells = [_number(row["energy_per_metre"][power]["mean"], "{:.0f}")]
    for engine in ("simulation", "mujoco"):
        saved = result["saving"][engine].get(name, {}).get(kind, {}).get(power)
        cells.append(_percent(saved, intervals=engine == "simulation") if saved else "")
    cells += [_number(row["min_stability_margin"], "{:.3f}"), _number(row["min_knee_bend_deg"], "{:.1f}")]
    return [*cells, f"{row['falls']}/{row['lanes']}", f"{row['infeasible']}/{row['lanes']}"]


def _percent(saved: dict[str, Any], intervals: bool) -> str:
    if saved["mean"] is None:
        return "none"
    mean = f"{100.0 * saved['mean']:.1f}"
    if not intervals or saved["ci95"] is None:
        return mean
    low, high = (f"{100.0 * x:.1f}" for x in saved["ci95"])
    return f"{mean} [{low}, {high}]"


def _number(value: float | None, form: str) -> str:
    return "none" if value is None else form.format(value)
