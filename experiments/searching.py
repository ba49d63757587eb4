"""What the experiments that search share: terrains judged as the command line's search judges them, and its descents alone."""

from collections.abc import Callable

import jax
import numpy as np

from experiments.common import training
from jaxleg.batch import over_lanes
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search import descent
from jaxleg.search.config import Study
from jaxleg.search.contestants import baseline, bounds, contestant
from jaxleg.search.lanes import Lab, Score, settings_of
from jaxleg.search.training import Lanes


def judged_lanes(study: Study, lab: Lab, kind: str, held_out: bool = False) -> Lanes:
    """Lanes whose energy counts against the traditional gait's and whose margin is to be kept, as the search has them."""
    lanes = training(study, lab, kind, held_out)
    vectors = np.tile(baseline(study, kind, "traditional"), (lanes.number, 1)).astype(np.float32)
    alone = settings_of(contestant(study, kind, "traditional"), lanes.number)
    score = lab.models(vectors, lanes.site, alone, np.zeros_like(vectors)).score
    energy = np.full(lanes.number, score.energy[:, CONVENTIONS.index(study.power)].mean(), np.float32)
    margin = score.checks.margin + np.float32(study.search.margin_reserve)
    return jax.tree.map(np.asarray, Lanes(lanes.site, lanes.setting._replace(margin=margin, energy=energy)))


def judged_by(lab: Lab) -> Callable[[np.ndarray, Lanes], Score]:
    """The proxy's scores of vectors, one for all lanes or one a lane, without gradient; footholds by the exact choice."""
    run = over_lanes(lambda v, site, setting: lab.proxy(v, site, lab.choose(v, site, setting), setting), lab.chunk)
    return lambda vectors, lanes: run(for_each(vectors, lanes), lanes.site, lanes.setting)


def for_each(vectors: np.ndarray, lanes: Lanes) -> np.ndarray:
    """One vector for all lanes, or one a lane, as (lane, number)."""
    return np.array(np.broadcast_to(np.float32(vectors), (lanes.number, np.shape(vectors)[-1])))


def best_vector(
    study: Study, lab: Lab, kind: str, lanes: Lanes, box: np.ndarray | None = None, steps: int | None = None
) -> np.ndarray:
    """What the search that moves everything finds on these lanes, within a box (number, 2) or the study's bounds."""
    search = study.search
    span = descent.ranges((bounds(study, kind, "best") if box is None else box)[None])
    known = np.stack([baseline(study, kind, who) for who in ("traditional", "paper")])
    points = descent.starts_of(jax.random.key(study.seed), known, span, search.starts)
    plan = descent.rounds(lanes.number, search.lanes, search.starts)
    return descent.searched(lab, lanes, span, points, plan, steps or search.steps)[0][0]
