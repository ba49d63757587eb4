"""Where a gait keeps paper A's constraints (5)-(7), and which one stops it first."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxleg.gait.limits import Binding, gait_region, search_limit, step_limit
from jaxleg.robot import Robot
from jaxleg.viz.style import BLACK, BLUE, GREEN, ORANGE, PALE, blank, label, legend_below, save

COLOUR = {Binding.SEARCH_BEHIND: ORANGE, Binding.STEP_REACH: BLUE, Binding.SEARCH_REACH: GREEN}
MEANING = {
    Binding.SEARCH_BEHIND: "(5) the foot may land behind where it stood",
    Binding.STEP_REACH: "(6) the hind leg stretches straight",
    Binding.SEARCH_REACH: "(7) the flying leg stretches straight",
}
CELLS = 301


def gait_regions(robot: Robot, heights: list[float], chosen: tuple[float, float], path: str | Path) -> None:
    """The region of (L_Step, L_Search) at each H_COG of `heights` [m], coloured by the constraint with the least slack.

    `chosen` is a gait (L_Step, L_Search) [m] to mark. The axes span the region at the lowest height.
    """
    widest = float(step_limit(robot, min(heights)).length)
    step, search = np.linspace(0.0, 1.08 * widest, CELLS), np.linspace(0.0, 1.08 * 1.6 * widest, CELLS)
    figure, axes = blank(3.6, columns=len(heights), sharey=True)
    for ax, height in zip(axes, heights):
        _region(ax, robot, height, step, search)
        _border(ax, robot, height, step)
        ax.plot(*chosen, marker="*", ms=13, color="white", mec=BLACK, ls="none")
        ax.set(xlim=(0.0, step[-1]), ylim=(0.0, search[-1]), facecolor=PALE)
        ax.text(0.04, 0.96, "not allowed", transform=ax.transAxes, va="top", fontsize=8)
        label(ax, "step L_Step [m]", "", f"H_COG = {height:.2f} m")
    axes[0].set_ylabel("search length L_Search [m]")
    legend_below(figure, _legend(chosen), 2)
    figure.legends[0].set_title("allowed, and the constraint with the least slack", prop={"size": 9})
    save(figure, path)


def _region(ax: Axes, robot: Robot, height: float, step: np.ndarray, search: np.ndarray) -> None:
    region = gait_region(robot, height, jnp.asarray(step, float)[:, None], jnp.asarray(search, float))
    shown = np.where(region.feasible, region.binding, np.nan)
    edges = [binding - 0.5 for binding in COLOUR] + [max(COLOUR) + 0.5]
    colours, norm = ListedColormap(list(COLOUR.values())), BoundaryNorm(edges, len(COLOUR))
    ax.pcolormesh(step, search, shown.T, cmap=colours, norm=norm, alpha=0.75, rasterized=True)


def _border(ax: Axes, robot: Robot, height: float, step: np.ndarray) -> None:
    end = float(step_limit(robot, height).length)
    below = step[step < end]
    top = np.asarray(search_limit(robot, height, jnp.asarray(below, float)).length)
    if below.size:
        ax.plot([*below, end, end], [*top, top[-1], 0.0], color=BLACK, lw=1.4)


def _legend(chosen: tuple[float, float]) -> list:
    keys = [Patch(color=colour, alpha=0.75, label=MEANING[binding]) for binding, colour in COLOUR.items()]
    star = f"paper A's choice ({chosen[0]:g} m, {chosen[1]:g} m)"
    return [*keys, Line2D([], [], marker="*", ms=13, color="white", mec=BLACK, ls="none", label=star)]
