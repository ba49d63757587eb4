"""Paper C's search with paper A's energy: what does it save to order states by the power of holding them?

The same maps, goals, paths and candidate states; `paper` tries them in C's order (28), `energy` by foothold cost plus the
energy of the step: the power of holding the pose (A, (1)) for as long as the shift to it and the swing take. Beside them
`paper, tall`: C's order with the greatest candidate height as its default, which tells how much of the saving is just standing
higher. Simulated; energy over the straight way from start to goal,
paired over the maps that both walk.

    python -m experiments.energy_order [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro

from experiments.blind_swing import interval
from experiments.common import setup, write
from experiments.walk_maps import GAIT, GRID, KINDS, World, succeeded, world
from jaxleg.leg.energy import CONVENTIONS, Convention, Power, electrical
from jaxleg.search.config import Study, Workspace
from jaxleg.search.lanes import Lab
from jaxleg.search.navigate import Outcome, navigate, navigator_of, simulate_all, survey_all

MAPS, HARDEST = 40, 0.6  # the easier part of `walk_maps`' range, where nearly all are walked
HEIGHT_STEP, HEIGHTS = 0.03, 5
TALL = GAIT.workspace.high + HEIGHT_STEP * (HEIGHTS // 2)
CONTESTANTS = ("paper", "paper, tall", "energy")


def main(out: Path | None = None, quick: bool = False) -> None:
    """Walk all contestants over the same maps; `quick` takes 8."""
    study, lab = setup()
    there = world(8 if quick else MAPS, HARDEST)
    walks = {name: walk(study, lab, there, name) for name in CONTESTANTS}
    result: dict[str, Any] = {"maps": len(there.goal), "contestants": {}, "saving": {}}
    for name, (energy, fine, time, height) in walks.items():
        mean = {c: float(energy[c][fine].mean()) for c in CONVENTIONS}
        row = {"walked": int(fine.sum()), "energy_per_metre": mean, "seconds": float(time[fine].mean())}
        result["contestants"][name] = row | {"trunk_height_m": float(height[fine].mean())}
        print(f"{name:14s}{result['contestants'][name]}")
    for base, name in (("paper", "energy"), ("paper", "paper, tall"), ("paper, tall", "energy")):
        result["saving"][f"{name} against {base}"] = saved = saving(walks[base], walks[name])
        print(f"{name} against {base}: {saved}")
    for kind in range(len(KINDS)):
        of = there.kind == kind
        base, other = (jax.tree.map(lambda x, of=of: x[of], walks[name]) for name in ("paper", "energy"))
        result["saving"][f"energy against paper, {KINDS[kind]}"] = saving(base, other)
    write("energy_order", out, result)


def walk(study: Study, lab: Lab, there: World, name: str):
    """Energy per metre by convention, which lanes were walked, their time and the trunk's mean height over the feet."""
    order = "energy" if name == "energy" else "paper"
    tree = dataclasses.replace(study.navigation.tree, order=order, heights=HEIGHTS, height_step=HEIGHT_STEP)
    study = dataclasses.replace(study, navigation=dataclasses.replace(study.navigation, tree=tree))
    gait = dataclasses.replace(GAIT, workspace=Workspace(high=TALL)) if name == "paper, tall" else GAIT
    navigator = navigator_of(study, lab.robot, gait, GRID.resolution)
    surveys = survey_all(navigator, there.maps)
    walked, _ = navigate(navigator, surveys, there.start, there.goal)
    seen = simulate_all(navigator, lab.engine, lab.ground, surveys, walked, there.goal)
    used = np.arange(walked.walk.feet.shape[1]) <= walked.choices.count[:, None]
    height = walked.walk.poses[:, :-1, 2] - walked.walk.feet[..., 2].mean(axis=-1)
    return per_metre(there, seen), succeeded(walked, seen), seen.time, (height * used).sum(axis=1) / used.sum(axis=1)


def per_metre(there: World, seen: Outcome) -> dict[Convention, np.ndarray]:
    """Electrical energy over the straight distance from start to goal [J/m]: the same way for all contestants."""
    energy = Power(*(x.sum(axis=(1, 2)) for x in seen.followed.meters.energy))
    way = np.linalg.norm(there.goal - there.start, axis=1)
    return {convention: np.asarray(electrical(energy, convention)) / way for convention in CONVENTIONS}


def saving(base, other) -> dict[str, Any]:
    """Mean saving over the maps that both walked, with its 95 % interval, by convention."""
    both = base[1] & other[1]
    share = {c: 1.0 - other[0][c][both] / base[0][c][both] for c in CONVENTIONS}
    return {c: interval(x) for c, x in share.items()} | {"n": int(both.sum())}


if __name__ == "__main__":
    tyro.cli(main)
