"""A study from start to end: search per kind of terrain, then the contest on held-out terrains.

Each stage's answer goes into the run folder as soon as it is there; a resumed study takes it from there and goes on, so it
reaches the same answer.
"""

import time
from typing import Any

import numpy as np

from jaxleg.about import about
from jaxleg.search.config import Study
from jaxleg.search.contest import active_constraints, failed, failures, nested, savings_by_engine, summary, workspace
from jaxleg.search.contestants import BASELINES, CONTESTANTS, STAGES, bounds, contestants, numbers, short_name
from jaxleg.search.lanes import CYCLES, Lab
from jaxleg.search.randomised import randomised
from jaxleg.search.run import Report, Run
from jaxleg.search.run_folder import RunFolder
from jaxleg.search.stages import polish, search_group
from jaxleg.search.training import training_lanes
from jaxleg.search.verify import check_proxy, held_out, referee


def run(study: Study, lab: Lab, folder: RunFolder, report: Report) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Run (or resume) a study in its lab (`run.make_lab`); returns its result and the searched parameter vectors (stage,
    parameter) of each kind.

    Raises nothing of its own: failures are counted in the result.
    """
    state = Run(study, lab, folder, report)
    began = time.perf_counter()
    chosen, held, replays = {}, {}, {}
    groups = [state.kinds] if study.one_for_all else [(kind,) for kind in state.kinds]
    for group in groups:
        training = {kind: training_lanes(state, kind) for kind in group}
        state.trained |= {kind: lanes.number for kind, lanes in training.items()}
        best = polish(state, group, training, search_group(state, group, training))
        chosen |= dict.fromkeys(group, best)
    for kind in state.kinds:
        held[kind] = held_out(state, kind, chosen[kind])
    proxy = check_proxy(state)
    for kind in state.kinds:
        replays[kind] = referee(state, kind, chosen[kind])
    extra = {"randomised": randomised(state, chosen)} if study.randomise.lanes else {}
    state.seconds["total"] = time.perf_counter() - began
    return assemble(state, chosen, held, replays, proxy) | extra, chosen


def assemble(state: Run, chosen: dict, held: dict, replays: dict, proxy: dict) -> dict[str, Any]:
    """The content of `result.json`."""
    study, search = state.study, state.study.search
    options = (search.resamples, study.seed)
    mass = float(state.robot.mass)
    params = {kind: [numbers(study, planner) for planner in contestants(study, kind, chosen[kind])] for kind in state.kinds}
    table = {
        kind: {name: summary(held[kind], i, params[kind][i], study.power, mass, *options) for i, name in enumerate(CONTESTANTS)}
        for kind in state.kinds
    }

    def spans(kind: str, name: str) -> dict[str, list[float]]:
        return dict(zip(map(short_name, study.search.move), bounds(study, kind, name).tolist()))

    lost = {kind: {name: failures(held[kind], i) for i, name in enumerate(CONTESTANTS)} for kind in state.kinds}
    space = {
        kind: {name: workspace(held[kind], i, params[kind][i]) for i, name in enumerate(CONTESTANTS)} for kind in state.kinds
    }

    active = {
        kind: {
            name: active_constraints(held[kind], i, params[kind][i], spans(kind, name))
            for i, name in enumerate(STAGES, len(BASELINES))
        }
        for kind in state.kinds
    }

    refereed = {kind: {name: failed(replays[kind], i) for i, name in enumerate(CONTESTANTS)} for kind in state.kinds}

    counts = {  # of terrains that differ
        "train": state.trained,
        "held_out": {kind: held[kind].fell.shape[1] for kind in state.kinds},
        "referee": {kind: replays[kind].fell.shape[1] for kind in state.kinds},
    }

    return {
        **nested(table),
        **savings_by_engine({"simulation": held, "mujoco": replays}, CONTESTANTS, *options),
        "referee": nested(refereed),
        "active_constraints": nested(active),
        "workspace": nested(space),
        "failures": nested(lost),
        "bounds": {kind: spans(kind, "best") for kind in state.kinds},
        "proxy": proxy,
        "power": study.power,
        "speed": study.speed,
        "least_knee_bend_deg": {kind: study.kinds[kind].least_knee_bend_deg for kind in state.kinds},
        "timing": state.seconds,
        "terrains": {
            **{use: sum(numbers.values()) for use, numbers in counts.items()},
            "by_kind": counts,
            "cycles": CYCLES,
        },
        "seed": study.seed,
        **about(),
    }
