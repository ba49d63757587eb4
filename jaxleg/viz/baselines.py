"""Savings over a grid of possible baselines."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.lines import Line2D

from jaxleg.viz.style import BLACK, blank, label, legend_below, save

KINDS = ("flat", "stairs")
MARKERS = {"average power": "o", "sums": "s"}


def draw_baselines(
    rows: Sequence[Mapping[str, Any]], contestant: str, matches: Mapping[str, Mapping[str, Any]], path: str | Path
) -> None:
    """Saving [%] of a contestant ("paper" or "ours") against every baseline of the grid, a row of panels a kind of terrain.

    `rows` and `matches` are those of `runs/baselines/result.json`. Markers: the cells at which the paper's parameters
    save nearest to what the paper says (hollow: if so large a part of the power is lost anyway). Cells that cannot be walked
    stay white.
    """
    columns = list(dict.fromkeys((row["mass"], row["skew"]) for row in rows))
    figure, axes = blank(5.6, rows=len(KINDS), columns=len(columns), sharex=True, sharey=True)
    values = [row[kind]["saving"][contestant] for row in rows for kind in KINDS]
    known = [v for v in values if v is not None]
    norm = TwoSlopeNorm(0.0, min(-20.0, *known), max(20.0, *known))
    for k, kind in enumerate(KINDS):
        for c, (mass, skew) in enumerate(columns):
            ax = axes[k * len(columns) + c]
            cells = [row for row in rows if (row["mass"], row["skew"]) == (mass, skew)]
            image = _panel(ax, cells, kind, contestant, norm)
            _marks(ax, matches, mass, skew)
            title = f"{skew},\nmass {mass}" if k == 0 else ""
            label(ax, "L_F2H centre [m]" if k else "", f"{kind}\nH_COG [m]" if c == 0 else "", title)
            ax.title.set_fontsize(9)
    who = "the paper's parameters" if contestant == "paper" else "our parameters"
    bar = figure.colorbar(image, ax=axes, shrink=0.9, pad=0.01)
    bar.set_label(f"saving of {who} [%]")
    legend_below(figure, _legend(), 2)
    save(figure, path)


def _panel(ax: Axes, cells: Sequence[Mapping[str, Any]], kind: str, contestant: str, norm: TwoSlopeNorm):
    x, y = (sorted({cell[key] for cell in cells}) for key in ("foot_offset", "hip_height"))
    grid = np.full((len(y), len(x)), np.nan)
    for cell in cells:
        saving = cell[kind]["saving"][contestant]
        grid[y.index(cell["hip_height"]), x.index(cell["foot_offset"])] = np.nan if saving is None else saving
    image = ax.pcolormesh(x, y, grid, cmap="RdBu", norm=norm, shading="nearest")
    if np.isfinite(grid).all() and np.nanmin(grid) < 10.0 < np.nanmax(grid):
        lines = ax.contour(x, y, grid, levels=[0.0, 10.0, 20.0, 40.0], colors=BLACK, linewidths=0.7)
        ax.clabel(lines, fmt="%g %%", fontsize=7)
    return image


def _marks(ax: Axes, matches: Mapping[str, Mapping[str, Any]], mass: str, skew: str) -> None:
    for name, found in matches.items():
        for title, cell in found.items():
            if (cell["mass"], cell["skew"]) == (mass, skew):
                style = dict(mfc=BLACK if title == "as it is" else "white", mec=BLACK, ms=9 if name == "sums" else 6)
                ax.plot(cell["foot_offset"], cell["hip_height"], MARKERS[name], **style)


def _legend() -> list:
    return [
        Line2D([], [], ls="", marker=marker, mec=BLACK, mfc=fill, ms=7, label=f"nearest to the paper's {name}{loss}")
        for name, marker in MARKERS.items()
        for fill, loss in ((BLACK, ""), ("white", ", with a constant loss"))
    ]
