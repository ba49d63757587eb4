"""The foothold planner as one would write it in NumPy, for one terrain: arrays over cells, loops over windows and legs."""

import functools
import math

import numpy as np

from jaxleg.foothold.contract import FootholdStatus
from jaxleg.terrain import Grid

LENGTHS, WIDTH, WEIGHT = (0.30, 0.38), 0.08, 0.5


def plain_features(elevation: np.ndarray, resolution: float) -> np.ndarray:
    """Traversability of each cell (Wermelinger's features with the published windows)."""
    seen = np.isfinite(elevation)
    near, z = window(0.05, resolution), np.where(seen, elevation, 0.0)
    here, heights = moved(seen, near, False), moved(elevation, near, np.nan) - z
    heights = np.where(here, heights, 0.0)
    i, j = np.array(near).T.reshape(2, -1, 1, 1)
    count = here.sum(0)
    mean = [np.sum(here * x, 0) / np.maximum(count, 1) for x in (i, j, heights)]
    di, dj, dz = (here * (x - m) for x, m in zip((i, j, heights), mean))
    ii, ij, jj, iz, jz = (np.sum(a * b, 0) for a, b in ((di, di), (di, dj), (dj, dj), (di, dz), (dj, dz)))
    determinant = ii * jj - ij * ij
    fits = (count >= 3) & (determinant > 1e-3)
    determinant = np.where(fits, determinant, 1.0)
    ahead, aside = (jj * iz - ij * jz) / determinant, (ii * jz - ij * iz) / determinant
    residual = np.sum((dz - ahead * di - aside * dj) ** 2, 0)
    slope = np.arctan(np.hypot(ahead, aside) / resolution)
    roughness = np.sqrt(residual / np.maximum(count - 1, 1))
    around = moved(np.where(seen, elevation, np.nan), window(0.04, resolution), np.nan)
    jump = np.where(seen, np.fmax.reduce(around) - np.fmin.reduce(around), np.nan)
    jumps = moved(jump, window(0.04, resolution), np.nan)
    step = np.fmax.reduce(jumps) * np.minimum(1.0, (jumps > 0.12).sum(0) / 4)
    scores = [np.maximum(0.0, 1.0 - x / c) for x, c in ((slope, 1.0), (roughness, 0.05), (step, 0.12))]
    return np.where(seen & fits, sum(scores) / 3.0, np.nan)


def plain_valid(elevation: np.ndarray, resolution: float, foot: float, easy: np.ndarray) -> np.ndarray:
    """Where a foot may stand: `jaxleg.terrain.valid_cells`."""
    padded = np.pad(elevation, 1, mode="edge")
    bad = np.isnan(elevation)
    for other in (padded[2:, 1:-1], padded[:-2, 1:-1], padded[1:-1, 2:], padded[1:-1, :-2]):
        bad = bad | (np.abs(other - elevation) > 0.03)
    slopes = []
    for before, after in (
        (elevation - padded[:-2, 1:-1], padded[2:, 1:-1] - elevation),
        (elevation - padded[1:-1, :-2], padded[1:-1, 2:] - elevation),
    ):
        product = before * after
        total = np.where(product > 0, before + after, 1.0)
        slopes.append(np.where(product > 0, 2.0 * product / total, 0.0 * product))
    gentle = slopes[0] ** 2 + slopes[1] ** 2 <= (math.tan(0.6) * resolution) ** 2
    unclear = moved(bad, window(foot + 0.5 * resolution, resolution), False).any(0)
    near = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if (abs(i), abs(j)) != (2, 2)]
    unclear |= moved(np.isnan(elevation), near, False).any(0)
    return gentle & ~unclear & ~moved(~easy, window(foot, resolution), False).any(0)


def plain_plan(
    nominal: np.ndarray, elevation: np.ndarray, valid: np.ndarray, grid: Grid, limits: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (stance, leg, 2) [m] and statuses (stance, leg) of the cascade along +x."""
    footing = np.pad(np.where(valid, elevation, np.nan), 40, constant_values=np.nan)
    cells, orders = candidates(grid.resolution)
    picks = [stance(feet, footing, grid, limits, cells, orders) for feet in nominal]
    return np.stack([p[0] for p in picks]) * grid.resolution, np.stack([p[1] for p in picks])


def stance(feet, footing, grid, limits, cells, orders):
    """One stance of four feet: offsets in cells and statuses."""
    start = np.round((feet - grid.origin) / grid.resolution).astype(int) + 40
    height = footing[start[:, :1] + cells[:, 0], start[:, 1:] + cells[:, 1]]
    there = np.isfinite(height)
    number = there.sum(1)
    mean = np.where(there, height, 0.0).sum(1) / np.maximum(number, 1)
    level = np.array([np.mean(mean[e][number[e] > 0]) if number[e].any() else np.nan for e in ([0, 1], [2, 3])])[[0, 0, 1, 1]]
    usable = fitting(height, level[:, None], limits)
    common = usable.all(0)
    for order, status in zip(orders[:2], (FootholdStatus.NOMINAL, FootholdStatus.WIDENED)):
        found = common[order]
        if found.any():
            return np.tile(cells[order[found.argmax()]], (4, 1)), np.full(4, status)
    offset, states = np.zeros((4, 2), int), np.full(4, FootholdStatus.NONE)
    for leg in range(4):
        found = usable[leg][orders[2]]
        far = resort(limits[2] / grid.resolution)
        height = footing[start[leg, 0] + far[:, 0], start[leg, 1] + far[:, 1]]
        last = fitting(height, level[leg], limits)
        if found.any() or last.any():
            offset[leg] = cells[orders[2][found.argmax()]] if found.any() else far[last.argmax()]
            states[leg] = FootholdStatus.NEAREST
    return offset, states


def fitting(height, level, limits):
    """Seen, valid and of a height that the leg reaches."""
    above = height - level
    return np.isfinite(height) & ~(above < limits[0]) & ~(above > limits[1])


@functools.cache
def candidates(resolution: float):
    """Cells of the lengthened rectangle, and three orders of preference: short, long, nearest."""
    grid = np.meshgrid(np.arange(-9, 10), np.arange(-2, 3), indexing="ij")
    cells = np.stack(grid, axis=-1).reshape(-1, 2)
    ahead, aside = np.abs(cells * resolution).T
    orders = []
    for length in LENGTHS:
        score = 1 - WEIGHT * (ahead + aside) / (0.5 * (length + WIDTH)) - (1 - WEIGHT) * aside / (0.5 * WIDTH)
        order = np.lexsort((-cells[:, 1], np.abs(cells[:, 1]), -cells[:, 0], -np.round(score, 5)))
        orders.append(order[ahead[order] <= 0.5 * length + 1e-5])
    return cells, (*orders, by_distance(cells))


@functools.cache
def resort(reach: float):
    """Cells within so many cells, the nearest first."""
    n = int(reach + 1e-3)
    cells = np.stack(np.meshgrid(np.arange(-n, n + 1), np.arange(-n, n + 1), indexing="ij"), axis=-1).reshape(-1, 2)
    cells = cells[(cells**2).sum(1) <= (reach + 1e-3) ** 2]
    return cells[by_distance(cells)]


def by_distance(cells):
    """Nearest first; ties forward, then to the centre line, then left."""
    return np.lexsort((-cells[:, 1], np.abs(cells[:, 1]), -cells[:, 0], (cells**2).sum(1)))


@functools.cache
def window(radius: float, resolution: float):
    """Offsets of the cells within a radius [m]."""
    n = int(radius / resolution + 1e-6)
    limit = (radius / resolution + 1e-6) ** 2
    return [(i, j) for i in range(-n, n + 1) for j in range(-n, n + 1) if i * i + j * j <= limit]


def moved(values, offsets, beyond):
    """The map moved by each offset, stacked."""
    n = max(max(abs(i), abs(j)) for i, j in offsets)
    padded = np.pad(values, n, constant_values=beyond)
    nx, ny = values.shape
    return np.stack([padded[n + i : n + i + nx, n + j : n + j + ny] for i, j in offsets])
