"""Walks of several planners over one map, side by side."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from jaxleg.terrain.heightmap import HeightMap
from jaxleg.viz.ground import GROUND_KEYS, View, colour_bar, draw_ground
from jaxleg.viz.style import BLACK, LEG_COLOUR, WIDTH, blank, label, leg_keys, legend_below, save

TRUNK = dict(color=BLACK, lw=1.3)
FOOT = dict(marker="o", ls="", ms=5, mec="white", mew=0.5)


class Seen(NamedTuple):
    """A walk from above, in W [m]."""

    title: str
    trunk: np.ndarray  # (t, xyz...) centre of the trunk
    feet: np.ndarray  # (t, leg, xyz) centres of the feet
    footholds: np.ndarray  # (stance, leg, xyz...) where they stood


def draw_walks(terrain: HeightMap, valid: np.ndarray, walks: Sequence[Seen], view: View, path: str | Path) -> None:
    """Ways of trunk and feet, and footholds, over the elevation in a view; cells that are not `valid` footholds tinted."""
    left, right, bottom, top = view
    figure, axes = blank(len(walks) * ((WIDTH - 1.5) * (top - bottom) / (right - left) + 0.7) + 0.6, len(walks))
    for ax, walk in zip(axes, walks):
        colour_bar(ax, draw_ground(ax, terrain, valid, view))
        _draw(ax, walk)
        label(ax, "x [m]", "y [m]", walk.title)
    legend_below(figure, [Line2D([], [], label="trunk", **TRUNK), *leg_keys("{} foothold", **FOOT), *GROUND_KEYS], 4)
    save(figure, path)


def _draw(ax: Axes, walk: Seen) -> None:
    for leg, colour in enumerate(LEG_COLOUR):
        ax.plot(*walk.feet[:, leg, :2].T, color=colour, lw=0.6)
        ax.plot(*walk.footholds[:, leg, :2].T, color=colour, **FOOT)
    ax.plot(*walk.trunk[:, :2].T, **TRUNK)
