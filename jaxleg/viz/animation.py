"""A walk as a film: from above over the map, and from the side in a window that goes with the robot."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from PIL import Image

from jaxleg.conventions import LEFT_LEGS, RIGHT_LEGS, InputError
from jaxleg.files import check_writable, replace_whole
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.terrain.heightmap import HeightMap, heights
from jaxleg.viz.gait import GROUND_LEFT, GROUND_RIGHT, postures
from jaxleg.viz.ground import border, colour_bar, draw_ground
from jaxleg.viz.navigation import PATH, end_style
from jaxleg.viz.style import BLACK, LEG_COLOUR, WIDTH, blank, label, leg_keys, legend_below

DPI = 100
VIEW = WIDTH - 1.5  # width of the panels [inches]
HIGHEST = 4.0  # of either panel [inches]
AROUND = 0.7  # shown round the walk from above [m]
WINDOW = 1.1  # least shown ahead of and behind the trunk's centre from the side [m]
HEADROOM = 0.08  # above and below all that is seen from the side [m]
LEAST_FOOT = 5.0  # diameter of a foot from the side [points]
PROFILE = 241  # points of the ground from the side
COLOURS = 256  # of the film: with one palette for all frames flat areas do not flicker
NEARLY = 249  # above this a channel is set to 255: the palette's averages leave white a little grey
TRUNK = dict(facecolor="#c8c8c8", edgecolor=BLACK, lw=1.2, alpha=0.7)
FOOT = dict(marker="o", markevery=[-1])  # at the end of a leg's line
TRACK = dict(color=BLACK, lw=1.2)
DECK = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])  # corners of the trunk, along two of its axes


Moving = tuple[Artist, Callable[[int], object]]  # what moves, and what moves it to a frame


class Film(NamedTuple):
    """What is drawn of every frame [m]: in W, and along the heading from the trunk's centre where the name says side."""

    track: np.ndarray  # (frame, xy) centre of the trunk
    chain: np.ndarray  # (frame, leg, hip roll - thigh - knee - foot, xy)
    deck: np.ndarray  # (frame, corner, xy) outline of the trunk
    side_chain: np.ndarray  # (frame, leg, joint, along and z)
    side_deck: np.ndarray  # (frame, corner, along and z)
    side_ground: np.ndarray  # (frame, left - right, point) height of the ground under the feet
    along: np.ndarray  # (point,) where that is


def animate(
    path: str | Path,
    terrain: HeightMap,
    q: np.ndarray,
    robot: Robot,
    seconds_a_frame: float,
    *,
    speed: float = 1.0,
    route: np.ndarray | None = None,
    goal: np.ndarray | None = None,
) -> None:
    """Write a walk as a GIF that starts again at its end, `speed` times as fast as it was.

    `q` (frame, 19): trunk position in W [m], quaternion w x y z, joint angles leg by leg [rad], `seconds_a_frame` apart.
    `route` (n, xy) and `goal` (xy) in W [m] are drawn from above. Raises `InputError` for a path that does not end in .gif or
    cannot be written, ValueError for a `q` that is not finite or of another shape.
    """
    _prepare(path)
    q = np.asarray(q, float)
    if q.ndim != 2 or q.shape[1] != 19 or not len(q) or not np.isfinite(q).all():
        raise ValueError(f"q of shape {q.shape} must be (frame, 19), at least one frame, and finite")
    stage = Stage(film(terrain, q, robot), terrain, float(robot.contact_radius), route, goal)
    pace = "" if speed == 1.0 else f", {speed:g} times as fast"
    frames = (stage.shot(k, f"{k * seconds_a_frame:.1f} s{pace}") for k in range(len(q)))
    _write(path, frames, 1000.0 * seconds_a_frame / speed)


def film(terrain: HeightMap, q: np.ndarray, robot: Robot) -> Film:
    """What is to be drawn of the configurations `q` (frame, 19)."""
    centre, quaternion = q[:, :3], jnp.asarray(q[:, 3:7], float)
    turn = np.asarray(jax.vmap(rotation_from_quaternion)(quaternion))
    joints = jnp.asarray(q[:, 7:].reshape(-1, 4, 3), float)
    chain = np.asarray(postures(robot, joints, jnp.asarray(centre, float), quaternion)[0], float)
    yaw = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    length, width, height = 0.5 * np.asarray(robot.trunk_size)
    deck = centre[:, None] + DECK @ np.stack([length * turn[:, :, 0], width * turn[:, :, 1]], axis=1)
    side = centre[:, None] + DECK @ np.stack([length * turn[:, :, 0], height * turn[:, :, 2]], axis=1)
    seen = [_from_side(points, centre, ahead) for points in (chain.reshape(len(q), -1, 3), side)]
    chains = seen[0].reshape(*chain.shape[:3], 2)
    along = _window(np.concatenate(seen, axis=1)[..., 1])
    ground = _ground(terrain, chain[:, :, -1, :2], centre[:, :2], ahead, along)
    return Film(centre[:, :2], chain[..., :2], deck[..., :2], chains, seen[1], ground, along)


def _from_side(points: np.ndarray, centre: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Points (frame, n, xyz) in W as (frame, n, along and z); `ahead` (frame, xy) are unit vectors of the headings."""
    along = np.sum((points[..., :2] - centre[:, None, :2]) * ahead[:, None], axis=-1)
    return np.stack([along, points[..., 2]], axis=-1)


def _window(z: np.ndarray) -> np.ndarray:
    """Points along the heading that fill the panel's width where heights `z` [m] must fit into it."""
    rise = np.ptp(z) + 2.0 * HEADROOM
    half = max(WINDOW, 0.5 * VIEW * rise / HIGHEST)
    return np.linspace(-half, half, PROFILE)


def _ground(terrain: HeightMap, feet: np.ndarray, centre: np.ndarray, ahead: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Heights (frame, left - right, point) of the ground under the feet (frame, leg, xy) of either side.

    The line goes through the hind and the front foot, which therefore stand on what is drawn, and on along the heading.
    """
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    away = feet - centre[:, None]
    x, y = (np.sum(away * axis[:, None], axis=-1) for axis in (ahead, left))
    aside = [[np.interp(along, x[k, legs[::-1]], y[k, legs[::-1]]) for legs in (LEFT_LEGS, RIGHT_LEGS)] for k in range(len(x))]
    points = centre[:, None, None] + along[:, None] * ahead[:, None, None] + np.array(aside)[..., None] * left[:, None, None]
    return np.asarray(heights(terrain, points), float)


class Stage:
    """The figure; what moves is drawn anew over a picture of what does not, which is ten times as fast as all of it."""

    def __init__(self, film: Film, terrain: HeightMap, radius: float, route: np.ndarray | None, goal: np.ndarray | None):
        low, high = _in_view(film, terrain, route, goal)
        bottom, top = _heights_in_view(film)
        scale = [min(VIEW / (high - low)[0], HIGHEST / (high - low)[1]), 0.5 * VIEW / film.along[-1]]  # [inches/m]
        rows = [scale[0] * (high - low)[1], scale[1] * (top - bottom)]
        self.figure, (above, side) = blank(sum(rows) + 1.9, rows=2, height_ratios=rows)
        self.canvas = FigureCanvasAgg(self.figure)
        self.figure.set_dpi(DPI)
        _set_above(above, terrain, low, high, route, goal)
        side.set(xlim=film.along[[0, -1]], ylim=(bottom, top), aspect="equal")
        label(side, "along the heading, from the trunk's centre [m]", "z, up [m]", "from the side")
        box = dict(facecolor="white", alpha=0.8, edgecolor="none", pad=2.0)
        self.caption = above.text(0.01, 0.97, "", transform=above.transAxes, va="top", fontsize=10, bbox=box)
        self.moving = [*_above(above, film), *_side(side, film, max(144.0 * radius * scale[1], LEAST_FOOT))]
        for artist in (self.caption, *(artist for artist, _ in self.moving)):
            artist.set_animated(True)
        keys = _legend(route, goal)
        legend_below(self.figure, keys, -(-len(keys) // 2))
        self.canvas.draw()
        self.still = self.canvas.copy_from_bbox(self.figure.bbox)

    def shot(self, frame: int, caption: str) -> Image.Image:
        """A frame as a picture."""
        self.canvas.restore_region(self.still)
        for artist, move in self.moving:
            move(frame)
            self.figure.draw_artist(artist)
        self.caption.set_text(caption)
        self.figure.draw_artist(self.caption)
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3])


def _above(ax: Axes, film: Film) -> list[Moving]:
    """What moves in the view from above, in the order of drawing."""
    track = _line(ax, lambda k: film.track[: k + 1].T, **TRACK)
    legs = [_line(ax, lambda k, leg=leg: film.chain[k, leg].T, color=LEG_COLOUR[leg], lw=1.6, ms=4, **FOOT) for leg in range(4)]
    return [track, _deck(ax, film.deck), *legs]


def _side(ax: Axes, film: Film, ms: float) -> list[Moving]:
    """The same in the view from the side, seen from the robot's right; feet of `ms` points."""
    styles = enumerate((GROUND_LEFT, GROUND_RIGHT))
    near, far = (_line(ax, lambda k, s=s: (film.along, film.side_ground[k, s]), **style) for s, style in styles)
    foot = dict(lw=2.2, ms=ms, mew=0) | FOOT
    legs = [_line(ax, lambda k, leg=leg: film.side_chain[k, leg].T, color=LEG_COLOUR[leg], **foot) for leg in range(4)]
    left, right = ([legs[leg] for leg in side] for side in (LEFT_LEGS, RIGHT_LEGS))
    return [far, near, *left, _deck(ax, film.side_deck), *right]


def _line(ax: Axes, points: Callable[[int], Iterable[np.ndarray]], **style) -> Moving:
    (line,) = ax.plot([], [], **style)
    return line, lambda frame: line.set_data(*points(frame))


def _deck(ax: Axes, corners: np.ndarray) -> Moving:
    deck = ax.add_patch(Polygon(np.zeros((4, 2)), **TRUNK))
    return deck, lambda frame: deck.set_xy(corners[frame])


def _in_view(film: Film, terrain: HeightMap, route, goal) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest x, y [m] of the view from above: all that is drawn, and the map round it."""
    drawn = [film.chain.reshape(-1, 2), *(np.reshape(x, (-1, 2)) for x in (route, goal) if x is not None)]
    points = np.concatenate(drawn)
    left, right, bottom, top = border(terrain)
    low, high = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND
    return np.maximum(low, (left, bottom)), np.minimum(high, (right, top))


def _heights_in_view(film: Film) -> tuple[float, float]:
    """Least and greatest z [m] of the view from the side: robot and ground under it, whatever the window shows beyond."""
    z = np.concatenate([x[..., 1].ravel() for x in (film.side_chain, film.side_deck)])
    return float(z.min()) - HEADROOM, float(z.max()) + HEADROOM


def _set_above(ax: Axes, terrain: HeightMap, low: np.ndarray, high: np.ndarray, route, goal) -> None:
    """All that does not move in the view from above."""
    colour_bar(ax, draw_ground(ax, terrain))
    if route is not None:
        ax.plot(*np.asarray(route).T, **PATH)
    if goal is not None:
        ax.plot(*goal, "*", **end_style(13.0))
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    label(ax, "x [m]", "y [m]", "from above")


def _legend(route, goal) -> list[Line2D]:
    keys = [*leg_keys(lw=2.2, marker="o"), Line2D([], [], **TRACK, label="trunk's track")]
    keys += [Line2D([], [], **PATH, label="planned path")] if route is not None else []
    keys += [Line2D([], [], marker="*", label="goal", **end_style(11.0))] if goal is not None else []
    keys += [Line2D([], [], **GROUND_LEFT, label="ground, left feet")]
    return [*keys, Line2D([], [], **GROUND_RIGHT, label="ground, right feet")]


def _prepare(path: str | Path) -> None:
    """What cannot be written is better known before the film is drawn."""
    if Path(path).suffix.lower() != ".gif":
        raise InputError(f"{path}: the film's name must end in .gif")
    check_writable(path)


def _write(path: str | Path, frames: Iterator[Image.Image], milliseconds: float) -> None:
    """Write frames as they come: Pillow's own writer keeps a byte a pixel of them, matplotlib's four."""
    first = next(frames).quantize(COLOURS, Image.Quantize.MEDIANCUT)
    first.putpalette([255 if part > NEARLY else part for part in first.getpalette() or ()])
    rest = (frame.quantize(palette=first, dither=Image.Dither.NONE) for frame in frames)
    how = dict(format="GIF", save_all=True, append_images=rest, duration=max(round(milliseconds), 20), loop=0)
    replace_whole(path, lambda part: first.save(part, **how))
