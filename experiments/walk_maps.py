"""Walks over 200 maps that the planner has made up its mind about alone: paper C from map to goal, simulated.

Maps of 8 x 4 m, cells of 0.04 m, seeds 0 to 199: every other one cuboids (0.3 x 0.3 m, +-0.1 m at difficulty 1), the others
fractal ground; difficulty spread over [0, 1]. Start and goal at random, at least 5 m apart. How many have a path, how many of
these are walked to the goal without a fall or trunk contact, every failure's cause, touch-down accuracy, success against
difficulty; 20 walks again in C MuJoCo.

    python -m experiments.walk_maps [--quick]
"""

from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import tyro

from experiments.common import setup, write
from jaxleg.batch import layout, over_lanes
from jaxleg.search.config import Gait, Workspace
from jaxleg.search.lanes import Lab
from jaxleg.search.navigate import MOST, Outcome, navigate, navigator_of, on_valid_cells, simulate_all, survey_all
from jaxleg.series.tree import CAUSES
from jaxleg.sim.referee_feedback import follow_all
from jaxleg.status import Status
from jaxleg.terrain import Grid, HeightMap, TerrainSettings, terrain
from jaxleg.viz.navigation import Trials, draw_success
from jaxleg.walk.navigation import Navigator, Survey, Walked

GRID = Grid(200, 100, 0.04, (0.02, 0.02))
KINDS = ("cuboids", "fractal")
MAPS, REPLAYS, APART = 200, 20, 5.0
GAIT = Gait(workspace=Workspace(high=0.46))


class World(NamedTuple):
    """Maps with where to go on them."""

    maps: HeightMap
    start: np.ndarray  # (map, 2) [m]
    goal: np.ndarray
    kind: np.ndarray  # index in KINDS
    difficulty: np.ndarray


def world(count: int, hardest: float = 1.0) -> World:
    """Maps of seeds 0, 1, ..., kinds in turn, difficulty rising to the hardest."""
    make = jax.jit(lambda kind, seed, d: terrain(kind, GRID, jax.random.key(seed), d, TerrainSettings()), static_argnums=0)
    difficulty = hardest * (np.arange(count) // 2 + 0.5) / (count / 2)
    maps = [make(KINDS[i % 2], i, difficulty[i].astype(np.float32)) for i in range(count)]
    ends = np.array([_ends(i) for i in range(count)], np.float32)
    return World(jax.tree.map(lambda *x: np.stack(x), *maps), ends[:, 0], ends[:, 1], np.arange(count) % 2, difficulty)


def _ends(seed: int) -> np.ndarray:
    """Start and goal at least `APART` apart, 0.8 m off the border."""
    rng = np.random.default_rng(seed)
    low, high = np.array([0.8, 0.8]), np.array([7.2, 3.2])
    while True:
        ends = rng.uniform(low, high, (2, 2))
        if np.linalg.norm(ends[1] - ends[0]) >= APART:
            return ends


def main(out: Path | None = None, quick: bool = False) -> None:
    """Plan, walk, count; `quick` takes 16 maps."""
    study, lab = setup()
    there = world(16 if quick else MAPS)
    navigator = navigator_of(study, lab.robot, GAIT, GRID.resolution)
    surveys = survey_all(navigator, there.maps)
    walked, detours = navigate(navigator, surveys, there.start, there.goal)
    seen = simulate_all(navigator, lab.engine, lab.ground, surveys, walked, there.goal)
    result = summary(there, walked, detours, seen, on_valid_cells(surveys, walked))
    show(result)
    draw_success(trials(there, walked, seen), (out or Path("runs/walk_maps")) / "success.png")
    write("walk_maps", out, result)  # the referee takes as long again
    lanes = np.flatnonzero(succeeded(walked, seen))
    result["referee"] = refereed(lab, navigator, surveys, walked, seen, lanes, 4 if quick else REPLAYS)
    print(f"C MuJoCo: {result['referee']}")
    write("walk_maps", out, result)


def succeeded(walked: Walked, seen: Outcome) -> np.ndarray:
    """Lanes that walked to within 0.3 m of the goal without a fall or trunk contact."""
    return (walked.status == Status.OK) & seen.finished & (seen.left < 0.3)


def has_path(walked: Walked) -> np.ndarray:
    """Lanes with a body path."""
    none = (Status.NO_PATH, Status.START_BLOCKED, Status.GOAL_BLOCKED)
    return ~np.isin(walked.status, none)


def trials(there: World, walked: Walked, seen: Outcome) -> list[Trials]:
    """Success against difficulty by kind of terrain."""
    path, success = has_path(walked), succeeded(walked, seen)
    kinds = [(kind, there.kind == k) for k, kind in enumerate(KINDS)]
    return [Trials(kind, there.difficulty[of], path[of], success[of]) for kind, of in kinds]


def refereed(
    lab: Lab, navigator: Navigator, surveys: Survey, walked: Walked, seen: Outcome, lanes: np.ndarray, count: int
) -> dict[str, Any]:
    """Some walks again in C MuJoCo, evenly from easy to hard: outcomes, and energy beside the rollout."""
    lanes = lanes[np.linspace(0, len(lanes) - 1, count).round().astype(int)]
    part = jax.tree.map(lambda x: x[lanes], (surveys, walked))
    planned = over_lanes(navigator.planned, *layout(count, MOST))(part[1])
    cut = [jax.tree.map(lambda x, i=i: x[i, : planned.last[i] + 1], planned.reference) for i in range(count)]
    grounds = [jax.tree.map(lambda x, i=i: x[i], part[0].site.terrain) for i in range(count)]
    judged = follow_all(lab.robot, grounds, cut, float(lab.ground.friction)).verdict
    ours = np.array([float(np.sum(x)) for x in _positive(seen, lanes)])
    theirs = judged.energy.mechanical_positive + judged.energy.joule
    return {
        "maps": lanes.tolist(),
        "falls": int(judged.fell.sum()),
        "energy_over_mjx": (theirs / ours).tolist(),
        "energy_worst_off": float(np.max(np.abs(theirs / ours - 1.0))),
    }


def _positive(seen: Outcome, lanes: np.ndarray) -> np.ndarray:
    """Electrical energy by joint under `positive` [J]."""
    energy = seen.followed.meters.energy
    return (energy.mechanical_positive + energy.joule)[lanes]


def summary(there: World, walked: Walked, detours: np.ndarray, seen: Outcome, valid: np.ndarray) -> dict[str, Any]:
    """The rows of the result, and every failure's cause."""
    status, planned = walked.status, walked.status == Status.OK
    path, success = has_path(walked), succeeded(walked, seen)
    landing = seen.landing.max(axis=1)
    failures = [
        {
            "map": int(i),
            "kind": KINDS[there.kind[i]],
            "difficulty": float(there.difficulty[i]),
            "cause": "fell" if planned[i] and seen.followed.meters.fell[i] else Status(status[i]).name.lower(),
        }
        for i in np.flatnonzero(~success)
    ]
    return {
        "maps": len(path),
        "with_path": int(path.sum()),
        "planned": int(planned.sum()),
        "walked": int(success.sum()),
        "walked_of_path": float(success.sum() / path.sum()),
        "falls": int((planned & seen.followed.meters.fell).sum()),
        "footholds_on_invalid_cells": int((planned & ~valid).sum()),
        "landing_worst_m": float(landing[success].max()),
        "landing_over_2cm": int((landing[planned] > 0.02).sum()),
        "margin_least_m": float(seen.followed.meters.margin[success].min()),
        "margin_median_m": float(np.median(seen.followed.meters.margin[success])),
        "margin_negative": int((seen.followed.meters.margin[success] < 0.0).sum()),
        "knee_bend_least_deg": float(np.rad2deg(seen.knee_bend[planned].min())),
        "torque_ratio_greatest": float(seen.torque_ratio[planned].max()),
        "left_worst_m": float(seen.left[success].max()),
        "seconds_mean": float(seen.time[planned].mean()),
        "steps_mean": float(walked.choices.count[planned].mean()),
        "tried_a_step": float(walked.visited[planned].sum() / walked.choices.count[planned].sum()),
        "with_detours": int((planned & (detours > 0)).sum()),
        "causes_of_refused_candidates": {c.name.lower(): int(walked.causes[:, c].sum()) for c in Status if 0 < c < CAUSES},
        "by_kind": {
            kind: {"with_path": int(path[of].sum()), "walked": int(success[of].sum()), "maps": int(of.sum())}
            for kind, of in ((kind, there.kind == k) for k, kind in enumerate(KINDS))
        },
        "failures": failures,
    }


def show(result: dict[str, Any]) -> None:
    """A line a number."""
    for name, value in result.items():
        if name != "failures":
            print(f"{name:32s}{value}")
    for failure in result["failures"]:
        print("failed:", failure)


if __name__ == "__main__":
    tyro.cli(main)
