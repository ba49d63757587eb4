"""The verification of a study: held-out terrains in simulation, the proxy's honesty, the referee."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.batch import Picked
from jaxleg.search import agreement, referees
from jaxleg.search.config import Study
from jaxleg.search.contest import Contest, contest
from jaxleg.search.contestants import CONTESTANTS, STAGES, bounds, contestants, searched_planner
from jaxleg.search.lanes import CONSTRAINTS, settings_of
from jaxleg.search.leaves import read_leaves
from jaxleg.search.run import Run
from jaxleg.search.sites import make_sites, share
from jaxleg.search.training import Lanes
from jaxleg.search.worlds import Truth
from jaxleg.terrain.site import Site


def held_out_lanes(state: Run, kind: str, best: np.ndarray) -> tuple[np.ndarray, Lanes]:
    """All contestants on all held-out terrains of a kind, contestant by contestant."""
    return everyone(state.study, kind, best, make_sites(state.study, state.robot, kind, held_out=True))


def everyone(study: Study, kind: str, best: np.ndarray, site: Site, truth: Truth | None = None) -> tuple[np.ndarray, Lanes]:
    """All contestants on all sites, contestant by contestant; they have the sites in common."""
    planners, count = contestants(study, kind, best), site.valid.shape[0]
    setting = jax.tree.map(lambda *x: np.concatenate(x), *(settings_of(planner, count) for planner in planners))
    vectors = np.stack([read_leaves(planner, study.search.move) for planner in planners])
    index = np.tile(np.arange(count), len(planners))
    lanes = Lanes(Picked(site, index), setting, None if truth is None else Picked(truth, index))
    return np.repeat(vectors, count, axis=0), lanes


def held_out(state: Run, kind: str, best: np.ndarray) -> Contest:
    """Simulate all contestants on the kind's held-out terrains; margins' slack is against the traditional baseline's."""
    began = time.perf_counter()
    result = simulated(state, f"{kind}/held_out", *held_out_lanes(state, kind, best))
    state.clock("held_out", began)
    state.tell(8.0, f"{kind}: contestants compared on {result.fell.shape[1]} held-out terrains")
    return result


def simulated(state: Run, stage: str, vectors: np.ndarray, lanes: Lanes) -> Contest:
    """The contest on lanes (contestant by contestant) in our simulation, remembered as a stage."""

    def compute() -> Contest:
        score, meters = state.lab.simulate_lanes(jnp.asarray(vectors, float), *lanes)
        seen = contest(score, meters, np.asarray(lanes.setting.least_bend), len(CONTESTANTS))
        return with_margin_slack(seen, score.checks.margin.reshape(len(CONTESTANTS), -1))

    return state.remember(stage, empty_contest(len(CONTESTANTS), len(vectors) // len(CONTESTANTS)), compute)


def with_margin_slack(seen: Contest, margin: np.ndarray) -> Contest:
    """Put the slack of the planned margin against the traditional baseline's in its place."""
    slack = seen.slack.copy()
    slack[..., CONSTRAINTS.index("margin")] = margin - margin[CONTESTANTS.index("traditional")]
    return seen._replace(slack=slack)


def empty_contest(count: int, lanes: int) -> Contest:
    """A contest of the right shapes and types, to load a saved one into."""
    number, flag = np.zeros((count, lanes), np.asarray(jnp.zeros((), float)).dtype), np.zeros((count, lanes), bool)
    three, four, by_constraint = (np.zeros((count, lanes, n), number.dtype) for n in (3, 4, len(CONSTRAINTS)))
    return Contest(three, number, number, number, number, number, number, four, number, four, flag, flag, by_constraint)


def check_proxy(state: Run) -> dict[str, Any]:
    """Proxy against simulation over random feasible gaits, in equal shares on the kinds that are not stairs."""
    began, study = time.perf_counter(), state.study
    kinds = [kind for kind in state.kinds if study.kinds[kind].generator != "stairs"] or list(state.kinds)
    counts = [share(study.search.proxy_gaits, len(kinds), i) for i in range(len(kinds))]

    def compute() -> agreement.Agreement:
        """Both energies at random feasible gaits of all kinds."""
        parts = []
        for kind, count in zip(kinds, counts):
            site = make_sites(study, state.robot, kind, held_out=False)
            lanes = Lanes(site, settings_of(searched_planner(study, kind), site.valid.shape[0]))
            span = bounds(study, kind, STAGES[-1])
            key = jax.random.fold_in(jax.random.key(study.seed), 200 + state.kinds.index(kind))
            parts.append(agreement.random_gaits(state.lab, key, lanes, span, count))
        vectors = np.concatenate([part[0] for part in parts])
        lanes = jax.tree.map(lambda *x: jnp.concatenate(x), *(part[1] for part in parts))
        return agreement.compare(state.lab, vectors, lanes)

    like = empty_agreement(study.search.proxy_gaits)
    result = agreement.agreement(state.remember("proxy", like, compute))
    state.clock("proxy", began)
    state.tell(10.0, "proxy compared with simulation")
    return result


def empty_agreement(count: int) -> agreement.Agreement:
    """An agreement of the right shapes and types, to load a saved one into."""
    number, flag = np.zeros(count, np.asarray(jnp.zeros((), float)).dtype), np.zeros(count, bool)
    return agreement.Agreement(number, number, flag, flag)


def referee(state: Run, kind: str, best: np.ndarray) -> Contest:
    """Replay contestants on the kind's share of the referee's terrains, held-out ones, in C MuJoCo."""
    began = time.perf_counter()
    result = replayed(state, f"{kind}/referee", *refereed(state, kind, *held_out_lanes(state, kind, best)))
    state.clock("referee", began)
    state.tell(8.0, f"{kind}: {result.fell.shape[1]} held-out terrains replayed in C MuJoCo")
    return result


def refereed(state: Run, kind: str, vectors: np.ndarray, lanes: Lanes) -> tuple[np.ndarray, Lanes]:
    """Those of a kind's lanes that the referee gets, spread evenly over them."""
    total = len(vectors) // len(CONTESTANTS)
    count = min(share(state.study.search.referee_terrains, len(state.kinds), state.kinds.index(kind)), total)
    pick = np.linspace(0, total - 1, count).round().astype(int)
    index = (np.arange(len(CONTESTANTS))[:, None] * total + pick).reshape(-1)
    return vectors[index], lanes.take(index)


def replayed(state: Run, stage: str, vectors: np.ndarray, lanes: Lanes) -> Contest:
    """The contest on lanes (contestant by contestant) in C MuJoCo, remembered as a stage."""
    return state.remember(
        stage,
        empty_contest(len(CONTESTANTS), len(vectors) // len(CONTESTANTS)),
        lambda: referees.replay_contest(state.lab, vectors, lanes, len(CONTESTANTS)),
    )
