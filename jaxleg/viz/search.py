"""How a search went, and where the parameters ended up between their bounds."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxleg.search.config import RULES
from jaxleg.viz.style import BLACK, CONTESTANT_COLOUR, CONTESTANT_MARKER, GREY, PALE, blank, label, legend_below, save
from jaxleg.viz.terminal import NAMES

STAGES = ("best_i", "best_ii", "best")
PLACED = ("traditional", "paper", *STAGES)  # contestants whose parameters are drawn


def history(csv_path: str | Path, path: str | Path) -> None:
    """Objective against step of each search, a panel for each kind; a traditional gait has 1.

    `csv_path` is a run's history.csv with the columns kind, stage, step, terrains, best, mean and seconds.
    """
    with Path(csv_path).open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    figure, axes = blank(3.8, columns=len(kinds), sharey=True)
    for ax, kind in zip(axes, kinds):
        for stage in STAGES:
            _history_line(ax, [row for row in rows if row["kind"] == kind and row["stage"] == stage], stage)
        ax.axhline(1.0, color=GREY, lw=1.0, ls=":")
        _history_rounds(ax, [row for row in rows if row["kind"] == kind])
        label(ax, "step of the descent [-]\n(small: terrains)", "", kind)
    axes[0].set_ylabel("objective / traditional gait's energy [-]")
    axes[0].set_ylim(*_history_span(rows))
    legend_below(figure, _history_legend(), 3)
    save(figure, path)


def _number(cell: str) -> float:
    return float(cell) if cell else np.nan  # what was not finite is an empty cell


def _history_line(ax: Axes, rows: list[dict[str, str]], stage: str) -> None:
    step, best, mean = ([_number(row[column]) for row in rows] for column in ("step", "best", "mean"))
    ax.plot(step, best, color=CONTESTANT_COLOUR[stage], lw=2.0)
    ax.plot(step, mean, color=CONTESTANT_COLOUR[stage], lw=1.0, ls=(0, (4, 2)))


def _history_rounds(ax: Axes, rows: list[dict[str, str]]) -> None:
    """A line where the search goes on with other terrains, and how many."""
    first = {terrains: min(int(row["step"]) for row in rows if row["terrains"] == terrains) for terrains in _terrains(rows)}
    for terrains, step in first.items():
        ax.axvline(step - 0.5, color=PALE, lw=1.0, zorder=0)
        ax.text(step - 0.4, 0.02, f"{terrains}", transform=ax.get_xaxis_transform(), fontsize=7, color=GREY)


def _terrains(rows: list[dict[str, str]]) -> list[str]:
    return list(dict.fromkeys(row["terrains"] for row in rows))


def _history_span(rows: list[dict[str, str]]) -> tuple[float, float]:
    """Limits that hold 1 and nine tenths of the best values: on penalties a search may begin far above."""
    best = [value for row in rows if np.isfinite(value := _number(row["best"]))]
    return 0.0, 1.25 * max(1.0, float(np.percentile([1.0, *best], 90)))


def _history_legend() -> list:
    return [
        *(Line2D([], [], color=CONTESTANT_COLOUR[stage], lw=2.0, label=NAMES[stage]) for stage in STAGES),
        Line2D([], [], color=BLACK, lw=2.0, label="best start"),
        Line2D([], [], color=BLACK, lw=1.0, ls=(0, (4, 2)), label="mean of the starts"),
        Line2D([], [], color=GREY, lw=1.0, ls=":", label="traditional"),
    ]


def parameters(result: Mapping[str, Any], path: str | Path) -> None:
    """Where each parameter ended up between its bounds, by kind of terrain, and what binds the best gait."""
    figure, axes = blank(7.4, columns=len(result["bounds"]), sharey=True)
    for ax, (kind, spans) in zip(axes, result["bounds"].items()):
        for y, (name, span) in enumerate(spans.items()):
            _parameter_row(ax, y, span, {who: result[who][kind]["params"][name] for who in PLACED})
        active = [name.replace("_", " ") for name in result["active_constraints"]["best"][kind]]
        below = ["place between the bounds [-]", "", "what binds (iii):", *(active or ["nothing"])]
        label(ax, "\n".join(below), "", kind)
        ax.xaxis.label.set_fontsize(9)
        ax.tick_params(axis="y", length=0)
    names = result["bounds"][kind]
    axes[0].set_yticks(range(len(names)), [_with_unit(name) for name in names])
    axes[0].invert_yaxis()
    handles = [_mark(who, label=NAMES[who]) for who in PLACED]
    legend_below(figure, handles, 3)
    save(figure, path)


def _with_unit(name: str) -> str:
    unit = RULES[name if name in RULES else f"gait.{name}"]["unit"]
    return name.replace("_", " ") + (f" [{unit}]" if unit else "")


def _mark(who: str, x: tuple = (), y: tuple = (), **options: Any) -> Line2D:
    style = dict(color=CONTESTANT_COLOUR[who], marker=CONTESTANT_MARKER[who], ls="", mec=BLACK, mew=0.5, ms=5)
    return Line2D(x, y, **style, **options)


def _parameter_row(ax: Axes, y: int, span: list[float], values: dict[str, float]) -> None:
    low, high = span
    ax.plot([0.0, 1.0], [y, y], color=PALE, lw=6.0, solid_capstyle="butt", zorder=0)
    ax.text(-0.04, y, f"{low:.3g}", ha="right", va="center", fontsize=8)
    ax.text(1.04, y, f"{high:.3g}", ha="left", va="center", fontsize=8)
    for shift, (who, value) in zip(np.linspace(-0.33, 0.33, len(values)), values.items()):
        place = (value - low) / (high - low) if high > low else 0.5
        ax.add_line(_mark(who, (place,), (y + shift,)))
    ax.set(xlim=(-0.35, 1.35), xticks=[0.0, 0.5, 1.0])
