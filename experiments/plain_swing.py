"""Paper B's machine as printed, as one would write it in Python for one terrain: SciPy's spline, sampling and bisection."""

import math

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

SAMPLES = 2001  # along a path, to bracket a contact
SKIN = 1e-9


def plain_swing(
    heights: np.ndarray,
    high: float = 7.5,
    low: float = 0.0,
    share: float = 0.3,
    back: float = 0.5,
    w: float = 1.0,
    limit: int = 3,
) -> tuple[str, float, float, int]:
    """Exit, x at the end, length of the path and adjustments of a swing from (0, 3) to (8, 3), in the words of the paper."""
    terrain = CubicSpline(np.arange(len(heights)), heights, bc_type="natural")
    point, length, adjustments = np.array([0.0, 3.0 + SKIN]), 0.0, 0
    pieces = [(8.0, share * (high - point[1]), 0.0, 1.0)]
    while True:
        for piece in pieces:
            point, slope, way = run(piece, point, terrain)
            length += way
            if slope is not None:
                break
        inside, steep = abs(point[0] - 8.0) <= w * (1 + 1e-6), slope is not None and abs(slope) > 1.0
        if inside and slope is not None and not steep:
            return "supported", point[0], length, adjustments
        if adjustments == limit:
            back_way = [(0.0, high - point[1], 0.0, 0.5), (2 * (0.0 - point[0]), high - 3.0 - SKIN, 0.5, 1.0)]
            return "returned", 0.0, length + sum(way_of(piece) for piece in back_way), adjustments
        adjustments += 1
        up = share * (high - point[1])
        if inside and slope is None:  # case 1
            pieces = [(0.0, point[1] - low, 0.5, 1.0)]
        elif inside:  # case 2: F_x < 0 on rising ground
            corner = 8.0 - w if slope > 0 else 8.0 + w
            pieces = [(2 * (corner - point[0]), point[1] - low, 0.5, 1.0)]
        elif not steep:  # case 3
            pieces = [(8.0 - point[0], up, 0.0, 1.0)]
        else:  # case 4
            pieces = [(-back, 0.0, 0.0, 1.0), (2 * back, up, 0.0, 0.5), (2 * (8.0 - point[0]), point[1] + up - 3.0, 0.5, 1.0)]


def run(piece, point, terrain):
    """Where a path ends, the terrain's slope if by contact, and the way to there."""
    s = np.linspace(piece[2], piece[3], SAMPLES)
    at = path(piece, point, s)
    below = np.flatnonzero(at[1] - ground(terrain, at[0]) < 0)
    if not below.size:
        return at[:, -1], None, way_of(piece)
    first = below[0]
    if first == 0:
        hit = s[0]
    else:
        gap = lambda u: float(path(piece, point, u)[1] - ground(terrain, path(piece, point, u)[0]))  # noqa: E731
        hit = brentq(gap, s[first - 1], s[first], xtol=1e-13)
    end = path(piece, point, hit)
    slope = float(terrain(end[0], 1)) if 0.0 <= end[0] <= 14.0 else 0.0
    return end + np.array([0.0, SKIN]), slope, way_of((*piece[:3], hit))


def ground(terrain, x):
    """Height of the terrain, level beyond its ends."""
    return terrain(np.clip(x, 0.0, 14.0))


def path(piece, point, s):
    """Points of a piece of a compound cycloid at shares s of its period."""
    stride, rise, begin, _ = piece
    advance = lambda u: u - np.sin(2 * math.pi * u) / (2 * math.pi)  # noqa: E731
    lift = lambda u: 0.5 - 0.5 * np.cos(2 * math.pi * u)  # noqa: E731
    return np.array([point[0] + stride * (advance(s) - advance(begin)), point[1] + rise * (lift(s) - lift(begin))])


def way_of(piece):
    """Length of a piece's path."""
    s = np.linspace(piece[2], piece[3], SAMPLES)
    at = path(piece, np.zeros(2), s)
    return float(np.hypot(*np.diff(at)).sum())
