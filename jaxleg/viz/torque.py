"""Torque maps of a leg with the workspaces of two gaits. Paper A, Fig. 4."""

from collections.abc import Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from jaxleg.conventions import GRAVITY
from jaxleg.gait.limits import leg_length
from jaxleg.leg.statics import knee_zero_line, torque_map
from jaxleg.leg.workspace import Workspace
from jaxleg.robot import Robot
from jaxleg.viz.style import BLACK, GREEN, RED, blank, label, legend_below, save

PAPER = Workspace(-0.20, 0.0, 0.48, 0.52)  # torque-saving workspace of paper A [m] (A5)
DOTTED = (0, (1, 1))
CELLS = (421, 301)
NO_THIGH, NO_KNEE = dict(color=BLACK, lw=1.6), dict(color=BLACK, lw=1.6, ls=(0, (5, 2)))
LEAST_KEYS = (Line2D([], [], **NO_THIGH, label="no thigh torque"), Line2D([], [], **NO_KNEE, label="no knee torque"))
STEP = 5.0  # between filled levels [N m]


def torque_maps(robot: Robot, before: dict[str, float], after: dict[str, float], path: str | Path) -> None:
    """Absolute thigh and knee torque and their sum [N m] over the foot's place under a quarter weight.

    `before` and `after` hold workspace.high, foot_offset and step_length [m]: the foot sweeps foot_offset +-
    step_length / 2. The axes span L_F2H within 7/12 of the leg's length and H_COG from a third of it up.
    """
    leg, force = float(leg_length(robot)), float(robot.mass) * GRAVITY / 4.0
    x, h = np.linspace(-7 / 12, 7 / 12, CELLS[0]) * leg, np.linspace(1 / 3, 1.0, CELLS[1]) * leg
    figure, axes = blank(4.3, columns=3, sharey=True)
    filled = fill(axes, robot, x, h, force)
    figure.colorbar(filled, ax=axes, shrink=0.9, pad=0.01).set_label(f"torque under {force:.1f} N [N m]")
    for ax in axes:
        ax.text(0.03, 0.97, "out of\nreach", transform=ax.transAxes, va="top", fontsize=8, color=BLACK)
        least_lines(ax, robot, h)
        _workspaces(ax, before, after)
        ax.set(xlim=(x[0], x[-1]), ylim=(h[0], h[-1] + 0.01))
    axes[0].set_ylabel("hip above foot, H_COG [m]")
    legend_below(figure, _legend(), 3)
    save(figure, path)


def fill(row: Sequence[Axes], robot: Robot, x: np.ndarray, h: np.ndarray, force: float) -> ContourSet:
    """Map |thigh|, |knee| and their sum [N m] under `force` [N] over the foot's place; the last one's colours serve for all."""
    torque = torque_map(robot, jnp.asarray(x, float), jnp.asarray(h, float), force)
    thigh, knee = (np.where(torque.reachable, np.abs(t), np.nan) for t in (torque.thigh, torque.knee))
    levels = np.arange(0.0, np.nanmax(thigh + knee) + STEP, STEP)
    for ax, name, values in zip(row, ("|thigh torque|", "|knee torque|", "sum of both"), (thigh, knee, thigh + knee)):
        filled = ax.contourf(x, h, values.T, levels, cmap="Blues")
        label(ax, "foot ahead of hip, L_F2H [m]", "", name)
    return filled


def least_lines(ax: Axes, robot: Robot, h: np.ndarray) -> None:
    """No thigh torque (solid) and no knee torque (dashed) over the heights `h` [m]."""
    ax.axvline(0.0, **NO_THIGH)
    ax.plot(np.asarray(knee_zero_line(robot, jnp.asarray(h, float))), h, **NO_KNEE)


def outline(ax: Axes, workspace: Workspace, **style) -> None:
    """A workspace as a rectangle."""
    x, y = float(workspace.behind), float(workspace.low)
    size = float(workspace.ahead) - x, float(workspace.high) - y
    ax.add_patch(Rectangle((x, y), *size, zorder=4, **style))


def _workspaces(ax: Axes, before: dict[str, float], after: dict[str, float]) -> None:
    outline(ax, PAPER, fill=False, ls=DOTTED, lw=1.6)
    for gait, colour in ((before, RED), (after, GREEN)):
        ends = gait["foot_offset"] + 0.5 * gait["step_length"] * np.array([-1.0, 1.0])
        for width, ink in ((7.0, "white"), (4.5, colour)):
            ax.plot(ends, [gait["workspace.high"]] * 2, color=ink, lw=width, solid_capstyle="butt", zorder=5)


def _legend() -> list:
    return [
        *LEAST_KEYS,
        Line2D([], [], color=RED, lw=4.5, label="foot's sweep, traditional gait"),
        Line2D([], [], color=GREEN, lw=4.5, label="foot's sweep, best gait found"),
        Patch(fill=False, ls=DOTTED, lw=1.6, label="paper A's workspace"),
    ]
