"""A study's contest once more where robots and grounds differ from what planners know, in simulation and in C MuJoCo."""

import dataclasses
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxleg.search.contest import Contest, failed, nested, savings_by_engine
from jaxleg.search.contestants import CONTESTANTS
from jaxleg.search.run import Run
from jaxleg.search.verify import everyone, refereed, replayed, simulated
from jaxleg.search.worlds import make_worlds


def randomised(state: Run, chosen: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """The entry `randomised` of a result: savings, falls and what could not be planned, of the searches' vectors by kind."""
    began = time.perf_counter()
    seen: dict[str, dict[str, Contest]] = {"simulation": {}, "mujoco": {}}
    for kind, best in chosen.items():
        seen["simulation"][kind], seen["mujoco"][kind] = walked(state, kind, best)
    state.clock("randomised", began)
    search, ranges = state.study.search, dataclasses.asdict(state.study.randomise)
    lost = {engine: nested({kind: _failed(each) for kind, each in contests.items()}) for engine, contests in seen.items()}
    saved = savings_by_engine(seen, CONTESTANTS, search.resamples, state.study.seed)
    return saved | {"failed": lost, "ranges": ranges}


def walked(state: Run, kind: str, best: np.ndarray) -> tuple[Contest, Contest]:
    """All contestants on a kind's randomised lanes in simulation, and on the referee's share of them in C MuJoCo."""
    vectors, lanes = everyone(state.study, kind, best, *make_worlds(state.study, state.robot, state.lab.ground, kind))
    ours = simulated(state, f"{kind}/randomised", vectors, lanes)
    theirs = replayed(state, f"{kind}/randomised_referee", *refereed(state, kind, vectors, lanes))
    state.tell(16.0, f"{kind}: contestants compared on {ours.fell.shape[1]} randomised lanes")
    return ours, theirs


def _failed(seen: Contest) -> dict[str, dict[str, int]]:
    return {name: failed(seen, i) for i, name in enumerate(CONTESTANTS)}
