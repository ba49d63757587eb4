"""Torque maps of both knee branches over the leg's half-plane, and the best workspaces. Paper A, Section III, Fig. 4."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxleg.gait.limits import leg_length
from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.leg.statics import torque_map
from jaxleg.leg.workspace import Workspace, cost
from jaxleg.robot import Robot
from jaxleg.viz.style import BLACK, BLUE, GREEN, GREY, ORANGE, RED, blank, label, legend_below, save
from jaxleg.viz.torque import DOTTED, LEAST_KEYS, fill, least_lines, outline

CELLS = (401, 221)
LIMIT, CLEAR = dict(color=RED, lw=1.4), dict(color=ORANGE, lw=1.4, ls=(0, (4, 1.5, 1, 1.5)))
BEST = (BLUE, ORANGE, RED)  # best workspaces, in the order given
UNIT = {"total": "sum [N m]", "square": "sum of squares [N$^2$ m$^2$]"}


def half_planes(branches: dict[str, Robot], force: float, workspaces: dict[str, Workspace], path: str | Path) -> None:
    """|thigh|, |knee| and their sum [N m] under `force` [N], a row for each branch, all of a leg's reach below the hip.

    `workspaces` holds each branch's own workspace, filled in its map of the sum.
    """
    figure, axes = blank(4.0, rows=len(branches), columns=3, sharex=True, sharey=True)
    for row, (name, robot) in zip(zip(axes[::3], axes[1::3], axes[2::3]), branches.items()):
        filled = _branch(row, robot, force)
        outline(row[2], workspaces[name], fc=GREEN, ec=BLACK, lw=0.8)
        row[0].set_ylabel(f"knee {name}\nH_COG [m]", fontsize=9)
    for ax in axes[:3]:
        ax.set_xlabel("")
    for ax in axes[3:]:
        ax.set_title("")
    figure.colorbar(filled, ax=axes, shrink=0.9, pad=0.01).set_label(f"torque under {force:.1f} N [N m]")
    legend_below(figure, _line_keys(), 3)
    save(figure, path)


def best_workspaces(
    robot: Robot,
    force: float,
    paper: Workspace,
    best: dict[str, dict[str, Workspace]],
    slides: dict[str, np.ndarray],
    bends: tuple[float, ...],
    path: str | Path,
) -> None:
    """Above: where the best workspaces of the paper's size lie, by criterion. Below: its workspace slid along L_F2H.

    `best[criterion][name]` are at most three workspaces; `slides[criterion]` has columns rear end [m] and mean. The
    criteria are the fields of `workspace.Cost`; arcs mark where the knee bends by `bends` [deg].
    """
    figure, axes = blank(6.8, rows=2, columns=2, sharex="row")
    for column, criterion in enumerate(best):
        _zoomed(axes[column], robot, force, criterion, figure)
        _bend_arcs(axes[column], robot, bends)
        for colour, workspace in zip(BEST, best[criterion].values()):
            outline(axes[column], workspace, fill=False, ec=colour, lw=2.2)
        outline(axes[column], paper, fill=False, ec=BLACK, lw=1.8, ls=DOTTED)
        _slid(axes[2 + column], slides[criterion], float(paper.behind))
    axes[0].set_ylabel("hip above foot, H_COG [m]")
    axes[2].set_ylabel("mean over its least [-]")
    names = list(next(iter(best.values())))
    legend_below(figure, _workspace_keys(names), 2)
    save(figure, path)


def _branch(row, robot: Robot, force: float):
    leg = float(leg_length(robot))
    x, h = np.linspace(-leg, leg, CELLS[0]), np.linspace(0.002, 1.0, CELLS[1]) * leg
    filled = fill(row, robot, x, h, force)
    for ax in row:
        _limits(ax, robot, leg)
        ax.set(xlim=(-1.05 * leg, 1.05 * leg), ylim=(0.0, 1.05 * leg), aspect="equal")
        ax.xaxis.label.set_size(9)
    return filled


def _limits(ax: Axes, robot: Robot, leg: float) -> None:
    thigh, shank = -float(robot.link_offset[0, 1, 2]), -float(robot.link_offset[0, 2, 2])
    angle = np.linspace(0.0, np.pi, 181)
    for radius in (leg, abs(thigh - shank)):
        ax.plot(radius * np.cos(angle), radius * np.sin(angle), **LIMIT)
    ax.axhline(thigh, **CLEAR)
    least_lines(ax, robot, np.linspace(max(shank - thigh, 0.0), leg, 200))


def _zoomed(ax: Axes, robot: Robot, force: float, criterion: str, figure: Figure) -> None:
    leg = float(leg_length(robot))
    x, h = np.linspace(-0.6, 0.4, CELLS[0]) * leg, np.linspace(0.68, 1.0, CELLS[1]) * leg
    costs = cost(torque_map(robot, jnp.asarray(x, float), jnp.asarray(h, float), force))
    values = np.asarray(getattr(costs, criterion))
    filled = ax.contourf(x, h, np.where(np.isfinite(values), values, np.nan).T, 14, cmap="Blues")
    figure.colorbar(filled, ax=ax, pad=0.01).ax.tick_params(labelsize=8)
    least_lines(ax, robot, h)
    ax.set(xlim=(x[0], x[-1]), ylim=(h[0], h[-1]))
    ax.locator_params(axis="y", nbins=5)
    label(ax, "foot ahead of hip, L_F2H [m]", "", UNIT[criterion])


def _bend_arcs(ax: Axes, robot: Robot, bends: tuple[float, ...]) -> None:
    x = np.linspace(*ax.get_xlim(), CELLS[0])
    for degrees in bends:
        radius = float(reach_for_bend(robot.link_offset[0], np.deg2rad(degrees)))
        ax.plot(x, np.sqrt(np.maximum(radius**2 - x**2, 0.0)), color=GREY, lw=1.2)
        style = dict(fontsize=8, ha="center", va="center", bbox=dict(fc="white", ec="none", pad=1.0))
        ax.text(0.8 * x[-1], np.sqrt(radius**2 - (0.8 * x[-1]) ** 2), f"{degrees:.0f} deg", **style)


def _slid(ax: Axes, slide: np.ndarray, paper: float) -> None:
    start, ratio = slide[:, 0], slide[:, 1] / slide[:, 1].min()
    here = np.interp(paper, start, ratio)
    ax.axhspan(1.0, 1.05, color=GREEN, alpha=0.25, lw=0)
    ax.plot(start, ratio, color=BLUE, lw=1.8)
    ax.plot(paper, here, marker="*", ms=13, color="white", mec=BLACK)
    middle = start[np.argmin(ratio)]
    ax.annotate(f"paper A: {here:.3f}", (paper, here), (middle, 1.42), fontsize=9, ha="center", arrowprops=dict(arrowstyle="-"))
    ax.set(ylim=(0.97, 1.6), xlim=(start[0], start[-1]))
    label(ax, "rear end of the workspace, L_F2H [m]", "", "slid at the paper's heights")


def _line_keys() -> list:
    return [
        *LEAST_KEYS,
        Line2D([], [], **LIMIT, label="end of reach"),
        Line2D([], [], **CLEAR, label="H_COG = L2, lower the knee may touch"),
        Patch(fc=GREEN, ec=BLACK, lw=0.8, label="paper A's workspace (mirrored below)"),
    ]


def _workspace_keys(names: list[str]) -> list:
    keys = [Patch(fill=False, ec=colour, lw=2.2, label=name) for colour, name in zip(BEST, names)]
    return [
        Patch(fill=False, ec=BLACK, ls=DOTTED, lw=1.8, label="paper A's workspace"),
        *keys,
        *LEAST_KEYS,
        Line2D([], [], color=GREY, lw=1.2, label="constant knee bend"),
        Patch(fc=GREEN, alpha=0.25, label="within 5 % of the least"),
    ]
