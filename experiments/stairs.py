"""Climbing stairs of 0.08 / 0.30 m (paper A, Fig. 9, 10b and Table I), with a stand of 35 s while the robot maps.

Then many stairs at random offsets: does nobody fall, and does every foothold that is not flagged lie on a tread, with no
riser within the foot's radius?

    python -m experiments.stairs [--quick]
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup
from experiments.slow_walk import slow, walks
from experiments.table_one import NAMES, finish, result, saving_ratio, table
from jaxleg.plan import FootholdStatus
from jaxleg.search.config import Study
from jaxleg.search.descent import Lanes
from jaxleg.search.lanes import Setting
from jaxleg.search.sites import make_sites

RUNS = 64


def main(out: Path | None = None, quick: bool = False) -> None:
    """Table I, then the runs at random offsets; `quick` takes fewer lanes and searches our parameters more briefly."""
    seen = table("stairs", quick)
    content = result(seen)
    content["stairs_over_flat_saving"] = saving_ratio(table("flat", quick, NAMES[:-1]), seen)
    for before, ratio in content["stairs_over_flat_saving"].items():
        about = f"{ratio['run']:.2f} with the stand, {ratio['walking']:.2f} walking (paper 0.68)"
        print(f"saving on stairs over saving on flat ground, against {before}: {about}")
    count = 8 if quick else RUNS
    content["runs"] = {name: offsets(seen.study, seen.vectors[name], count) for name in ("traditional", "paper", "ours")}
    for name, r in content["runs"].items():
        print(f"{name}: {r['runs']} stairs at random offsets, {r['falls']} falls;", end=" ")
        print(
            f"{r['footholds']} footholds, {r['flagged']} flagged, {r['off_tread']} others within the foot's radius of a riser"
        )
    finish("stairs", out, seen, content)


def offsets(study: Study, vector: np.ndarray, count: int) -> dict[str, Any]:
    """Walk a gait on so many stairs; where its footholds lie is judged by the generator's own risers, not by any map."""
    study, lab = slow(*setup(), 3 * count)
    site = make_sites(study, float(lab.robot.foot_radius), "stairs", held_out=False)
    number = site.valid.shape[0]
    bend = np.deg2rad(study.kinds["stairs"].least_knee_bend_deg)
    lanes = Lanes(site, Setting(*(jnp.full(number, x, float) for x in (bend, 0.0, 1.0)))).take(np.arange(count))
    trace = walks(lab, np.tile(vector, (count, 1)), lanes)
    risers = riser_offsets(study, count)
    run, free = study.kinds["stairs"].run, np.asarray(trace.status) <= FootholdStatus.WIDENED
    beyond = (np.asarray(trace.placed[..., 0]) - risers[:, None, None]) / run
    distance = run * np.abs(beyond - np.round(beyond))
    return {
        "runs": count,
        "falls": int(np.sum(trace.meters.fell)),
        "footholds": int(free.size),
        "flagged": int(np.sum(~free)),
        "off_tread": int(np.sum(free & (distance < float(lab.robot.foot_radius)))),
        "nearest_riser_m": float(np.min(np.where(free, distance, np.inf))),
    }


def riser_offsets(study: Study, count: int) -> np.ndarray:
    """Where a riser of each training stair stands [m]: the draw of the generator, from the same keys."""
    key = jax.random.fold_in(jax.random.key(study.seed), list(study.kinds).index("stairs"))
    draw = jax.vmap(lambda n: jax.random.uniform(jax.random.fold_in(key, n), (), float, 0.0, study.kinds["stairs"].run))
    return np.asarray(draw(jnp.arange(count)))


if __name__ == "__main__":
    tyro.cli(main)
