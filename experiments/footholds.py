"""The foothold planner at work (paper A, IV.B, Fig. 7): the cascade on the paper's 3 x 5 cells, and twelve footholds on a map.

    python -m experiments.footholds [--quick] [--terrain FILE.npz]

Without a file the map is a stair with unseen cells; the walk is planned from the map's middle along +x.
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, write
from jaxleg.conventions import LEGS, InputError
from jaxleg.plan import FootholdStatus
from jaxleg.planning.footholds import Reachable
from jaxleg.planning.planner import Choice, Site, plan_footholds, reachable_heights
from jaxleg.planning.rectangle import SearchRectangle, best_first, candidates, extent_of, feasible_score
from jaxleg.search.config import Rectangle, Study, baseline
from jaxleg.search.lanes import Lab, to_params
from jaxleg.stance import nominal_stances
from jaxleg.terrain import Grid, HeightMap, flat, stairs, valid_cells
from jaxleg.terrain.features import FeatureSettings, traversability
from jaxleg.terrain.files import load_map
from jaxleg.viz.footholds import Cascade, draw_cascade, draw_footholds

CELL = 0.06  # of the example: large, to be seen [m]
CORNERS = np.array([[5, 3], [4, -3], [-5, 3], [-6, -3]]) * CELL  # its nominal stance
EXAMPLE = Grid(25, 13, CELL, (-12 * CELL, -6 * CELL))
CYCLES = 3


def main(out: Path | None = None, quick: bool = False, terrain: Path | None = None) -> None:
    """Draw both figures; `quick` changes nothing, it takes seconds anyway. Exits with status 2 where a map cannot serve."""
    del quick
    study, lab = setup()
    folder = out or Path("runs") / "footholds"
    try:
        ground = load_map(terrain) if terrain else stair_map()
        check_map(ground, str(terrain), study.rectangle, float(lab.robot.foot_radius))
    except InputError as error:
        print(f"footholds: {error}", file=sys.stderr)
        sys.exit(2)
    params = to_params(jnp.asarray(baseline(study, "flat", "paper"), float))
    reachable = reachable_heights(lab.robot, params, np.deg2rad(study.kinds["flat"].least_knee_bend_deg))
    cases = [example(reachable, wanted) for wanted in (FootholdStatus.NOMINAL, FootholdStatus.WIDENED)]
    draw_cascade(cases, CORNERS, CELL, folder / "cascade.png")
    site, nominal, choice = on_map(study, lab, ground)
    draw_footholds(site, nominal, choice, study.rectangle.search_length, study.rectangle.search_width, folder / "map.png")
    status = np.asarray(choice.status)
    count = {s.name.lower(): int((status == s).sum()) for s in FootholdStatus}
    for case in cases:
        print(f"example: {case.status.name.lower()}, common offset {case.offset.round(2).tolist()} m")
    print(f"twelve footholds on {terrain or 'a stair with unseen cells'}: {count}")
    rows = {"example": [{"status": c.status.name, "offset": c.offset.tolist()} for c in cases], "count": count}
    legs = {
        leg: {"status": status[:, i].tolist(), "offset": np.asarray(choice.offset[:, i]).tolist()} for i, leg in enumerate(LEGS)
    }
    write("footholds", folder, rows | {"legs": legs, "terrain": str(terrain) if terrain else "stair"})


def stair_map() -> HeightMap:
    """A stair of which every twentieth cell has not been seen."""
    ground = stairs(Grid(120, 50, 0.02, (-1.2, -0.5)), 0.08, 0.30, 0.07)
    hole = jax.random.uniform(jax.random.key(1), ground.elevation.shape) < 0.05
    return HeightMap(jnp.where(hole, jnp.nan, ground.elevation), ground.origin, ground.resolution)


def check_map(ground: HeightMap, name: str, box: Rectangle, foot: float) -> None:
    """Raise `InputError` for a map that is coarser than the foot or the rectangle, or smaller than the rectangle."""
    resolution, size = float(ground.resolution), np.array(ground.elevation.shape) * float(ground.resolution)
    for what, limit in (("the foot's diameter", 2.0 * foot), ("W_Search", box.search_width)):
        if resolution > limit + 1e-6:
            raise InputError(f"{name}: resolution is {resolution:g} m, but must be at most {what}, {limit:g}")
    need = np.array([box.search_length + box.longer, box.search_width])
    if (size < need).any():
        raise InputError(f"{name}: the map is {size[0]:g} x {size[1]:g} m, but the rectangle needs {need[0]:g} x {need[1]:g}")


def example(reachable: Reachable, wanted: FootholdStatus) -> Cascade:
    """A random map on which the cascade over 3 x 5 cells ends with the wanted status, and all that the figure shows of it."""
    box = SearchRectangle(*(jnp.asarray(x, float) for x in (5 * CELL, 3 * CELL, 2 * CELL, 0.5, 0.0)))
    extent = extent_of(7 * CELL, 3 * CELL, 3 * CELL, CELL)
    for seed in range(1000):
        valid = np.random.default_rng(seed).random((EXAMPLE.nx, EXAMPLE.ny)) < 0.55
        site = Site(flat(EXAMPLE), jnp.asarray(valid))
        choice = plan_footholds(jnp.asarray(CORNERS, float)[None], box, reachable, site, extent)
        if (np.asarray(choice.status) == wanted).all() and np.abs(choice.offset).sum() > 0.0:
            break
    seen = candidates(box, CELL, extent.cells)
    widened = wanted == FootholdStatus.WIDENED
    inside, longer = (seen.long, box.longer) if widened else (seen.short, 0.0)
    rank = np.asarray(best_first(feasible_score(seen.along, box, longer), seen, inside).rank)
    return Cascade(wanted, valid, EXAMPLE, np.asarray(inside), rank, np.asarray(choice.offset[0, 0]))


def on_map(study: Study, lab: Lab, ground: HeightMap) -> tuple[Site, np.ndarray, Choice]:
    """Site, nominal footholds and choice of a walk with the paper's parameters from the middle of a map."""
    resolution, maps, box = float(ground.resolution), study.terrains, study.rectangle
    easy = traversability(ground, resolution, FeatureSettings()) >= maps.least_traversability
    limits = (float(np.deg2rad(maps.slope_limit_deg)), maps.edge_height)
    site = Site(ground, valid_cells(ground, resolution, float(lab.robot.foot_radius), *limits, easy))
    params = to_params(jnp.asarray(baseline(study, "stairs", "paper"), float))
    middle = ground.origin + 0.5 * ground.resolution * (jnp.array(ground.elevation.shape) - 1)
    nominal = nominal_stances(params, 0, CYCLES) + middle
    extent = extent_of(box.search_length + box.longer, box.search_width, float(params.step_length), resolution)
    reachable = reachable_heights(lab.robot, params, np.deg2rad(study.kinds["stairs"].least_knee_bend_deg))
    choice = jax.jit(plan_footholds, static_argnums=4)(nominal, lab.rectangle, reachable, site, extent)
    return site, np.asarray(nominal), choice


if __name__ == "__main__":
    tyro.cli(main)
