"""The lanes that a search trains on: terrains, and what each is judged by."""

import time
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.batch import Picked
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search.contestants import baseline, contestant, searched_planner
from jaxleg.search.lanes import Setting, settings_of
from jaxleg.search.run import Run
from jaxleg.search.sites import make_sites


class Lanes(NamedTuple):
    """Lanes: sites with a leading axis, what each is judged by, and what it is walked with and on if that is another."""

    site: Any  # a `Site`, or such `Picked`
    setting: Setting
    truth: Any = None  # a `Truth`, or such `Picked`

    @property
    def number(self) -> int:
        """Number of terrains."""
        return self.setting.energy.shape[0]

    def take(self, index: np.ndarray) -> "Lanes":
        """The lanes of these numbers."""
        return jax.tree.map(lambda x: (x if isinstance(x, Picked) else np.asarray(x))[index], self)


def training_lanes(state: Run, kind: str) -> Lanes:
    """Training sites of a kind; a lane's margin floor is that of `traditional` there, the energy that counts as 1 its mean over
    the kind. What a search does not move is the paper's."""
    began = time.perf_counter()
    site = make_sites(state.study, state.robot, kind, held_out=False)
    count = site.valid.shape[0]
    setting = settings_of(searched_planner(state.study, kind), count)

    def measure() -> np.ndarray:
        vectors = np.tile(baseline(state.study, kind, "traditional"), (count, 1))
        alone = settings_of(contestant(state.study, kind, "traditional"), count)
        score = state.lab.models(vectors, site, alone, np.zeros_like(vectors)).score
        return np.stack([score.energy[:, CONVENTIONS.index(state.study.power)], score.checks.margin])

    energy, margin = state.remember(f"{kind}/baseline", np.zeros((2, count), setting.energy.dtype), measure)
    floor = jnp.asarray(margin + state.study.search.margin_reserve, float)
    state.clock("baseline", began)
    state.tell(2.0, f"{kind}: baseline {np.nanmean(energy):.0f} J/m on {count} training terrains")
    return Lanes(site, setting._replace(margin=floor, energy=jnp.full(count, np.nanmean(energy), float)))


def pooled(training: dict[str, Lanes], group: tuple[str, ...]) -> Lanes:
    """The lanes of a group of kinds, kind by kind: `spread` then takes of all kinds and, within each, of all difficulties."""
    return jax.tree.map(lambda *x: np.concatenate(x), *(training[kind] for kind in group))


def spread(lanes: Lanes, count: int) -> Lanes:
    """`count` lanes spread evenly over all, or all where there are fewer."""
    return lanes.take(np.linspace(0, lanes.number - 1, min(count, lanes.number)).round().astype(int))
