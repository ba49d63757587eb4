"""What the contestants of a study need: energy per metre and savings."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxleg.leg.energy import CONVENTIONS
from jaxleg.viz.style import BLACK, CONTESTANT_COLOUR, PALE, blank, label, legend_below, save
from jaxleg.viz.terminal import NAMES

OTHER_MARKER = {"net": "<", "positive": "d", "absolute": ">"}
OTHER_STYLE = dict(color="white", mec="#404040", mew=0.8, ms=5, ls="")
TEXT_LEFT = 0.56  # part of the axis left of a text that is written behind a bar


def energy(result: Mapping[str, Any], path: str | Path) -> None:
    """Energy per metre [J/m] of every contestant on each kind of terrain, with 95 % intervals and savings.

    `result` is the content of `result.json`. Bars stand for the convention the search minimised, markers for
    the others. Lanes that failed (infeasible or fallen) are counted beside the bar; its mean leaves them out.
    """
    kinds = list(result["bounds"])
    figure, axes = blank(4.6, columns=len(kinds), sharey=True)
    for ax, kind in zip(axes, kinds):
        ends = [_energy_row(ax, y, result, name, kind) for y, name in enumerate(NAMES)]
        ax.set_xlim(0.0, max(1.0, *ends))
        number = result["terrains"]["by_kind"]["held_out"][kind]
        label(ax, "energy [J/m]", "", f"{kind}, {number} terrain{'s' if number > 1 else ', no interval'}")
        ax.tick_params(axis="y", length=0)
    axes[0].set_yticks(range(len(NAMES)), NAMES.values())
    axes[0].invert_yaxis()
    legend_below(figure, _energy_legend(result["power"]), 3)
    save(figure, path)


def _energy_row(ax: Axes, y: int, result: Mapping[str, Any], name: str, kind: str) -> float:
    """Draw one contestant; returns where the axis must end for its text to fit [J/m]."""
    row, power = result[name][kind]["energy_per_metre"], result["power"]
    mean = row[power]["mean"]
    if mean is None:
        why = "all failed" if result[name][kind]["falls"] else "infeasible"
        ax.text(0.03, y, why, transform=ax.get_yaxis_transform(), va="center", fontsize=9)
        return 0.0
    low, high = row[power]["ci95"] or (mean, mean)  # a single terrain has no interval
    reach = [[max(mean - low, 0.0)], [max(high - mean, 0.0)]]  # rounding may put equal lanes outside
    ax.barh(y, mean, height=0.72, color=CONTESTANT_COLOUR[name], xerr=reach if row[power]["ci95"] else None, capsize=3)
    for convention in CONVENTIONS:
        if convention != power:
            ax.plot(row[convention]["mean"], y, OTHER_MARKER[convention], **OTHER_STYLE)
    end = max(high, *(row[convention]["mean"] for convention in CONVENTIONS))
    text = _energy_text(result, name, kind)
    ax.annotate(text, (end, y), xytext=(7, 0), textcoords="offset points", va="center", fontsize=8)
    return end / (TEXT_LEFT if text else 0.95)


def _energy_text(result: Mapping[str, Any], name: str, kind: str) -> str:
    """The saving against the traditional gait with its 95 % interval, and the number of failed lanes."""
    row, lines = result[name][kind], []
    saved = result["saving"]["simulation"].get(name, {}).get(kind, {}).get(result["power"])
    if saved and saved["mean"] is not None:
        lines = [f"saves {100.0 * saved['mean']:.1f} %"]
        if saved["ci95"] is not None:
            low, high = (100.0 * x for x in saved["ci95"])
            lines += [f"({low:.1f} to {high:.1f})"]
    lost = row["falls"] + row["infeasible"]
    return "\n".join(lines + [f"{lost} of {row['lanes']} failed"] * bool(lost))


def _energy_legend(power: str) -> list:
    others = [convention for convention in CONVENTIONS if convention != power]
    return [
        Patch(facecolor=PALE, label=f"{power} power (minimised)"),
        Line2D([], [], color=BLACK, marker="|", ms=8, label="95 % interval"),
        *(Line2D([], [], marker=OTHER_MARKER[c], label=f"{c} power", **OTHER_STYLE) for c in others),
        Line2D([], [], ls="", label="saves: against the traditional gait (95 % interval)"),
    ]
