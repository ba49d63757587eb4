"""The foothold planner at work. Paper A, Fig. 7, and footholds on a map."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle

from jaxleg.conventions import LEGS, RING
from jaxleg.plan import FootholdStatus
from jaxleg.planning.planner import Choice, Site
from jaxleg.terrain.generators import Grid
from jaxleg.viz.style import BLACK, BLUE, GREEN, LEG_COLOUR, ORANGE, RED, SKY, blank, label, legend_below, save

MARKER = {FootholdStatus.NOMINAL: "o", FootholdStatus.WIDENED: "s", FootholdStatus.NEAREST: "^", FootholdStatus.NONE: "x"}


class Cascade(NamedTuple):
    """One call of the cascade on a small example."""

    status: FootholdStatus
    valid: np.ndarray  # (nx, ny)
    grid: Grid
    inside: np.ndarray  # candidates (i, j) within the rectangle that decided
    rank: np.ndarray  # their order of preference
    offset: np.ndarray  # the common offset that was chosen [m]


def draw_cascade(cases: list[Cascade], nominal: np.ndarray, cell: float, path: str | Path) -> None:
    """Fig. 7 from real calls, a row a case: valid cells of the rectangles, those that form the stance by rank, the choice.

    `nominal` (leg, 2) and `cell` in metres.
    """
    figure, axes = blank(1.0 + 1.6 * len(cases), rows=len(cases), columns=3, sharex=True, sharey=True)
    for row, case in enumerate(cases):
        common = _common(case, nominal)
        for column, ax in enumerate(axes[3 * row : 3 * row + 3]):
            _stance(ax, nominal, BLUE, "--")
            for foot in nominal:
                _cells(ax, case, foot, cell, common if column else None)
            if column == 2:
                _stance(ax, nominal + case.offset, RED, "-")
            ax.set_aspect("equal")
            title = (case.status.name.lower() + ": cells", "forming the stance", "chosen")[column]
            label(ax, "x [m]" if row == len(cases) - 1 else "", "y [m]" if column == 0 else "", title)
    legend_below(figure, _cascade_legend(), 3)
    save(figure, path)


def _common(case: Cascade, nominal: np.ndarray) -> np.ndarray:
    """Candidates (i, j) that are valid for every leg."""
    return np.logical_and.reduce([_window(case, foot) for foot in nominal]) & case.inside


def _window(case: Cascade, foot: np.ndarray) -> np.ndarray:
    half = np.array(case.inside.shape) // 2
    i, j = np.round((foot - case.grid.origin) / case.grid.resolution).astype(int) - half
    return case.valid[i : i + case.inside.shape[0], j : j + case.inside.shape[1]]


def _cells(ax: Axes, case: Cascade, foot: np.ndarray, cell: float, common: np.ndarray | None) -> None:
    """One leg's cells: green valid, yellow not; with `common`, blue and numbered by preference where the stance fits."""
    half, valid = np.array(case.inside.shape) // 2, _window(case, foot)
    order = {} if common is None else {rank: n + 1 for n, rank in enumerate(np.sort(case.rank[common]))}
    for i, j in np.argwhere(case.inside):
        corner = foot + (np.array([i, j]) - half - 0.5) * cell
        number = order.get(case.rank[i, j]) if common is not None and common[i, j] else None
        colour = SKY if number else (GREEN if valid[i, j] else ORANGE)
        ax.add_patch(Rectangle(tuple(corner), cell, cell, fc=colour, ec="white", lw=0.5, alpha=0.75))
        if number:
            ax.text(*(corner + 0.5 * cell), str(number), ha="center", va="center", fontsize=6)


def _stance(ax: Axes, feet: np.ndarray, colour: str, line: str) -> None:
    ax.add_patch(Polygon(feet[list(RING)], fill=False, ec=colour, ls=line, lw=1.2, zorder=3))
    ax.plot(*feet.T, "o", color=colour, ms=4, zorder=4)


def _cascade_legend() -> list:
    return [
        Patch(fc=GREEN, alpha=0.75, label="valid"),
        Patch(fc=ORANGE, alpha=0.75, label="not valid"),
        Patch(fc=SKY, alpha=0.75, label="valid for all four legs, by preference"),
        Line2D([], [], color=BLUE, ls="--", marker="o", ms=4, label="nominal stance"),
        Line2D([], [], color=RED, marker="o", ms=4, label="chosen stance"),
    ]


def draw_footholds(site: Site, nominal: np.ndarray, choice: Choice, length: float, width: float, path: str | Path) -> None:
    """Footholds (stance, leg, 2) on a map: elevation in grey, cells without a foothold tinted, unseen ones white.

    Search rectangles of `length` x `width` [m] along +x round the nominal footholds; the marker tells the `FootholdStatus`.
    """
    figure, (ax,) = blank(4.6)
    terrain, resolution = site.terrain, float(site.terrain.resolution)
    elevation, origin = np.asarray(terrain.elevation), np.asarray(terrain.origin)
    x, y = (origin[k] + resolution * np.arange(elevation.shape[k]) for k in (0, 1))
    image = ax.pcolormesh(x, y, elevation.T, cmap="Greys_r", shading="nearest", rasterized=True)
    bad = np.where(np.asarray(site.valid) | ~np.isfinite(elevation), np.nan, 1.0)
    ax.pcolormesh(x, y, bad.T, cmap="Wistia", vmin=0.0, vmax=1.2, alpha=0.35, shading="nearest", rasterized=True)
    status, offset = np.asarray(choice.status), np.asarray(choice.offset)
    for leg, colour in enumerate(LEG_COLOUR):
        for k, foot in enumerate(nominal[:, leg]):
            corner = foot - 0.5 * np.array([length, width])
            ax.add_patch(Rectangle(tuple(corner), length, width, fill=False, ec=colour, lw=0.7))
            ax.plot(*foot, "+", color=colour, ms=6)
            ax.plot(*(foot + offset[k, leg]), MARKER[FootholdStatus(status[k, leg])], color=colour, mec=BLACK, mew=0.6, ms=7)
    low, high = nominal.min(axis=(0, 1)), nominal.max(axis=(0, 1))
    ax.set(xlim=(low[0] - length, high[0] + length), ylim=(low[1] - 0.2, high[1] + 0.2), aspect="equal")
    label(ax, "x [m]", "y [m]", "twelve footholds in one call")
    bar = figure.colorbar(image, ax=ax, shrink=0.8, pad=0.01)
    bar.set_label("height [m]")
    legend_below(figure, _map_legend(), 4)
    save(figure, path)


def _map_legend() -> list:
    legs = [Line2D([], [], ls="", marker="o", color=colour, label=leg) for leg, colour in zip(LEGS, LEG_COLOUR)]
    kinds = [Line2D([], [], ls="", marker=m, color="white", mec=BLACK, label=s.name.lower()) for s, m in MARKER.items()]
    rest = [Line2D([], [], ls="", marker="+", color=BLACK, label="nominal foothold"), Patch(fc="#ffe066", label="no foothold")]
    return [*legs, *kinds, *rest]
