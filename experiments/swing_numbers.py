"""What are a swing's numbers worth? Those of both laws, cycloid and taut string, moved by the search's gradients.

Everything else is the paper's own gait. On rough ground and among cuboids the apex, the part of its time that a foot goes
straight up and down, the part in which load goes over, and the clearance (least 1 cm) are searched over 256 terrains; what
is found walks on held-out terrains in simulation, where energy and the way of the feet are compared with those of the numbers
in the configuration.

    python -m experiments.swing_numbers [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from experiments.common import CONFIG, setup, training, write
from experiments.searching import best_vector
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.planner import Planner
from jaxleg.search.config import Study
from jaxleg.search.contest import Contest, contest, failures, saving
from jaxleg.search.contestants import contestant, short_name
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.leaves import read_leaves
from jaxleg.search.training import Lanes
from jaxleg.swing.clearance import Cycloid
from jaxleg.swing.taut import Taut

KINDS = ("rough", "cuboids")
OWN = ("swing.clearance", "swing.load_share")
LAWS = {  # each with the numbers that it has
    "cycloid": (Cycloid, (*OWN, "gait.swing_height", "gait.lift_share")),
    "taut": (Taut, OWN),
}
SPANS = {"swing.clearance": (0.01, 0.04), "swing.load_share": (0.05, 0.25)}
TERRAINS, HELD = 256, 96


def main(out: Path | None = None, quick: bool = False) -> None:
    """Both laws on both grounds; `quick` takes one of each and a few terrains."""
    result: dict[str, Any] = {"quick": quick, "terrains": 8 if quick else TERRAINS, "rows": []}
    for law in list(LAWS)[:1] if quick else LAWS:
        study, lab = prepared(law, result["terrains"], 8 if quick else HELD)
        for kind in KINDS[:1] if quick else KINDS:
            result["rows"].append({"law": law, "kind": kind} | row(study, lab, law, kind))
            tell(result["rows"][-1])
            write("swing_numbers", out, result)


def prepared(law: str, terrains: int, held: int) -> tuple[Study, Lab]:
    """The study of four kinds, so many terrains of each, that moves a law's numbers."""
    study, lab = setup(CONFIG.parent / "thousands.toml")
    many, move = len(study.kinds), LAWS[law][1]
    maps = dataclasses.replace(study.terrains, train=terrains * many, held_out=held * many)
    search = dataclasses.replace(study.search, move=move)
    study = dataclasses.replace(study, terrains=maps, search=search, bounds=study.bounds | SPANS)
    return study, dataclasses.replace(lab, move=move)


def row(study: Study, lab: Lab, law: str, kind: str) -> dict[str, Any]:
    """A law's numbers before and after, and what they cost on held-out terrains."""
    planner = contestant(study, kind, "paper")
    planner = dataclasses.replace(planner, swing=LAWS[law][0](planner.swing.clearance, planner.swing.load_share))
    before = np.float32(read_leaves(planner, study.search.move))
    lanes, held = (of_planner(training(study, lab, kind, held_out), planner) for held_out in (False, True))
    vectors = {"before": before, "after": best_vector(study, lab, kind, judged(study, lab, lanes, before))}
    walks = {name: walked(lab, vector, held) for name, vector in vectors.items()}
    return compared(study, vectors, walks)


def of_planner(lanes: Lanes, planner: Planner) -> Lanes:
    """The lanes with this planner."""
    return lanes._replace(setting=settings_of(planner, lanes.number))


def judged(study: Study, lab: Lab, lanes: Lanes, before: np.ndarray) -> Lanes:
    """Lanes whose energy counts against that of the numbers before, whose margin must not fall."""
    vectors = np.tile(before, (lanes.number, 1))
    score = lab.models(vectors, lanes.site, lanes.setting, np.zeros_like(vectors)).score
    energy = np.full(lanes.number, np.nanmean(score.energy[:, CONVENTIONS.index(study.power)]), np.float32)
    return lanes._replace(setting=lanes.setting._replace(margin=score.checks.margin, energy=energy))


def walked(lab: Lab, vector: np.ndarray, lanes: Lanes) -> tuple[Contest, np.ndarray]:
    """Walks of one vector in simulation, and the planned way of the feet a metre of each [m/m]."""
    many = np.tile(np.float32(vector), (lanes.number, 1))
    feet = lab.plan_lanes(many, lanes.site, lanes.setting).reference.foot_pos  # (lane, t, leg, 3)
    score, meters = lab.simulate_lanes(many, lanes.site, lanes.setting)
    way = np.linalg.norm(np.diff(feet, axis=1), axis=-1).sum(axis=(1, 2))
    return contest(score, meters, np.asarray(lanes.setting.least_bend), 1), way / meters.moved[:, 0]


def compared(study: Study, vectors: dict[str, np.ndarray], walks: dict[str, tuple[Contest, np.ndarray]]) -> dict[str, Any]:
    """The numbers, and what those after save of those before on terrains that both walk."""
    (before, way), (after, shorter) = walks["before"], walks["after"]
    both, column = before.usable[0] & after.usable[0], CONVENTIONS.index(study.power)
    options = study.search.resamples, study.seed
    named = {name: dict(zip(map(short_name, study.search.move), vector.tolist())) for name, vector in vectors.items()}
    return {
        "numbers": named,
        "energy_saving": saving(after.energy[0, both, column], before.energy[0, both, column], *options),
        "way_saving": saving(shorter[both], way[both], *options),
        "energy_per_metre": {name: float(seen.energy[0, both, column].mean()) for name, (seen, _) in walks.items()},
        "slip": {name: float(seen.slip[0, both].mean()) for name, (seen, _) in walks.items()},
        "failures": {name: failures(seen, 0) for name, (seen, _) in walks.items()},
        "lanes": int(both.size),
    }


def tell(row: dict[str, Any]) -> None:
    """Print a row."""
    for what in ("energy_saving", "way_saving"):
        low, high = row[what]["ci95"] or (float("nan"),) * 2
        print(f"{row['law']} on {row['kind']}: {what} {100 * row[what]['mean']:.1f} % ({100 * low:.1f} to {100 * high:.1f})")
    print(row["numbers"], row["failures"], row["slip"], flush=True)


if __name__ == "__main__":
    tyro.cli(main)
