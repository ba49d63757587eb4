"""Climbing stairs of 0.08 / 0.30 m (paper A, Fig. 9, 10b and Table I), with a stand of 35 s while the robot maps.

Then stairs at all offsets that the map's grid tells apart, not drawn for any search: does nobody fall, and does every foothold
that is not flagged lie on a tread, with no riser within the foot's radius?

    python -m experiments.stairs [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro

from experiments.common import each_on_its_own
from experiments.slow_walk import power_over_time, walks
from experiments.table_one import NAMES, Table, checked, finish, planned, result, saving_ratio, spans, table
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.search.config import Study
from jaxleg.search.contestants import searched_planner
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.sites import HELD_OUT, first_of_each, grid, make_sites
from jaxleg.search.training import Lanes
from jaxleg.terrain.generators import stairs, terrain_keys

RUNS = 64


def main(out: Path | None = None, quick: bool = False) -> None:
    """Table I, then the runs at random offsets; `quick` takes fewer lanes and searches our parameters more briefly."""
    seen = table("stairs", quick)
    content = result(seen)
    content["stairs_over_flat_saving"] = saving_ratio(table("flat", quick, NAMES[:-1]), seen)
    for before, ratio in content["stairs_over_flat_saving"].items():
        about = f"{ratio['run']:.2f} with the stand, {ratio['walking']:.2f} walking (paper 0.68)"
        print(f"saving on stairs over saving on flat ground, against {before}: {about}")
    lanes, risers = unseen_stairs(seen.study, seen.lab, 8 if quick else RUNS)
    climbers = ("traditional", "paper", "ours")
    content["runs"] = {name: climb(seen, name, lanes, risers) for name in climbers}
    for name, r in content["runs"].items():
        print(f"{name}: {r['runs']} unseen stairs, {r['falls']} falls, {r['infeasible']} infeasible,", end=" ")
        print(f"walking {r['walking_w']:.1f} W, margin {r['min_stability_margin']:.3f} m;", end=" ")
        print(
            f"{r['footholds']} footholds, {r['flagged']} flagged, {r['off_tread']} others within the foot's radius of a riser "
            f"(the nearest is {r['nearest_riser_m']:.3f} m away)"
        )
    finish("stairs", out, seen, content)


def unseen_stairs(study: Study, lab: Lab, count: int) -> tuple[Lanes, np.ndarray]:
    """Held-out stairs that differ, and where a riser of each stands [m]: the draw of the generator, from the same keys."""
    names, kind, lanes = list(study.kinds), study.kinds["stairs"], unseen(study, lab, "stairs", count)
    keys = terrain_keys(jax.random.fold_in(jax.random.key(study.seed), names.index("stairs")), HELD_OUT, count)
    risers = jax.vmap(lambda key: jax.random.uniform(key, (), float, 0.0, kind.run))(keys)
    made = np.asarray(jax.vmap(lambda offset: stairs(grid(study), kind.rise, kind.run, offset))(risers).elevation)
    kept = first_of_each(made)
    np.testing.assert_allclose(made[kept], lanes.site.terrain.elevation, atol=1e-6)  # they are the maps' own risers
    return lanes, np.asarray(risers)[kept]


def unseen(study: Study, lab: Lab, kind: str, count: int) -> Lanes:
    """Held-out terrains of a kind: those that differ of so many drawn."""
    study = dataclasses.replace(study, terrains=dataclasses.replace(study.terrains, held_out=count * len(study.kinds)))
    site = make_sites(study, lab.robot, kind, held_out=True)
    return Lanes(site, settings_of(searched_planner(study, kind), site.valid.shape[0]))


def climb(seen: Table, name: str, lanes: Lanes, risers: np.ndarray) -> dict[str, Any]:
    """Walk a contestant on all stairs; where its footholds lie is judged by the generator's own risers, not by any map."""
    vectors, lanes = np.tile(seen.vectors[name], (lanes.number, 1)), each_on_its_own(seen.study, "stairs", lanes, [name])
    trace = walks(seen.lab, vectors, lanes)
    run, free = seen.study.kinds["stairs"].run, np.asarray(trace.status) <= FootholdStatus.WIDENED
    beyond = (np.asarray(trace.placed[..., 0]) - risers[:, None, None]) / run
    distance = run * np.abs(beyond - np.round(beyond))
    return {
        "runs": lanes.number,
        "walking_w": spans(power_over_time(seen.lab.robot, trace.record, "net"), trace.record, 0.0)[0],
        "falls": int(np.sum(trace.meters.fell)),
        "min_stability_margin": float(np.min(trace.meters.margin)),
        "footholds": int(free.size),
        "flagged": int(np.sum(~free)),
        "off_tread": int(np.sum(free & (distance < float(seen.lab.robot.foot_radius)))),
        "nearest_riser_m": float(np.min(np.where(free, distance, np.inf))),
    } | planned(checked(seen.lab, vectors, lanes), lanes, slice(None))


if __name__ == "__main__":
    tyro.cli(main)
