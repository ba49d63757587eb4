"""Swings over a terrain profile: the foot's path, its cases, its contacts, the end interval."""

import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxleg.swing.machine import Mode
from jaxleg.swing.trace import Trace
from jaxleg.viz.style import BLACK, BLUE, GREEN, GREY, ORANGE, PALE, PURPLE, RED, SKY, blank, label, legend_below, save

KINDS = {  # what a segment is called, and its colour; several modes are one case of the paper's
    "initial movement, planned route": (BLUE, (Mode.INITIAL, Mode.ROUTE)),
    "case 1: down": (GREEN, (Mode.DOWN,)),
    "case 2: to a corner": (PURPLE, (Mode.CORNER,)),
    "case 3: over": (SKY, (Mode.OVER,)),
    "case 4: back, up, forward": (RED, (Mode.BACK, Mode.UP, Mode.FORWARD)),
    "lift and probe (extended)": (ORANGE, (Mode.LIFT, Mode.ACROSS, Mode.PROBE)),
    "return": (GREY, (Mode.RETURN_UP, Mode.RETURN_ACROSS, Mode.RETURN_DOWN)),
}
COLOUR = {mode: colour for colour, modes in KINDS.values() for mode in modes}


class SwingPicture(NamedTuple):
    """One panel."""

    title: str
    trace: Trace
    x: np.ndarray
    ground: np.ndarray  # true height at x
    interval: tuple[float, float]  # En
    believed: tuple[np.ndarray, np.ndarray] | None = None  # x and height of the map at the start


def draw_swings(pictures: list[SwingPicture], path: Path) -> None:
    """Panels two by two; contacts are dots, the end interval is shaded."""
    figure, axes = blank(2.7 * ((len(pictures) + 1) // 2) + 0.8, (len(pictures) + 1) // 2, 2, sharex=True)
    lowest = min(picture.ground.min() for picture in pictures) - 0.4
    highest = max(points[:, 1].max() for picture in pictures for points in picture.trace.point) + 0.3
    for ax, picture in zip(axes, pictures, strict=False):
        _panel(ax, picture)
        ax.set_ylim(lowest, highest)
    handles = [
        *_case_keys(picture.trace for picture in pictures),
        Line2D([], [], color=BLACK, marker="o", ls="", ms=4, label="contact"),
    ]
    if any(picture.believed is not None for picture in pictures):
        handles.append(Line2D([], [], color=BLACK, ls="--", lw=1, label="map"))
    legend_below(figure, handles, 3)
    save(figure, path)


def _panel(ax: Axes, picture: SwingPicture) -> None:
    ax.axvspan(*picture.interval, color=SKY, alpha=0.18, lw=0)
    ax.fill_between(picture.x, picture.ground.min() - 20.0, picture.ground, color=PALE, lw=0)
    ax.plot(picture.x, picture.ground, color=GREY, lw=1)
    if picture.believed is not None:
        ax.plot(*picture.believed, color=BLACK, lw=1, ls="--")
    _draw_way(ax, picture.trace, lw=1.6)
    for points in itertools.compress(picture.trace.point, picture.trace.hit):
        ax.plot(*points[-1], marker="o", ms=4, color=BLACK)
    ax.set_xlim(picture.x[0], picture.x[-1])
    ax.set_aspect("equal")
    label(ax, "x", "z", picture.title)


def _draw_way(ax: Axes, trace: Trace, lw: float) -> None:
    """The foot's path, each segment in its case's colour."""
    for mode, points in zip(trace.mode, trace.point, strict=True):
        ax.plot(*points.T, color=COLOUR[Mode(mode)], lw=lw)


def _case_keys(traces: Iterable[Trace]) -> list[Line2D]:
    """Keys of the cases that occur."""
    seen = {mode for trace in traces for mode in trace.mode}
    return [Line2D([], [], color=colour, label=name) for name, (colour, modes) in KINDS.items() if seen & set(modes)]


def draw_course(x: np.ndarray, heights: dict[str, np.ndarray], walks: dict[str, list[Trace]], path: Path) -> None:
    """One foot's way over a course, a panel a strategy; `heights` has the true ground and what the robot was told."""
    figure, axes = blank(2.3 * len(walks) + 0.7, len(walks), 1, sharex=True)
    for ax, (title, swings) in zip(axes, walks.items(), strict=True):
        ax.fill_between(x, heights["true"].min() - 5.0, heights["true"], color=PALE, lw=0)
        ax.plot(x, heights["told"], color=BLACK, lw=1, ls="--")
        for swing in swings:
            _draw_way(ax, swing, lw=1.2)
        ax.set_xlim(x[0], x[-1])
        ax.set_ylim(heights["true"].min() - 3.0, heights["true"].max() + 8.0)
        label(ax, "x", "z", title)
    told = Line2D([], [], color=BLACK, ls="--", lw=1, label="what the robot was told")
    legend_below(figure, [*_case_keys(itertools.chain.from_iterable(walks.values())), told], 3)
    save(figure, path)


def draw_front(values: np.ndarray, front: np.ndarray, marked: dict[str, tuple[float, float, float]], path: Path) -> None:
    """Settings tried, each (success, path length, adjustments): success and adjustments against the path, two of them named."""
    figure, axes = blank(3.8, 1, 2)
    rest = np.setdiff1d(np.arange(len(values)), front)
    for ax, row, scale, name in zip(axes, (0, 2), (100.0, 1.0), ("success [%]", "mean adjustments"), strict=True):
        ax.plot(values[rest, 1], scale * values[rest, row], ls="", marker="o", ms=3, color=GREY, label="settings tried")
        ax.plot(values[front, 1], scale * values[front, row], ls="", marker="o", ms=4, color=BLUE, label="not beaten by any")
        for (what, at), colour, marker in zip(marked.items(), (RED, GREEN), ("s", "D"), strict=True):
            ax.plot(at[1], scale * at[row], ls="", marker=marker, ms=8, color=colour, label=f"{what} (held out)")
        label(ax, "mean path length", name)
    legend_below(figure, axes[0].get_legend_handles_labels()[0], 4)
    save(figure, path)
