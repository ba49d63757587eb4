"""What a path is searched on: a map's elevation, features, body cost and total cost. Paper C, Fig. 11 to 13."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from jaxleg.terrain.body_cost import BodyFeatures
from jaxleg.terrain.cost_map import CostMap
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.viz.ground import View, border, colour_bar, span
from jaxleg.viz.style import BLACK, BLUE, GREY, RED, blank, label, legend_below, save

Paths = Sequence[tuple[str, np.ndarray]]  # label, (n, xy) in W [m]
LINES = ((RED, "-"), (BLUE, "--"), (BLACK, ":"))
LEAST_RANGE = 1e-3  # that the colours span at least [m or rad]
MAP_WIDTH = {2: 3.1, 3: 1.75}  # of a panel's map [inches], by columns; the rest of it is labels


class Panel(NamedTuple):
    """A map in colours."""

    title: str
    values: np.ndarray  # (nx, ny); what is not finite is hatched
    colours: str
    top: float | None  # of the colours' range from 0 up; None: the values' own range


def cost_maps(
    terrain: HeightMap, features: BodyFeatures, cost: CostMap, heading: int, path: str | Path, paths: Paths = ()
) -> None:
    """Six panels over x and y: elevation, slope, roughness, step height, body cost, total cost for a heading of `HEADINGS`.

    Up to three `paths` are drawn over elevation and total cost.
    """
    elevation = np.asarray(terrain.elevation)
    wide = elevation.shape[0] >= elevation.shape[1]
    rows, columns = (3, 2) if wide else (2, 3)
    extent = border(terrain)
    figure, axes = blank(_height(extent, rows, columns), rows, columns, sharex=True, sharey=True)
    for number, (ax, panel) in enumerate(zip(axes, _panels(elevation, features, cost, heading))):
        _draw(ax, panel, extent)
        bottom, left = number >= (rows - 1) * columns, number % columns == 0
        label(ax, "x [m]" if bottom else "", "y [m]" if left else "", panel.title)
    for ax in (axes[0], axes[-1]):
        _draw_paths(ax, paths)
    if paths:
        legend_below(figure, [Line2D([], [], color=c, ls=s, label=name) for (name, _), (c, s) in zip(paths, LINES)], len(paths))
    save(figure, path)


def _panels(elevation: np.ndarray, features: BodyFeatures, cost: CostMap, heading: int) -> list[Panel]:
    total = f"(f) total, heading {45 * heading} deg"
    return [
        Panel("(a) elevation [m]", elevation, "gray", None),
        Panel("(b) slope [rad]", np.asarray(features.slope), "viridis", None),
        Panel("(c) roughness [m]", np.asarray(features.roughness), "viridis", None),
        Panel("(d) step height [m]", np.asarray(features.step_height), "viridis", None),
        Panel("(e) body cost", np.asarray(cost.body), "viridis", 1.0),
        Panel(total, np.asarray(cost.total[heading]), "viridis", 1.0),
    ]


def _draw(ax: Axes, panel: Panel, extent: View) -> None:
    """The map with its colour bar; hatched where there is no value: unseen, or no way."""
    values = np.ma.masked_invalid(panel.values)
    low, high = (0.0, panel.top) if panel.top is not None else span(values.compressed(), LEAST_RANGE)
    ax.add_patch(Rectangle((0, 0), 1, 1, transform=ax.transAxes, fc="white", ec=GREY, hatch="////", lw=0, zorder=-1))
    image = ax.imshow(
        values.T,
        origin="lower",
        extent=extent,
        cmap=matplotlib.colormaps[panel.colours].with_extremes(bad=(0, 0, 0, 0)),
        vmin=low,
        vmax=high,
    )
    ax.set_aspect("equal")
    colour_bar(ax, image, "")


def _draw_paths(ax: Axes, paths: Paths) -> None:
    for (_, xy), (colour, style) in zip(paths, LINES):
        ax.plot(*np.asarray(xy).T, color="white", lw=3.2)  # on dark ground and on light
        ax.plot(*np.asarray(xy).T, color=colour, ls=style, lw=1.8)
        ax.plot(*np.asarray(xy)[[0, -1]].T, "o", color=colour, ms=4, mec="white")


def _height(extent: View, rows: int, columns: int) -> float:
    """Of the figure [inches]."""
    return rows * (MAP_WIDTH[columns] * (extent[3] - extent[2]) / (extent[1] - extent[0]) + 0.55) + 0.5
