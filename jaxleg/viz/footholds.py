"""The foothold planner at work: paper A, Fig. 7 from real calls, and the footholds of a walk on a map.

Both are drawn from `Planned`, what was asked of `plan_footholds` and what came back.
"""

import functools
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon, Rectangle

from jaxleg.conventions import LEG_SIDE, LEGS, RING
from jaxleg.foothold.contract import Footholds, FootholdStatus
from jaxleg.foothold.rectangle import SearchRectangle, candidates, cells_around, extent_of, feasible_score, preference
from jaxleg.terrain.heightmap import nearest_cell
from jaxleg.terrain.site import Site
from jaxleg.viz.ground import GROUND_KEYS, HEIGHT, INVALID, draw_ground
from jaxleg.viz.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LEG_COLOUR,
    ORANGE,
    RED,
    SKY,
    WIDTH,
    blank,
    label,
    leg_keys,
    legend_below,
    save,
)

MARKER = {FootholdStatus.NOMINAL: "o", FootholdStatus.WIDENED: "s", FootholdStatus.NEAREST: "^", FootholdStatus.NONE: "X"}
MEANING = {
    FootholdStatus.NOMINAL: "nominal: one offset for all feet",
    FootholdStatus.WIDENED: "widened: the same, after lengthening",
    FootholdStatus.NEAREST: "nearest: the leg's own nearest cell",
    FootholdStatus.NONE: "none: no foothold found",
}
MARGIN = 0.06  # drawn round the rectangles [m]
FORWARD, LEFT = "x [m]", "y [m]"


class Planned(NamedTuple):
    """Stances whose footholds have been chosen."""

    site: Site
    rectangle: SearchRectangle
    nominal: np.ndarray  # (stance, leg, xy) in W [m]
    choice: Footholds  # leading axis stance

    def chosen(self) -> np.ndarray:
        """Footholds (stance, leg, xy) in W [m]; one that was not found stays at its nominal foothold."""
        return self.nominal + np.asarray(self.choice.offset)


class Cells(NamedTuple):
    """The cells (i, j) round each nominal foothold of a stance."""

    offset: np.ndarray  # (i, j, xy) from the nominal foothold, in W [m]
    inside: np.ndarray  # (i, j) within the rectangle
    valid: np.ndarray  # (leg, i, j)
    number: np.ndarray  # (i, j) 1, 2, ... those that form the nominal stance, as preferred; 0 the others


class Panel(NamedTuple):
    """One panel of the figure of the cascade."""

    title: str
    planned: Planned
    cells: Cells
    coloured: bool  # by validity
    numbered: bool  # those that form the stance
    chosen: bool  # the chosen stance on top


def search_cells(planned: Planned, widened: bool) -> Cells:
    """Cells of the first stance's rectangles, as they are or lengthened, in the planner's own order (A10, A11).

    Heights play no part: for level ground. The rectangles must lie within the map.
    """
    terrain, box = planned.site.terrain, planned.rectangle
    size = float(box.length + box.longer), float(box.width)
    around = extent_of(*size, 0.0, float(terrain.resolution), float(box.heading)).cells
    nearest, offset, inside, keys = jax.device_get(_compared(terrain, box, planned.nominal[0], around, widened))
    cell = nearest[:, None, None] + cells_around(around)
    valid = np.asarray(planned.site.valid)[cell[..., 0], cell[..., 1]]
    return Cells(offset, inside, valid, _numbered(keys, inside & valid.all(axis=0)))


@functools.partial(jax.jit, static_argnums=(3, 4))
def _compared(terrain, box, nominal, around, widened):
    """The nominal footholds' cells; of the cells round one: offsets [m], whether they count, and what they are compared by."""
    seen = candidates(box, terrain.resolution, around)
    inside, longer = (seen.long, box.longer) if widened else (seen.short, 0.0)
    keys = preference(seen.along, feasible_score(seen.along, box, longer))
    return nearest_cell(terrain, nominal), seen.offset, inside, keys


def _numbered(keys: tuple[np.ndarray, ...], common: np.ndarray) -> np.ndarray:
    """1, 2, ... in the order of preference where `common`, 0 elsewhere; (i, j)."""
    number = np.zeros(common.shape, int)
    number[common] = 1 + np.argsort(np.lexsort([-key[common] for key in reversed(keys)]))
    return number


def draw_cascade(first: Planned, second: Planned, path: str | Path) -> None:
    """Paper A, Fig. 7, from two calls of one stance each: one ends within the rectangles, one within the lengthened ones."""
    figure, axes = blank(9.6, rows=4, columns=2, sharex=True, sharey=True)
    for number, (ax, panel) in enumerate(zip(axes, _panels(first, second))):
        _draw_panel(ax, panel)
        label(ax, FORWARD if number > 4 else "", LEFT if number % 2 == 0 else "", panel.title)
        ax.tick_params(labelbottom=number > 4)
    corners = np.concatenate([_corners(planned, widened=True) for planned in (first, second)]).reshape(-1, 2)
    axes[0].set(xlim=_span(corners[:, 0], 0.012), ylim=_span(corners[:, 1], 0.012))
    axes[0].set(xticks=np.arange(-2, 3) / 10.0, yticks=np.arange(-1, 2) / 20.0)
    axes[-1].axis("off")
    axes[-1].legend(handles=_cascade_legend(), loc="center", fontsize=9, frameon=False)
    save(figure, path)


def _panels(first: Planned, second: Planned) -> list[Panel]:
    """(a) to (g), lettered as in the paper."""
    near, none, far = search_cells(first, False), search_cells(second, False), search_cells(second, True)
    count = int(none.number.max())
    return [
        Panel("(a) initial stance, search rectangles", first, near, False, False, False),
        Panel("(b) valid and invalid cells", first, near, True, False, False),
        Panel("(c) cells that form the nominal stance", first, near, True, True, False),
        Panel(f"(d) chosen, status {_outcome(first)}", first, near, True, True, True),
        Panel(f"(e) another map: {count or 'no'} cells form the stance", second, none, True, False, False),
        Panel("(f) rectangles lengthened", second, far, True, True, False),
        Panel(f"(g) chosen, status {_outcome(second)}", second, far, True, True, True),
    ]


def _outcome(planned: Planned) -> str:
    """The first stance's status, as the planner gave it."""
    return FootholdStatus(int(planned.choice.status[0, 0])).name


def _draw_panel(ax: Axes, panel: Panel) -> None:
    """Cells, nominal stance and, at last, the chosen stance of the first stance planned."""
    for leg, foot in enumerate(panel.planned.nominal[0]):
        for i, j in np.argwhere(panel.cells.inside).tolist():
            _draw_cell(ax, panel, leg, foot, (i, j))
    _draw_stance(ax, panel.planned.nominal[0], color=BLUE, ls="--", mfc="white" if panel.numbered else BLUE)
    if panel.chosen:
        _draw_stance(ax, panel.planned.chosen()[0], color=RED, ls="-", mfc=RED)
    if not panel.coloured:
        _name_legs(ax, panel)
    ax.set_aspect("equal")


def _draw_cell(ax: Axes, panel: Panel, leg: int, foot: np.ndarray, at: tuple[int, int]) -> None:
    """One cell of a leg: green valid, orange not, blue with its number where the stance can be formed."""
    size = float(panel.planned.site.terrain.resolution)
    number = panel.cells.number[at] if panel.numbered else 0
    colour = SKY if number else GREEN if panel.cells.valid[(leg, *at)] else ORANGE
    centre, strength = foot + panel.cells.offset[at], 0.35 if panel.numbered and not number else 0.8
    face = dict(fc=_paler(colour, strength), ec="white") if panel.coloured else dict(fc="white", ec=GREY)
    ax.add_patch(Rectangle(tuple(centre - 0.5 * size), size, size, lw=0.8, zorder=3, **face))
    if number:
        ax.text(*centre, str(number), ha="center", va="center", fontsize=8, zorder=6)


def _paler(colour: str, strength: float) -> tuple[float, ...]:
    """A colour mixed with white; opaque, so that the stance's lines pass behind the cells."""
    return tuple(1.0 - strength * (1.0 - value) for value in to_rgb(colour))


def _draw_stance(ax: Axes, feet: np.ndarray, mfc: str, **line) -> None:
    """Feet (leg, xy) [m] and, behind the cells, the parallelogram between them."""
    ax.plot(*feet[[*RING, RING[0]]].T, lw=1.4, zorder=2, **line)
    ax.plot(*feet.T, "o", ms=9, mec=line["color"], mfc=mfc, mew=1.2, zorder=5)


def _name_legs(ax: Axes, panel: Panel) -> None:
    """Each leg's name beside its rectangle, towards the middle."""
    away = 0.5 * float(panel.planned.rectangle.width) + 0.012
    for name, side, foot in zip(LEGS, LEG_SIDE, panel.planned.nominal[0]):
        ax.text(foot[0] + 0.03 * side, foot[1] - away * side, name, ha="center", va="center", fontsize=9)


def _cascade_legend() -> list:
    """Keys of the figure of the cascade."""
    foot = dict(marker="o", ms=9)
    return [
        Patch(fc=_paler(GREEN, 0.8), label="valid cell"),
        Patch(fc=_paler(ORANGE, 0.8), label="invalid cell"),
        Patch(fc=_paler(SKY, 0.8), label="valid for all four feet, 1 = best score\n(the other cells paler)"),
        Line2D([], [], color=BLUE, ls="--", label="nominal stance", **foot),
        Line2D([], [], color=RED, label="chosen stance", **foot),
        Line2D(
            [], [], ls="", label="The robot walks to the right; cells of 0.02 m.\nThe stance is shrunk to let them be seen."
        ),
    ]


def draw_footholds(planned: Planned, path: str | Path) -> None:
    """Footholds of a walk on a map, a panel a cycle: the ground in colours, cells that are no footholds tinted.

    A cell out of a leg's reach is not tinted: reach is the leg's affair, not the cell's.
    """
    corners = _corners(planned, widened=True).reshape(-1, 2)
    low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
    figure, axes, across = _map_figure(len(planned.nominal), float((high - low)[1] / (high - low)[0]))
    for cycle, ax in enumerate(axes):
        image = draw_ground(ax, planned.site.terrain, planned.site.valid, (low[0], high[0], low[1], high[1]))
        _draw_cycle(ax, planned, cycle)
        first, last = cycle == 0, cycle == len(axes) - 1
        label(ax, FORWARD if across or last else "", LEFT if not across or first else "")
        ax.set_title(_cycle_title(planned, cycle, "\n" if across else "; "), fontsize=10)
    bar = figure.colorbar(image, ax=axes, location="bottom", shrink=0.6, aspect=45, pad=0.01)
    bar.set_label(HEIGHT, fontsize=9)
    legend_below(figure, _map_legend(), 3)
    save(figure, path)


def _map_figure(panels: int, aspect: float) -> tuple[Figure, list[Axes], bool]:
    """Figure, axes and whether they stand side by side, for views of height / width = `aspect`."""
    across = aspect > 0.6
    side = (WIDTH - 0.8) / (panels if across else 1)
    tall = (2.3 if across else 2.1) + (1 if across else panels) * (side * aspect + 0.4)
    rows, columns = (1, panels) if across else (panels, 1)
    figure, axes = blank(tall, rows, columns, sharex=True, sharey=True)
    return figure, axes, across


def _corners(planned: Planned, widened: bool) -> np.ndarray:
    """Corners (stance, leg, 4, xy) of the search rectangles in W [m]."""
    box = planned.rectangle
    half = 0.5 * np.array([float(box.length) + widened * float(box.longer), float(box.width)])
    ahead, left = (np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half).T
    c, s = np.cos(float(box.heading)), np.sin(float(box.heading))
    return planned.nominal[..., None, :] + np.stack([c * ahead - s * left, s * ahead + c * left], axis=-1)


def _span(values: np.ndarray, margin: float) -> tuple[float, float]:
    """Limits of an axis [m] that shows all values."""
    return float(values.min() - margin), float(values.max() + margin)


def _draw_cycle(ax: Axes, planned: Planned, cycle: int) -> None:
    """One stance's rectangles (the lengthened ones where they were searched), nominal and chosen footholds."""
    chosen, status = planned.chosen()[cycle], np.asarray(planned.choice.status)[cycle]
    ax.plot(*planned.nominal[cycle][[*RING, RING[0]]].T, color=BLACK, lw=0.8, ls="--")
    _arrow(ax, planned.nominal[cycle].mean(axis=0), float(planned.rectangle.heading))
    for leg, (colour, nominal) in enumerate(zip(LEG_COLOUR, planned.nominal[cycle])):
        for widened in (False, True)[: 1 + int(status[leg] > FootholdStatus.NOMINAL)]:
            corners = _corners(planned, widened)[cycle, leg]
            ax.add_patch(Polygon(corners, fill=False, ec=colour, lw=1.4, ls=":" if widened else "-"))
        ax.plot(*np.stack([nominal, chosen[leg]]).T, color=colour, lw=1.2)
        ax.plot(*nominal, "o", mfc="white", mec=colour, mew=1.4, ms=5)
        ax.plot(*chosen[leg], MARKER[FootholdStatus(int(status[leg]))], color=colour, mec=BLACK, mew=0.8, ms=8)


def _arrow(ax: Axes, start: np.ndarray, heading: float) -> None:
    """The way the robot walks: from `start` (x, y) [m] at a heading [rad]."""
    end = start + 0.12 * np.array([np.cos(heading), np.sin(heading)])
    ax.annotate("", end, start, arrowprops=dict(arrowstyle="-|>", color=BLACK, lw=1.4))


def _cycle_title(planned: Planned, cycle: int, between: str) -> str:
    """How the cycle's footholds were found, and the common offset (ahead, left) [m] where there is one."""
    status, turn = np.asarray(planned.choice.status)[cycle], float(planned.rectangle.heading)
    if status[0] <= FootholdStatus.WIDENED:
        x, y = np.asarray(planned.choice.offset)[cycle, 0]
        ahead, left = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        return f"cycle {cycle + 1}: {FootholdStatus(int(status[0])).name}{between}{_way(ahead, left)}"
    lost = [LEGS[leg] for leg in np.flatnonzero(status == FootholdStatus.NONE)]
    return f"cycle {cycle + 1}: each leg's NEAREST{between}" + (
        f"NONE for {', '.join(lost)}" if lost else "no offset suits all"
    )


def _way(ahead: float, left: float) -> str:
    """An offset (ahead, left) [m] in words."""
    parts = [(ahead, "ahead", "back"), (left, "left", "right")]
    moved = [f"{abs(size):.2f} m {one if size > 0 else other}" for size, one, other in parts if abs(size) > 1e-4]
    return ", ".join(moved) or "all feet at nominal"


def _map_legend() -> list:
    """Keys of the map: legs, statuses, what is drawn round them."""
    kinds = [Line2D([], [], ls="", marker=MARKER[s], color="white", mec=BLACK, label=MEANING[s]) for s in FootholdStatus]
    nominal = Line2D([], [], color=BLACK, lw=0.8, ls="--", marker="o", ms=5, mfc="white", label="nominal stance, heading")
    boxes = [Line2D([], [], color=BLACK, lw=1.4, label="search rectangle")]
    boxes.append(Line2D([], [], color=BLACK, lw=1.4, ls=":", label="lengthened, where searched"))
    invalid = Patch(**INVALID, label="no foothold: steep, rough, near\nan edge or an unseen cell")
    return [*leg_keys(ls="", marker="o"), nominal, *kinds, *boxes, invalid, GROUND_KEYS[1]]
