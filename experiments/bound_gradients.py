"""How should the workspace's bounds move? Gradients of a mean over terrains by perturbation, against differences of that mean.

The mean of the proxy's objective over terrains of four kinds, as a function of the four bounds. Of one terrain it is a
staircase: footholds are cells. So central differences have a step of a cell and a half, and the lattice of each map is shifted
by a random part of a cell. `search.perturbed` takes two evaluations a terrain for all bounds, differences two for each. Beside
it the reverse derivative of the soft choice (`foothold.soft`) at four softnesses, at a quarter of the settings.
Settings of the bounds are drawn round what the gait needs, where they bind; `low` and `high` so far apart that no difference
swaps them.

    python -m experiments.bound_gradients [--quick]
"""

import dataclasses
from collections.abc import Callable
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
from jaxleg.search.perturbed import perturbed, signed
from jaxleg.search.training import Lanes, pooled
from jaxleg.terrain.site import Site
from jaxleg.walk.choose import softly

BOUNDS = (*WORKSPACE, "gait.workspace.high")
KINDS = ("rough", "stairs", "cuboids", "fractal")
GAIT = {"foot_offset": -0.01, "skew": 0.116, "step_length": 0.235, "stance_width": 0.32, "swing_height": 0.06}  # about the best
SOFT = ((0.05, 0.01), (0.05, 0.005), (0.02, 0.005), (0.1, 0.02))  # temperature, length [m]
ROOM = 0.08  # most that an end of L_F2H lies beyond what the gait needs [m]
APART = (0.06, 0.14)  # of high from low [m]
STEP = 1.5  # cells, of differences and moves
BASELINE = 1000.0  # energy that counts as 1 [J/m]


def main(out: Path | None = None, terrains: int = 4096, settings: int = 32, quick: bool = False) -> None:
    """Cosines over settings of the bounds; `quick` takes few of both."""
    terrains, settings = (32, 2) if quick else (terrains, settings)
    study, lab = on_kinds(terrains)
    lanes, (exact, moved, soft) = lanes_of(study, lab), batched(lab)
    rows = [compared(exact, moved, at, study, lanes, i) for i, at in enumerate(drawn(settings))]
    few = rows[: -(-settings // 4)]
    for row in few:
        row["soft"] = softly_compared(soft, row, lanes)
    told = {"perturbed": quantiles([row["cosine"] for row in rows])}
    told |= {f"soft {at}": quantiles([row["soft"][i]["cosine"] for row in few]) for i, at in enumerate(SOFT)}
    for name, seen in told.items():
        print(f"{name}: cosine median {seen['median']:.3f}, p10 {seen['p10']:.3f} of {seen['settings']} settings")
    result = {"quick": quick, "terrains": lanes.number, "step_m": STEP * study.terrains.resolution}
    write("bound_gradients", out, result | {"cosine": told, "rows": rows})


def quantiles(cosines: list[float]) -> dict[str, float]:
    """Median and tenth percentile of cosines."""
    return {"settings": len(cosines), "median": float(np.median(cosines)), "p10": float(np.quantile(cosines, 0.1))}


def on_kinds(terrains: int) -> tuple[Study, Lab]:
    """The quickstart's study on four kinds of ground at their hardest, and its lab, which moves the bounds."""
    study, lab = setup()
    kinds = {name: dataclasses.replace(study.kinds.get(name, Kind(name)), difficulty=(0.5, 1.0)) for name in KINDS}
    return (
        dataclasses.replace(study, kinds=kinds, terrains=dataclasses.replace(study.terrains, train=terrains)),
        dataclasses.replace(lab, move=BOUNDS),
    )


def lanes_of(study: Study, lab: Lab) -> Lanes:
    """All kinds' training lanes, with the gait, each map's lattice shifted by a random part of a cell."""
    lanes = pooled({kind: training(study, lab, kind) for kind in KINDS}, KINDS)
    names = [f"gait.{name}" for name in GAIT]
    planner = with_leaves(searched_planner(study, "rough"), names, jnp.asarray(list(GAIT.values()), float))
    setting = settings_of(planner, lanes.number)
    shift = np.random.default_rng(study.seed).uniform(-0.5, 0.5, (lanes.number, 2)) * study.terrains.resolution
    site = shifted(lanes.site, jnp.asarray(shift, float))
    return lanes._replace(site=site, setting=setting._replace(energy=jnp.full(lanes.number, BASELINE, float)))


def shifted(site: Site, shift: jax.Array) -> Site:
    """Sites whose maps lie elsewhere by so much [m]."""

    def move(ground):
        return dataclasses.replace(ground, origin=ground.origin + shift)

    around = site.obstacles
    return site._replace(terrain=move(site.terrain), obstacles=around._replace(leg=move(around.leg), trunk=move(around.trunk)))


def drawn(count: int) -> np.ndarray:
    """Settings of the four bounds (setting, 4) [m]; the gait needs L_F2H from its centre to half a step ahead of it."""
    chance, (least, most) = np.random.default_rng(1), (GAIT["foot_offset"], GAIT["foot_offset"] + 0.5 * GAIT["step_length"])
    behind, ahead = least - chance.uniform(0.0, ROOM, count), most + chance.uniform(0.0, ROOM, count)
    high = chance.uniform(0.48, 0.55, count)
    return np.stack([behind, ahead, high - chance.uniform(*APART, count), high], axis=1)


def batched(lab: Lab) -> tuple[Callable[..., np.ndarray], ...]:
    """Of lanes: the objective by the exact choice, its perturbed gradient, and the soft choice's gradient."""

    def exact(vector, site, setting):
        return lab.proxy(vector, site, lab.choose(vector, site, setting), setting).objective

    def moved(vector, site, setting, move):
        return perturbed(lambda x: exact(x, site, setting), vector, move)

    def soft(vector, site, setting, softness):
        planner = lab.planner(vector, setting)
        choice = softly(planner, lab.robot, site, stations(planner, CYCLES), 4 * CYCLES, Softness(*softness))
        return lab.proxy(vector, site, choice, setting).objective

    return tuple(over_lanes(f, lab.chunk) for f in (exact, moved, jax.grad(soft)))


def compared(exact, moved, at: np.ndarray, study: Study, lanes: Lanes, number: int) -> dict[str, Any]:
    """Differences and perturbed gradient at one setting of the bounds, the settings counted by `number`."""
    step = STEP * study.terrains.resolution

    def many(vector):
        return np.tile(np.float32(vector), (lanes.number, 1))

    def mean(vector):
        return np.nanmean(exact(many(vector), lanes.site, lanes.setting))

    difference = np.array([(mean(at + step * unit) - mean(at - step * unit)) / (2.0 * step) for unit in np.eye(4)])
    moves = signed(jax.random.fold_in(jax.random.key(study.seed), number), lanes.number, jnp.full(4, step, float))
    slopes = moved(many(at), lanes.site, lanes.setting, moves)
    slope = np.nanmean(slopes, axis=0)
    seen = {"bounds": at, "difference": difference, "slope": slope, "cosine": cosine(slope, difference)}
    print({name: np.round(x, 3).tolist() for name, x in seen.items()}, flush=True)
    return seen | {"standard_error": np.nanstd(slopes, axis=0) / np.sqrt(lanes.number)}


def softly_compared(slopes: Callable[..., np.ndarray], row: dict[str, Any], lanes: Lanes) -> list[dict[str, Any]]:
    """The soft choice's gradient at a setting of the bounds, for each softness."""
    at, rows = np.tile(np.float32(row["bounds"]), (lanes.number, 1)), []
    for softness in SOFT:
        each = slopes(at, lanes.site, lanes.setting, np.tile(np.float32(softness), (lanes.number, 1)))
        slope = each[np.isfinite(each).all(axis=1)].mean(axis=0)
        rows.append({"slope": slope, "cosine": cosine(slope, row["difference"])})
    print("soft", [round(row["cosine"], 3) for row in rows], flush=True)
    return rows


def cosine(u: np.ndarray, v: np.ndarray) -> float:
    """Of the angle between two gradients."""
    return float(u @ v / max(np.linalg.norm(u) * np.linalg.norm(v), 1e-12))


if __name__ == "__main__":
    tyro.cli(main)
