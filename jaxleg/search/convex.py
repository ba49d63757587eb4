"""The lowest point of a convex model with corners in a box: an interior method, its corners rounded less and less.

    minimise  g^T d + d^T B d / 2 + sum over constraints of w fine(max(0, -min_k (c_k + a_k^T d)))   within  low < d < high

Newton's method on the sum of that with every least and every max(0, .) rounded by 3 mu and a logarithmic barrier of weight mu
at the box (Boyd & Vandenberghe, Convex Optimization, chapter 11), mu falling to `ROUGH`. NumPy in double precision: a problem
of tens of numbers that single precision would not solve.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxleg.search.penalty import fine, fine_slopes

ROUGH = 1e-6  # last weight of the barrier, of a baseline's energy
FALL = 0.2  # of the weight from one round to the next
NEWTONS = 12  # most steps a round


class Corners(NamedTuple):
    """Constraints with as many rows each."""

    rows: np.ndarray  # (constraint, row): what is left to each constraint is the least row
    slopes: np.ndarray  # (constraint, row, number)
    weight: np.ndarray  # (constraint,) of each one's penalty


class Problem(NamedTuple):
    """A convex model of the objective over a step d."""

    slope: np.ndarray  # (number,)
    curvature: np.ndarray  # (number, number), positive definite
    corners: Sequence[Corners]

    def value(self, step: np.ndarray) -> float:
        """The model's change by a step, exactly."""
        return self._value(step) - self._value(np.zeros_like(step))

    def _value(self, step):
        least = [np.min(some.rows + some.slopes @ step, axis=1) for some in self.corners]
        fines = sum(some.weight @ fine(np.maximum(-low, 0.0)) for some, low in zip(self.corners, least))
        return self.slope @ step + 0.5 * step @ self.curvature @ step + fines


def lowest(problem: Problem, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step (number,) to the model's lowest point in the box; `low` <= 0 <= `high`, and `low` < `high` in every number."""
    edge = 1e-3 * (high - low)
    step, weight = np.clip(np.zeros_like(low), low + edge, high - edge), 0.1
    while weight > ROUGH:
        step = _centred(problem, low, high, step, weight)
        weight *= FALL
    return step


def _centred(problem, low, high, step, weight):
    """Newton's steps to the lowest point of the rounded model with its barrier."""
    there = _rounded(problem, low, high, step, weight)
    for _ in range(NEWTONS):
        value, slope, curvature = there
        way = -np.linalg.solve(curvature + 1e-12 * np.eye(len(step)), slope)
        gain = -slope @ way
        share = min(1.0, 0.95 * _room(step, way, low, high))
        there = _rounded(problem, low, high, step + share * way, weight)
        while share > 1e-8 and there[0] > value - 1e-4 * share * gain:
            share *= 0.5
            there = _rounded(problem, low, high, step + share * way, weight)
        step = step + share * way
        if gain < 1e-2 * weight:
            break
    return step


def _room(step, way, low, high):
    """The share of a way at which it leaves the box."""
    edge = np.where(way > 0.0, high, low)
    return np.min(np.where(way == 0.0, np.inf, (edge - step) / np.where(way == 0.0, 1.0, way)))


def _rounded(problem, low, high, step, weight):
    """Value, slope and curvature of the rounded model with its barrier."""
    below, above = step - low, high - step
    value = problem.slope @ step + 0.5 * step @ problem.curvature @ step - weight * np.sum(np.log(below * above))
    slope = problem.slope + problem.curvature @ step + weight * (1.0 / above - 1.0 / below)
    curvature = problem.curvature + np.diag(weight * (1.0 / above**2 + 1.0 / below**2))
    for some in problem.corners:
        fines, by_step, bent = _rounded_fines(some, step, max(3.0 * weight, 1e-4))
        value, slope, curvature = value + fines, slope + by_step, curvature + bent
    return value, slope, curvature


def _rounded_fines(corners, step, radius):
    """The penalties of some constraints with their corners rounded, their slope and curvature."""
    rows = corners.rows + corners.slopes @ step
    least = rows.min(axis=1, keepdims=True)
    share = np.exp((least - rows) / radius)
    total = share.sum(axis=1, keepdims=True)
    share = share / total  # of each row in the rounded least's slope
    lack = radius * np.log(total[:, 0]) - least[:, 0]
    root = np.hypot(lack, radius)
    lack, turn, bend = 0.5 * (lack + root), 0.5 * (1.0 + lack / root), 0.5 * radius**2 / root**3  # max(0, lack), rounded
    first, second = (corners.weight * x for x in fine_slopes(lack))
    way = -np.einsum("ck,ckn->cn", share, corners.slopes)
    along, sharp = first * turn, first * turn / radius
    flat = corners.slopes.reshape(-1, len(step))
    bent = flat.T @ ((sharp[:, None] * share).reshape(-1, 1) * flat)
    bent += way.T @ ((second * turn**2 + first * bend - sharp)[:, None] * way)
    return corners.weight @ fine(lack), along @ way, bent
