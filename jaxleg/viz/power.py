"""Power and currents against time. Paper A, Fig. 2, 5 and 10."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxleg.conventions import JOINTS, LEGS
from jaxleg.viz.style import BLACK, BLUE, CONTESTANT_COLOUR, GREEN, LEG_COLOUR, ORANGE, PALE, RED, blank, label, save

SMOOTH = 0.5  # window of the thick lines [s]
POINTS = 4000  # drawn at most along a line
COLOURS = CONTESTANT_COLOUR | {"ours": GREEN, "implied": BLACK}
LINES = {"implied": (0, (3, 2))}  # drawn over the paper's own, which it hardly leaves on stairs
JOINT_COLOUR = dict(zip(JOINTS, (ORANGE, BLUE, RED)))


def draw_power(time: np.ndarray, power: Mapping[str, np.ndarray], stand: float, title: str, path: str | Path) -> None:
    """Power [W] of each contestant against time [s] (contestant, t): thin as it is, thick as its mean over half a second.

    The first `stand` seconds are shaded: all feet on the ground, waiting for the map.
    """
    figure, (ax,) = blank(4.0)
    for t, (name, values) in zip(time, power.items()):
        style = dict(color=COLOURS[name], ls=LINES.get(name, "-"), zorder=3 if name in LINES else 2)
        walking = values[t > stand] @ np.diff(t, prepend=0.0)[t > stand] / (t[-1] - stand)
        ax.plot(*_thinned(t, values), color=COLOURS[name], lw=0.5, alpha=0.35)
        ax.plot(*_thinned(t, smoothed(t, values)), **style, lw=1.8, label=f"{name}, walking {walking:.1f} W")
    if stand:
        ax.axvspan(0.0, stand, color=PALE, alpha=0.6, lw=0, label="standing, waiting for the map")
    top = max(np.percentile(values, 99.5) for values in power.values())
    ax.set(xlim=(0.0, float(time.max())), ylim=(0.0, 1.35 * top))
    label(ax, "time [s]", "power of the motors [W]", title)
    ax.legend(fontsize=8, ncols=3, frameon=False, loc="upper center")
    save(figure, path)


def draw_currents(time: np.ndarray, current: np.ndarray, swings: np.ndarray, leg: int, path: str | Path) -> None:
    """Currents [A] (t, leg, joint) against time [s]: one leg's joints above, every leg's total below. Paper A, Fig. 2.

    `swings` (t, leg) says who is in the air; those times are marked in the leg's colour.
    """
    figure, axes = blank(5.6, rows=2, sharex=True)
    for j, joint in enumerate(JOINTS):
        mean = _mean(time, current[:, leg, j])
        axes[0].plot(
            *_thinned(time, current[:, leg, j]), color=JOINT_COLOUR[joint], lw=1.2, label=f"{joint}, mean {mean:.2f} A"
        )
    label(axes[0], "", "current [A]", f"joints of {LEGS[leg]}")
    for i, name in enumerate(LEGS):
        total = current[:, i].sum(axis=-1)
        axes[1].plot(*_thinned(time, total), color=LEG_COLOUR[i], lw=1.2, label=name)
        axes[1].fill_between(time, 0.0, 1.0, where=swings[:, i], color=LEG_COLOUR[i], alpha=0.3, lw=0)
    label(axes[1], "time [s]", "sum of the leg's currents [A]", "all legs; shaded up to 1 A: the leg swings")
    for ax in axes:
        ax.set(xlim=(0.0, time[-1]), ylim=(0.0, 1.25 * ax.get_ylim()[1]))
        ax.legend(fontsize=8, ncols=4, frameon=False, loc="upper right")
    save(figure, path)


def draw_up_down(time: np.ndarray, height: np.ndarray, current: np.ndarray, path: str | Path) -> None:
    """Currents [A] (t, joint) of one leg against time [s] and against the hip's height [m]. Paper A, Fig. 5."""
    figure, axes = blank(3.8, columns=2, sharey=True)
    for j, joint in enumerate(JOINTS):
        axes[0].plot(*_thinned(time, current[:, j]), color=JOINT_COLOUR[joint], lw=1.2, label=joint)
        axes[1].plot(*_thinned(height, current[:, j]), color=JOINT_COLOUR[joint], lw=1.2)
    right = axes[0].twinx()
    right.plot(*_thinned(time, height), color="black", lw=0.8, ls=(0, (4, 2)))
    right.set(ylim=(0.0, 1.6 * height.max()), yticks=[])
    axes[0].plot([], [], color="black", lw=0.8, ls=(0, (4, 2)), label="height, see right")
    axes[0].set_ylim(0.0, 1.25 * current.max())
    axes[0].legend(fontsize=8, frameon=False, ncols=4, loc="upper center", handlelength=1.2, columnspacing=1.2)
    label(axes[0], "time [s]", "current [A]", "up and down, three times")
    label(axes[1], "hip above foot [m]", "", "the same against height")
    right.spines[["top", "right"]].set_visible(False)
    save(figure, path)


def smoothed(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean over a window of `SMOOTH` seconds round each time (shorter at the ends)."""
    energy = np.concatenate([[0.0], np.cumsum(values * np.diff(time, prepend=0.0))])
    edges = np.concatenate([[0.0], time])
    low, high = np.clip(time - SMOOTH / 2, 0.0, None), np.clip(time + SMOOTH / 2, None, time[-1])
    return (np.interp(high, edges, energy) - np.interp(low, edges, energy)) / (high - low)


def _mean(time: np.ndarray, values: np.ndarray) -> float:
    return float(np.sum(values * np.diff(time, prepend=0.0)) / time[-1])


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    step = max(1, len(x) // POINTS)
    return x[::step], y[::step]
