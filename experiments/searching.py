"""What the experiments that search share: terrains judged as the command line's search judges them, and its descents alone."""

import jax
import numpy as np

from experiments.common import training
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search import descent
from jaxleg.search.config import Study
from jaxleg.search.contestants import baseline, bounds, contestant
from jaxleg.search.lanes import Lab, settings_of
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
