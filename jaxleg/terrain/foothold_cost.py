"""Cost of a foothold, and of the ground under the four feet. Paper C, (12)-(15).

Each feature is first made a score in [0, 1], 0 = good, by its critical value c: curvature and slope clip(x / c), concavity
(1 + (angle - pi/2) / c) / 2, so that hollow ground is better than level and level better than a bump, and the uphill angle
(1 -+ angle / c) / 2, minus for front feet, which like it uphill, plus for hind feet. A leg's weights are not negative and
sum to 1, so its cost lies in [0, 1]. A seen cell without a feature, a spike or a wall, has the worst score.
**Reading**: the paper gives the weighted sum, not the scores.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import HEADINGS, LEG_END, LEGS, InputError
from jaxleg.settings import setting
from jaxleg.terrain.foothold_features import FootholdFeatures, uphill
from jaxleg.terrain.window import Disc

FEATURES = tuple(f"{name}_{size}" for size in ("small", "large") for name in ("curvature", "slope", "concavity", "uphill"))
HAND = (0.10, 0.15, 0.10, 0.05, 0.20, 0.25, 0.10, 0.05)  # our hand's weights of `FEATURES`; the paper's are lost
Place = tuple[float, float]
Stance = tuple[Place, Place, Place, Place]  # default footholds of the legs (x, y) in B [m]; static
Eight = tuple[float, float, float, float, float, float, float, float]


class FootWeights(NamedTuple):
    """Values of (13); all may be traced."""

    weight: Float[ArrayLike, "leg 8"]  # in the order of `FEATURES`; >= 0, of sum 1 for each leg
    limit: Float[ArrayLike, "4"]  # critical values: curvature, slope [rad], concavity [rad], uphill [rad]


@dataclasses.dataclass(frozen=True)
class FeetSettings:
    """The window round each default foothold that costs are averaged over; static."""

    window: Literal["rectangle", "triangle"] = setting("rectangle", help="the triangle points ahead")
    length: float = setting(0.30, above=0.0, max=2.0, unit="m", help="of the window along the heading")
    width: float = setting(0.12, above=0.0, max=2.0, unit="m", help="across the heading")


@dataclasses.dataclass(frozen=True)
class LegWeights:
    """Weights of the features for each leg, in the order of `FEATURES`, as a table of a TOML file; hand-set by default.

    Raises `InputError` for weights that do not sum to 1.
    """

    LF: Eight = setting(HAND, min=0.0, max=1.0)
    RF: Eight = setting(HAND, min=0.0, max=1.0)
    LH: Eight = setting(HAND, min=0.0, max=1.0)
    RH: Eight = setting(HAND, min=0.0, max=1.0)

    def __post_init__(self) -> None:
        for leg in LEGS:
            total = sum(getattr(self, leg))
            if abs(total - 1.0) > 1e-3:  # as it may be written in a file
                raise InputError(f"{leg}: weights sum to {total:.4g}, but must sum to 1")

    def table(self) -> Float[Array, "leg 8"]:
        """As an array, made to sum to 1 exactly."""
        rows = np.array([getattr(self, leg) for leg in LEGS])
        return jnp.asarray(rows / rows.sum(axis=1, keepdims=True), float)


def foothold_scores(
    features: FootholdFeatures, limit: Float[ArrayLike, "4"], leg: Int[ArrayLike, ""], heading: Float[ArrayLike, ""]
) -> Float[Array, "feature=8 nx ny"]:
    """Scores in [0, 1] of each feature of `FEATURES` for a leg and a heading [rad], 0 = good; NaN where unseen."""
    curvature, slope, hollow, rise = jnp.asarray(limit)
    bump = 0.5 + 0.5 * (features.concavity - 0.5 * jnp.pi) / hollow
    away = 0.5 - 0.5 * jnp.array(LEG_END, features.slope.dtype)[leg] * uphill(features.normal, heading) / rise
    scores = jnp.stack([features.curvature / curvature, features.slope / slope, bump, away], axis=1)
    scores = scores.reshape(len(FEATURES), *features.seen.shape)
    return jnp.where(features.seen[None] & jnp.isnan(scores), 1.0, jnp.clip(scores, 0.0, 1.0))


def foothold_cost(
    features: FootholdFeatures, weights: FootWeights, leg: Int[ArrayLike, ""], heading: Float[ArrayLike, ""]
) -> Float[Array, "nx ny"]:
    """Cost of a foothold on each cell for a leg that travels along any heading [rad, from x to the left]. Paper C, (12).

    In [0, 1]; infinite where a cell is unseen.
    """
    scores = foothold_scores(features, weights.limit, leg, heading)
    cost = jnp.sum(jnp.asarray(weights.weight)[leg][:, None, None] * scores, axis=0)
    return jnp.where(jnp.isnan(cost), jnp.inf, cost)


def feet_cost(
    features: FootholdFeatures, resolution: float, settings: FeetSettings, stance: Stance, weights: FootWeights
) -> Float[Array, "heading nx ny"]:
    """Cost of the ground under the feet for the body's centre on each cell, for each of `HEADINGS`. Paper C, (14), (15).

    The mean over the legs of the mean foothold cost in the window round the leg's default foothold, which turns with the
    heading. Unseen cells are left out; infinite where a leg has none but such cells.
    """

    def cost(leg, turn):
        return foothold_cost(features, weights, leg, 0.25 * jnp.pi * turn.astype(features.slope.dtype))

    return jnp.mean(window_means(cost, resolution, settings, stance), axis=1)


def least_footing(
    valid: Bool[Array, "nx ny"], resolution: float, settings: FeetSettings, stance: Stance
) -> Float[Array, "heading nx ny"]:
    """Share of cells where a foot may stand in the window of the leg that has the fewest, as `feet_cost`'s."""
    share = valid.astype(jnp.result_type(float))
    return jnp.min(window_means(lambda leg, turn: share, resolution, settings, stance), axis=1)


def window_means(
    of: Callable[[Int[Array, ""], Int[Array, ""]], Float[Array, "nx ny"]],
    resolution: float,
    settings: FeetSettings,
    stance: Stance,
) -> Float[Array, "heading leg nx ny"]:
    """Means of a map, given for a leg and a heading's number, over the window round that leg's default foothold.

    For the body's centre on each cell; the finite cells of a window count, infinite where it has none.
    """
    cells, used = _table(settings, stance, resolution)
    reach = int(np.abs(cells).max())

    def under(turn, leg):
        values = of(leg, turn)
        padded = jnp.pad(values, reach, constant_values=jnp.inf)
        return _mean(padded, reach + jnp.array(cells)[turn, leg], jnp.array(used)[turn, leg], values.shape)

    legs = jnp.arange(len(LEGS))
    return jax.lax.map(lambda turn: jax.lax.map(lambda leg: under(turn, leg), legs), jnp.arange(len(HEADINGS)))


def _mean(padded, corners, used, shape):
    """Mean of the finite costs at the used corners of a window, infinite without any."""

    @jax.checkpoint
    def visit(total, corner_and_used):
        cost = jax.lax.dynamic_slice(padded, corner_and_used[0], shape)
        here = jnp.isfinite(cost) & corner_and_used[1]
        return (total[0] + here.astype(cost.dtype), total[1] + jnp.where(here, cost, 0.0)), None

    zeros = jnp.zeros(shape, padded.dtype)
    (count, total), _ = jax.lax.scan(visit, (zeros, zeros), (corners, used))
    return jnp.where(count > 0, total / jnp.maximum(count, 1.0), jnp.inf)


def windows(settings: FeetSettings, stance: Stance, resolution: float) -> list[list[Disc]]:
    """Cells (i, j) of the window of each heading and leg, relative to the body's centre: [heading][leg]; static."""
    turns = [0.25 * math.pi * k for k in range(len(HEADINGS))]
    return [[_window(settings, place, turn, resolution) for place in stance] for turn in turns]


def _window(settings: FeetSettings, place: Place, heading: float, resolution: float) -> Disc:
    """Cells whose centres lie in the window round a default foothold that turned with the heading; the nearest if none does."""
    turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
    middle = turn @ np.array(place) / resolution
    reach = int(math.hypot(settings.length, settings.width) / resolution) + 1
    cells = np.round(middle).astype(int) + np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    along, across = ((cells - middle) @ turn * resolution).T
    inside = _contains(settings, along, across)
    chosen = cells[inside] if inside.any() else np.round(middle).astype(int)[None]
    return tuple((int(i), int(j)) for i, j in chosen)


def _contains(settings: FeetSettings, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Whether points [m] from the default foothold, the window's centre of area, lie in the window."""
    long, half = settings.length, 0.5 * settings.width + 1e-6
    if settings.window == "rectangle":
        return (np.abs(along) <= 0.5 * long + 1e-6) & (np.abs(across) <= half)
    behind = along + long / 3.0  # from the base, ahead of which lies the tip
    return (behind >= -1e-6) & (np.abs(across) <= half * (1.0 - behind / long) + 1e-6)


def _table(settings: FeetSettings, stance: Stance, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """`windows` as an array (heading, leg, cell, 2) filled up to the largest, and which of its cells count."""
    rows = windows(settings, stance, resolution)
    size = max(len(cells) for row in rows for cells in row)
    used = np.array([[np.arange(size) < len(cells) for cells in row] for row in rows])
    return np.array([[cells + ((0, 0),) * (size - len(cells)) for cells in row] for row in rows]), used
