"""What paper C's planner achieves: a walk over a map (Fig. 14), success against difficulty, a dead end avoided (Fig. 10)."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import PercentFormatter

from jaxleg.conventions import RING
from jaxleg.gait.order import STEP_LEGS
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.viz.ground import GROUND_KEYS, border, colour_bar, draw_ground
from jaxleg.viz.style import BLACK, BLUE, GREEN, GREY, LEG_COLOUR, ORANGE, WIDTH, blank, label, leg_keys, legend_below, save
from jaxleg.walk.feasible import Standing
from jaxleg.walk.navigation import Walked

PATH, TRUNK = dict(color=GREEN, lw=2.2), dict(color=BLACK, lw=1.3)
STANCE, SUPPORT = dict(facecolor="none", edgecolor=BLACK, lw=2.0), dict(facecolor=BLACK, edgecolor="none", alpha=0.25)
STEP = dict(arrowstyle="-|>", color=BLACK, lw=1.8, shrinkA=4, shrinkB=4)
CROSS = dict(marker="X", color=BLACK, mec="white", ms=12, ls="")
FEET = leg_keys("{} foothold", ls="", marker="o", mec="white")
SHARES = {"path": dict(color=ORANGE, marker="s"), "walked": dict(color=BLUE, marker="o")}
MEANING = {"path": "a body path was found", "walked": "walked to the goal"}
VIEW = 0.9  # shown to all sides of a dead end [m]


class Trail(NamedTuple):
    """A walk seen from above, in W [m]."""

    path: np.ndarray  # (n, xy) body path as searched
    trunk: np.ndarray  # (n, xy) centre of the trunk
    feet: np.ndarray  # (stance, leg, xy) footholds, the first stance included
    start: np.ndarray  # (xy)
    goal: np.ndarray
    simulated: bool = True  # the trunk's way; else as planned


class Trials(NamedTuple):
    """Walks tried over maps of one kind of terrain."""

    kind: str
    difficulty: np.ndarray  # (map,) in [0, 1]
    path: np.ndarray  # (map,) whether there is a body path
    walked: np.ndarray  # (map,) whether it was walked to the goal


class Look(NamedTuple):
    """A series of gaits that was searched looking so many steps ahead."""

    ahead: int  # [steps]
    states: Standing  # NumPy arrays (stance, ...): before each step and at the end
    stuck: bool


def trail(
    terrain: HeightMap, walked: Walked, trunk: np.ndarray, start: np.ndarray, goal: np.ndarray, simulated: bool = True
) -> Trail:
    """The trail of one lane's plan and of its trunk (n, xyz...) [m], `simulated` or as planned."""
    cells = np.asarray(walked.path.cells)[: int(walked.path.length)]
    path = np.asarray(terrain.origin) + float(terrain.resolution) * cells
    feet = np.asarray(walked.walk.feet)[: int(walked.choices.count) + 1, :, :2]
    return Trail(path, np.asarray(trunk)[:, :2], feet, np.asarray(start), np.asarray(goal), simulated)


def draw_walk(
    terrain: HeightMap, valid: np.ndarray, walk: Trail, path: str | Path, datum: tuple[float, float] = (0.0, 0.0)
) -> None:
    """Paper C, Fig. 14: body path, trunk and footholds over the elevation; cells (nx, ny) that are not `valid` tinted.

    `datum` (x, y) [m] is what the map counts from, written beside the axes' names.
    """
    left, right, bottom, top = border(terrain)
    wide, high = right - left, top - bottom
    scale = min((WIDTH - 1.5) / wide, WIDTH / high)  # [inches/m]
    figure, (ax,) = blank(scale * high + 1.15)
    colour_bar(ax, draw_ground(ax, terrain, valid))
    ax.plot(*walk.path.T, color="white", lw=3.6)  # on dark ground and on light
    ax.plot(*walk.path.T, **PATH)
    ax.plot(*walk.trunk.T, **TRUNK)
    _draw_feet(ax, walk.feet, ms=3.5)
    ax.plot(*walk.start, "s", **end_style())
    ax.plot(*walk.goal, "*", **end_style(13.0))
    label(ax, *(f"{axis} - {far:.0f} [m]" if far else f"{axis} [m]" for axis, far in zip("xy", datum)))
    legend_below(figure, [*FEET, *_walk_keys(walk.simulated)], 5)
    save(figure, path)


def _draw_feet(ax: Axes, feet: np.ndarray, ms: float) -> None:
    """Footholds (stance, leg, xy...) [m], a colour a leg."""
    for leg, colour in enumerate(LEG_COLOUR):
        ax.plot(*feet[:, leg, :2].T, "o", color=colour, mec="white", mew=0.4, ms=ms)


def end_style(ms: float = 8.0) -> dict:
    """How start and goal are drawn."""
    return dict(color=GREEN, mec=BLACK, mew=0.8, ms=ms, ls="")


def _walk_keys(simulated: bool) -> list:
    return [
        Line2D([], [], **PATH, label="body path, searched"),
        Line2D([], [], **TRUNK, label="trunk, simulated" if simulated else "trunk, planned"),
        Line2D([], [], marker="s", label="start", **end_style()),
        Line2D([], [], marker="*", label="goal", **end_style(11.0)),
        *GROUND_KEYS,
    ]


def wilson(hits: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the 95 % Wilson interval of a share, `hits` of `count` > 0."""
    from scipy.stats import binomtest  # 1 s, which only this picture need pay

    ends = [binomtest(int(h), int(n)).proportion_ci(method="wilson") for h, n in zip(hits, count)]
    return np.array([end.low for end in ends]), np.array([end.high for end in ends])


def draw_success(trials: Sequence[Trials], path: str | Path, bins: int = 5) -> None:
    """Shares of maps with a path and of maps walked against difficulty, with 95 % Wilson intervals; a panel a kind."""
    figure, axes = blank(3.4, columns=len(trials), sharey=True)
    edges = np.linspace(0.0, 1.0, bins + 1)
    for ax, kind in zip(axes, trials):
        _draw_share(ax, kind.difficulty, kind.path, edges, -0.012, **SHARES["path"])
        _draw_share(ax, kind.difficulty, kind.walked, edges, 0.012, **SHARES["walked"])
        ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.03), xticks=edges)
        ax.grid(axis="y", color="#e5e5e5", lw=0.8)
        title = f"{kind.kind}: {len(kind.path)} maps, {int(kind.path.sum())} with a path, {int(kind.walked.sum())} walked"
        label(ax, "difficulty [-]", "", title)
    axes[0].yaxis.set_major_formatter(PercentFormatter(1.0))
    axes[0].set_ylabel("share of all maps [-]")
    keys = [Line2D([], [], ls="", ms=7, label=text, **SHARES[name]) for name, text in MEANING.items()]
    legend_below(figure, [*keys, Line2D([], [], color=GREY, marker="|", ms=9, label="95 % Wilson interval")], 3)
    save(figure, path)


def _draw_share(ax: Axes, difficulty: np.ndarray, hit: np.ndarray, edges: np.ndarray, aside: float, **style) -> None:
    """A point and an interval for every bin that holds maps; `aside` moves them so that two series can be told apart."""
    place = np.clip(np.digitize(difficulty, edges) - 1, 0, len(edges) - 2)
    count, hits = (np.bincount(place, weight, len(edges) - 1) for weight in (None, np.asarray(hit, float)))
    used = count > 0
    middle, share = 0.5 * (edges[1:] + edges[:-1])[used] + aside, (hits / np.maximum(count, 1))[used]
    low, high = wilson(hits[used], count[used])
    reach = np.maximum([share - low, high - share], 0.0)  # rounding may put a share of 0 or 1 outside
    ax.errorbar(middle, share, reach, ls=":", lw=1.0, elinewidth=1.6, capsize=3, ms=6, **style)


def draw_dead_end(terrain: HeightMap, valid: np.ndarray, short: Look, long: Look, path: str | Path) -> None:
    """Paper C, Fig. 10: the series that looks less far ahead ends; the other one goes on over the same ground.

    Shown round the last stance of `short`: footholds, trunk, and in both the stance after as many steps; there a cross on the
    leg that finds no reachable state, or its step and the triangle that supports it.
    """
    centre, steps = short.states.pose[-1, :2], len(short.states.feet) - 1
    figure, axes = blank(4.6, columns=2, sharex=True, sharey=True)
    for ax, look in zip(axes, (short, long)):
        image = draw_ground(ax, terrain, valid)
        _draw_series(ax, look, steps)
        end = f"stuck after step {len(look.states.feet) - 1}" if look.stuck else "goes on"
        label(ax, "x [m]", "y [m]" if look is short else "", f"looking {look.ahead} step{'s'[: look.ahead - 1]} ahead: {end}")
    axes[0].set(xlim=(centre[0] - VIEW, centre[0] + VIEW), ylim=(centre[1] - VIEW, centre[1] + VIEW))
    colour_bar(axes[1], image)
    legend_below(figure, [*FEET, *_series_keys(steps)], 5)
    save(figure, path)


def _draw_series(ax: Axes, look: Look, steps: int) -> None:
    """Every leg's way from foothold to foothold, the trunk's, and what the leg whose turn it is can do after `steps`."""
    feet, leg = look.states.feet[..., :2], STEP_LEGS[steps % len(STEP_LEGS)]
    for way, colour in zip(np.moveaxis(feet, 1, 0), LEG_COLOUR):
        ax.plot(*way.T, color=colour, lw=1.0)
    ax.plot(*look.states.pose[:, :2].T, **TRUNK)
    if steps < len(feet):
        ax.add_patch(Polygon(feet[steps][list(RING)], **STANCE))
    if steps + 1 < len(feet):
        ax.add_patch(Polygon(feet[steps][[foot for foot in RING if foot != leg]], **SUPPORT))
        ax.annotate("", feet[steps + 1, leg], feet[steps, leg], arrowprops=STEP)
    _draw_feet(ax, feet, ms=6.0)
    if look.stuck:
        ax.plot(*feet[-1, STEP_LEGS[(len(feet) - 1) % len(STEP_LEGS)]], **CROSS)


def _series_keys(steps: int) -> list:
    return [
        Line2D([], [], **TRUNK, label="trunk"),
        Patch(**STANCE, label=f"stance after step {steps}"),
        Line2D([], [], **CROSS, label="finds no next state"),
        Patch(**SUPPORT, label="support of the next step"),
        GROUND_KEYS[0],
    ]
