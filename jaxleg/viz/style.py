"""What the figures share: size, colours that colour-blind readers can tell apart (Okabe and Ito), labels.

Figures are `matplotlib.figure.Figure` objects: no pyplot, no global state. Sizes are in inches; at a width of
8 the text is legible in a README.
"""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxleg.conventions import LEGS
from jaxleg.files import replace_whole

WIDTH = 8.0
BLACK, GREY, PALE = "#000000", "#7f7f7f", "#d9d9d9"
BLUE, SKY, GREEN, ORANGE, RED, PURPLE = "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#CC79A7"

# Contestants of a study: colour and marker tell them apart, so a grey print still does.
CONTESTANT_COLOUR = {
    "traditional": GREY,
    "implied": "#b3b3b3",
    "paper": ORANGE,
    "best_i": SKY,
    "best_ii": BLUE,
    "best": GREEN,
}
CONTESTANT_MARKER = dict(traditional="s", implied="P", paper="D", best_i="^", best_ii="v", best="o")
LEG_COLOUR = (BLUE, RED, SKY, ORANGE)  # LF, RF, LH, RH: left blue, right red, the hind legs paler


def blank(height: float, rows: int = 1, columns: int = 1, **options: Any) -> tuple[Figure, list[Axes]]:
    """A figure of the common width and its axes, row by row; `options` go to `Figure.subplots`."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained", facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, list(axes.ravel())


def label(ax: Axes, x: str, y: str, title: str = "") -> None:
    """Name both axes (with units) and the panel, and take away what carries no information."""
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    ax.set_title(title, fontsize=11)
    ax.tick_params(labelsize=9)
    ax.spines[["top", "right"]].set_visible(False)


def legend_below(figure: Figure, handles: list, columns: int) -> None:
    """One legend for all panels, under them."""
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=9, frameon=False)


def leg_keys(words: str = "{}", **style: Any) -> list[Line2D]:
    """Keys of a legend, one a leg in its colour, whose name `words` holds."""
    return [Line2D([], [], color=colour, label=words.format(leg), **style) for leg, colour in zip(LEGS, LEG_COLOUR)]


def save(figure: Figure, path: str | Path) -> None:
    """Write a PNG. Raises `InputError` as `replace_whole`."""
    replace_whole(path, lambda part: figure.savefig(part, dpi=150, format="png"))
