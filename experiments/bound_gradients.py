"""Does the soft choice's gradient say how the workspace's bounds should move? Against differences of the exact choice's mean.

The mean of the proxy's objective over terrains of four kinds, as a function of the four bounds. Of one terrain it is a
staircase: footholds are cells. So central differences have a step of a cell and a half, and the lattice of each map is shifted
by a random part of a cell. The soft choice (`foothold.soft`) is differentiated on the same lanes. Settings of the bounds are
drawn round what the gait needs, where they bind.

    python -m experiments.bound_gradients [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, training, write
from jaxleg.batch import over_lanes
from jaxleg.foothold.soft import Softness
from jaxleg.search.config import WORKSPACE, Kind, Study
from jaxleg.search.contestants import searched_planner
from jaxleg.search.lanes import CYCLES, Lab, settings_of, stations
from jaxleg.search.leaves import with_leaves
from jaxleg.search.training import Lanes, pooled
from jaxleg.walk.choose import softly

BOUNDS = (*WORKSPACE, "gait.workspace.high")
KINDS = ("rough", "stairs", "cuboids", "fractal")
GAIT = {"foot_offset": -0.01, "skew": 0.116, "step_length": 0.235, "stance_width": 0.32, "swing_height": 0.06}  # about the best
SOFT = ((0.05, 0.01), (0.05, 0.005), (0.02, 0.005), (0.1, 0.02))  # temperature, length [m]
ROOM = 0.08  # most that an end of L_F2H lies beyond what the gait needs [m]
STEP = 1.5  # cells, of the differences
BASELINE = 1000.0  # energy that counts as 1 [J/m]


def main(out: Path | None = None, terrains: int = 1024, settings: int = 16, quick: bool = False) -> None:
    """Cosines over settings of the bounds; `quick` takes few of both."""
    terrains, settings = (32, 2) if quick else (terrains, settings)
    study, lab = on_kinds(terrains)
    lanes, shift = lanes_of(study, lab), shifts(study, terrains)
    exact, soft = objectives(lab)
    rows = [compared(exact, soft, at, study, lanes, shift) for at in drawn(settings)]
    cosines = {str(s): [row["cosine"][i] for row in rows] for i, s in enumerate(SOFT)}
    told = {name: {"median": float(np.median(c)), "p10": float(np.quantile(c, 0.1))} for name, c in cosines.items()}
    for name, seen in told.items():
        print(f"softness {name}: cosine median {seen['median']:.3f}, p10 {seen['p10']:.3f}")
    result = {"quick": quick, "terrains": lanes.number, "settings": settings, "step_m": STEP * study.terrains.resolution}
    write("bound_gradients", out, result | {"cosine": told, "rows": rows})


def on_kinds(terrains: int) -> tuple[Study, Lab]:
    """The quickstart's study on four kinds of ground at their hardest, and its lab, which moves the bounds."""
    study, lab = setup()
    kinds = {name: dataclasses.replace(study.kinds.get(name, Kind(name)), difficulty=(0.5, 1.0)) for name in KINDS}
    return (
        dataclasses.replace(study, kinds=kinds, terrains=dataclasses.replace(study.terrains, train=terrains)),
        dataclasses.replace(lab, move=BOUNDS),
    )


def lanes_of(study: Study, lab: Lab) -> Lanes:
    """All kinds' training lanes, with the gait."""
    lanes = pooled({kind: training(study, lab, kind) for kind in KINDS}, KINDS)
    names = [f"gait.{name}" for name in GAIT]
    planner = with_leaves(searched_planner(study, "rough"), names, jnp.asarray(list(GAIT.values()), float))
    setting = settings_of(planner, lanes.number)
    return lanes._replace(setting=setting._replace(energy=jnp.full(lanes.number, BASELINE, float)))


def shifts(study: Study, count: int) -> np.ndarray:
    """By how much each map's lattice is shifted (terrain, 2) [m]."""
    return np.random.default_rng(study.seed).uniform(-0.5, 0.5, (count, 2)) * study.terrains.resolution


def drawn(count: int) -> np.ndarray:
    """Settings of the four bounds (setting, 4) [m]; the gait needs L_F2H from its centre to half a step ahead of it."""
    chance, (least, most) = np.random.default_rng(1), (GAIT["foot_offset"], GAIT["foot_offset"] + 0.5 * GAIT["step_length"])
    behind, ahead = least - chance.uniform(0.0, ROOM, count), most + chance.uniform(0.0, ROOM, count)
    return np.stack([behind, ahead, chance.uniform(0.40, 0.50, count), chance.uniform(0.48, 0.55, count)], axis=1)


def objectives(lab: Lab):
    """The objective of lanes by the exact choice, and by the soft one with its gradient."""

    def exact(vector, site, setting, shift):
        site = shifted(site, shift)
        return lab.proxy(vector, site, lab.choose(vector, site, setting), setting).objective

    def soft(vector, site, setting, shift, softness):
        site, planner = shifted(site, shift), lab.planner(vector, setting)
        choice = softly(planner, lab.robot, site, stations(planner, CYCLES), 4 * CYCLES, Softness(*softness))
        return lab.proxy(vector, site, choice, setting).objective

    return over_lanes(exact, lab.chunk), over_lanes(jax.value_and_grad(soft), lab.chunk)


def shifted(site: Any, shift: jax.Array) -> Any:
    """A site whose map lies elsewhere by so much [m]."""

    def move(ground):
        return dataclasses.replace(ground, origin=ground.origin + shift)

    around = site.obstacles
    return site._replace(terrain=move(site.terrain), obstacles=around._replace(leg=move(around.leg), trunk=move(around.trunk)))


def compared(exact, soft, at: np.ndarray, study: Study, lanes: Lanes, shift: np.ndarray) -> dict[str, Any]:
    """Differences and soft gradients at one setting of the bounds."""
    shift, step = shift[: lanes.number].astype(np.float32), STEP * study.terrains.resolution

    def many(vector):
        return np.tile(np.float32(vector), (lanes.number, 1))

    def mean(vector):
        return np.nanmean(exact(many(vector), lanes.site, lanes.setting, shift))

    difference = np.array([(mean(at + step * unit) - mean(at - step * unit)) / (2.0 * step) for unit in np.eye(4)])
    slopes = []
    for softness in SOFT:
        _, slope = soft(many(at), lanes.site, lanes.setting, shift, np.tile(np.float32(softness), (lanes.number, 1)))
        slopes.append(slope[np.isfinite(slope).all(axis=1)].mean(axis=0))
    norm = np.linalg.norm
    cosine = [float(slope @ difference / max(norm(slope) * norm(difference), 1e-12)) for slope in slopes]
    print(np.round(at, 3), "differences", np.round(difference, 3), "cosines", np.round(cosine, 3), flush=True)
    return {
        "bounds": at.tolist(),
        "difference": difference.tolist(),
        "slopes": np.stack(slopes).tolist(),
        "cosine": cosine,
    }


if __name__ == "__main__":
    tyro.cli(main)
