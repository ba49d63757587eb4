"""Descents on the proxy from many starts: on few terrains at first, the best of them on more, the last on all.

A search moves numbers of the planner within its bounds; all searches of a study run at once and in lock step, and each may go
on from where one with narrower bounds has come.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.batch import Picked
from jaxleg.search.gauss_newton import Descents, Judged, Runs, begin, judged, on_others
from jaxleg.search.lanes import Lab
from jaxleg.search.training import Lanes, spread

GROWTH = 4  # times as many terrains in each round
EDGE = 1e-9  # of a width: what rounding may put a run beyond its bounds


class Ranges(NamedTuple):
    """Bounds of all searches, and the scale in which a descent sees the numbers: 0 to 1 over the widest of them."""

    low: np.ndarray  # (number,)
    width: np.ndarray  # (number,)
    box: np.ndarray  # (search, number, 2), scaled

    def scaled(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors in widths."""
        return (vectors - self.low) / self.width

    def vectors(self, scaled: np.ndarray) -> np.ndarray:
        """Vectors from their widths, in JAX's precision."""
        return np.asarray(jnp.asarray(self.low + self.width * scaled, float))


def ranges(bounds: np.ndarray) -> Ranges:
    """The ranges of searches with these bounds (search, number, 2)."""
    low, high = bounds[..., 0].min(axis=0), bounds[..., 1].max(axis=0)
    width = np.where(high > low, high - low, 1.0)
    return Ranges(low, width, (bounds - low[:, None]) / width[:, None])


def rounds(terrains: int, first: int, starts: int) -> list[tuple[int, int]]:
    """Terrains and starts of each round, two at least: more of the ones, fewer of the others; the last sees all terrains. Where
    the first does already, all starts go on."""
    sizes = [min(first, terrains)]
    while sizes[-1] < terrains:
        sizes.append(min(GROWTH * sizes[-1], terrains))
    return (
        [(size, max(1, starts >> number)) for number, size in enumerate(sizes)] if len(sizes) > 1 else [(terrains, starts)] * 2
    )


def starts_of(key: jax.Array, known: np.ndarray, span: Ranges, starts: int) -> np.ndarray:
    """Where all runs begin (search by search): at what is known, as far as bounds and `starts` allow, then at random."""
    searches, numbers = span.box.shape[:2]
    drawn = np.array(jax.random.uniform(key, (searches, starts, numbers)), float)
    low, high = span.box[:, None, :, 0], span.box[:, None, :, 1]
    points = low + (high - low) * drawn
    count = min(starts, len(known))
    points[:, :count] = np.clip(span.scaled(known[:count]), low, high)
    return points.reshape(searches * starts, numbers)


def promoted(runs: Runs, box: np.ndarray, kept: int) -> Runs:
    """The best `kept` runs of each search (box (search, number, 2)) go on."""
    return on_others(runs, promoted_index(runs, box, kept))


def promoted_index(runs: Runs, box: np.ndarray, kept: int) -> np.ndarray:
    """Numbers of the best `kept` runs of each search, and of those before it that stand within its bounds."""
    each, best = len(runs.at) // len(box), []
    for search, (low, high) in enumerate(np.moveaxis(box, -1, 1)):
        within = np.all((runs.at >= low - EDGE) & (runs.at <= high + EDGE), axis=1)
        within[(search + 1) * each :] = False
        best.append(np.lexsort((runs.value, ~within))[:kept])
    return np.concatenate(best)


class Keep:
    """Where a search keeps what it has, and tells of it; here nowhere."""

    def load(self, number: int, like: Runs) -> Runs | None:
        """Where round `number` stands, if it was begun before."""

    def save(self, number: int, runs: Runs) -> None:
        """Keep where a round stands."""

    def report(self, number: int, terrains: int, runs: Runs) -> None:
        """Tell of a round's step."""


NOWHERE = Keep()


def searched(
    lab: Lab, lanes: Lanes, span: Ranges, points: np.ndarray, plan: list[tuple[int, int]], steps: int, keep: Keep = NOWHERE
) -> tuple[np.ndarray, np.ndarray]:
    """The best vector (search, number) of each search and its objective (search,), from points (run, number) in widths.

    `plan` is that of `rounds`, `steps` the most of a round.
    """
    runs = begin(points)
    for number, (terrains, starts) in enumerate(plan):
        if number:
            runs = promoted(runs, span.box, starts)
        until = int(runs.steps) + steps
        runs = descend(lab, spread(lanes, terrains), span, keep.load(number, runs) or runs, until, (number, keep))
    best = promoted_index(runs, span.box, 1)
    return span.vectors(runs.at[best]), runs.value[best]


def descend(lab: Lab, lanes: Lanes, span: Ranges, runs: Runs, until: int, kept: tuple[int, Keep]) -> Runs:
    """All runs (search by search) on these lanes until none gains any more, or so many steps are done."""
    number, keep = kept
    descents = Descents(runs, np.repeat(span.box, len(runs.at) // len(span.box), axis=0))
    while not descents.runs.ended:
        asked, known = descents.ask(), int(descents.runs.steps)
        descents.tell(judge(lab, lanes, span, asked, descents.reach))
        descents.runs.ended[...] = not asked or descents.runs.steps >= until
        stepped = descents.runs.steps > known  # at first each run is judged where it stands
        if stepped:
            keep.report(number, lanes.number, descents.runs)
        if stepped or descents.runs.ended:
            keep.save(number, descents.runs)
    return descents.runs


def judge(lab: Lab, lanes: Lanes, span: Ranges, asked: dict[int, np.ndarray], reach: np.ndarray) -> dict[int, Judged]:
    """Each run's point (number,) on all lanes; its model holds within its reach (run,)."""
    if not asked:
        return {}
    points, numbers = np.stack(list(asked.values())), np.array(list(asked))
    index = np.tile(np.arange(lanes.number), len(points))
    sites, settings = Picked(lanes.site, index), Picked(lanes.setting, index)
    vectors = np.repeat(span.vectors(points), lanes.number, axis=0)
    within = np.repeat(reach[numbers][:, None] * span.width, lanes.number, axis=0).astype(vectors.dtype)
    models = lab.models(vectors, sites, settings, within)
    parts = [jax.tree.map(lambda x: x[i * lanes.number : (i + 1) * lanes.number], models) for i in range(len(points))]  # noqa: B023
    return {run: judged(model, span.width, lab.counted) for run, model in zip(asked, parts)}
