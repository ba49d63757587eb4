"""A map from above: the ground's height in colours, where no foot may stand, what nobody has seen."""

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Bool
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.image import AxesImage
from matplotlib.patches import Patch

from jaxleg.terrain.heightmap import HeightMap
from jaxleg.viz.style import GREY, PURPLE

HEIGHT = "height of the ground [m]"
EARTH = LinearSegmentedColormap.from_list("earth", ["#7d7a55", "#f7f5e6"]).with_extremes(bad=GREY)  # hides nothing drawn on it
LEAST_RANGE = 0.05  # heights [m] that the colours span at least: level ground has no shades
INVALID = dict(color=PURPLE, alpha=0.45)  # a hue of its own: darker would pass for lower ground
GROUND_KEYS = (Patch(**INVALID, label="no foothold"), Patch(color=GREY, label="unseen"))
View = tuple[float, float, float, float]  # left, right, bottom, top in W [m]


def draw_ground(
    ax: Axes, terrain: HeightMap, valid: Bool[ArrayLike, "nx ny"] | None = None, view: View | None = None
) -> AxesImage:
    """The elevation [m] as an image, unseen cells grey; seen cells (nx, ny) that are not `valid` footholds tinted.

    The colours span the heights in `view`, which the axes then show; without it those of the whole map.
    """
    height, place = np.asarray(terrain.elevation), dict(origin="lower", extent=border(terrain), interpolation="nearest")
    low, high = span(heights_in(terrain, view or border(terrain)), LEAST_RANGE)
    image = ax.imshow(np.ma.masked_invalid(height).T, cmap=EARTH, vmin=low, vmax=high, **place)
    if valid is not None:
        tint = np.ma.masked_array(np.ones_like(height), np.asarray(valid) | ~np.isfinite(height))
        ax.imshow(tint.T, cmap=ListedColormap([INVALID["color"]]), alpha=INVALID["alpha"], **place)
    if view is not None:
        ax.set(xlim=view[:2], ylim=view[2:])
    ax.set_aspect("equal")
    return image


def border(terrain: HeightMap) -> View:
    """Outer edges of the outermost cells."""
    size, (x, y) = float(terrain.resolution), np.asarray(terrain.origin, float)
    nx, ny = terrain.elevation.shape
    return x - 0.5 * size, x + (nx - 0.5) * size, y - 0.5 * size, y + (ny - 0.5) * size


def heights_in(terrain: HeightMap, view: View) -> np.ndarray:
    """Heights [m] of the cells in a view that have been seen, as a list."""
    size, origin = float(terrain.resolution), np.asarray(terrain.origin, float)
    cells = (origin[axis] + size * np.arange(terrain.elevation.shape[axis]) for axis in (0, 1))
    near = (abs(x - 0.5 * (low + high)) < 0.5 * (high - low + size) for x, low, high in zip(cells, view[::2], view[1::2]))
    heights = np.asarray(terrain.elevation)[np.ix_(*near)]
    return heights[np.isfinite(heights)]


def span(values: np.ndarray, least: float) -> tuple[float, float]:
    """Least and greatest of a list of values, at least so much apart that colours have something to spread over."""
    low = float(values.min()) if values.size else 0.0
    return low, max(float(values.max(initial=low)), low + least)


def colour_bar(ax: Axes, image: AxesImage, words: str = HEIGHT) -> None:
    """What an image's colours mean, as high as the map."""
    bar = ax.figure.colorbar(image, cax=ax.inset_axes((1.02, 0.0, 0.02, 1.0)))
    bar.set_label(words, fontsize=9)
    bar.ax.tick_params(labelsize=8)
