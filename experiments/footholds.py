"""The foothold planner at work (paper A, IV.B): Fig. 7 drawn from real calls, and twelve footholds on a map.

Fig. 7's little example has 3 x 5 cells, 3 x 7 lengthened; which cells are valid is drawn at random from two seeds, one whose
cascade ends in the rectangles and one whose ends in the lengthened ones. The map is a stair with unseen patches or any file
(`jaxleg.terrain.files`); the walk of three cycles is laid through the map's middle, along +x or `--heading` degrees from it.

    python -m experiments.footholds [--quick] [--terrain FILE.npz] [--heading DEG]
"""

import dataclasses
import functools
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, write
from jaxleg.conventions import LEGS, InputError
from jaxleg.foothold.cascade import Reachable, choose_stance, reachable_heights
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.foothold.rectangle import SearchRectangle, extent_of
from jaxleg.gait.nominal import nominal_stances
from jaxleg.gait.params import GaitParams
from jaxleg.route.stations import Straight
from jaxleg.search.checks import check_map
from jaxleg.search.config import Rectangle, Study
from jaxleg.search.contestants import contestant
from jaxleg.search.lanes import Lab
from jaxleg.search.sites import footing_rule
from jaxleg.terrain import Grid, HeightMap, flat, stairs
from jaxleg.terrain.files import load_map
from jaxleg.terrain.footing import footing
from jaxleg.terrain.site import Site
from jaxleg.viz.footholds import Planned, draw_cascade, draw_footholds

CYCLES = 3
CELL = 0.02  # of Fig. 7's example [m]
EXAMPLE = Grid(23, 13, CELL, (-11 * CELL, -6 * CELL))
STANCE = np.array([[6, 3], [4, -3], [-4, 3], [-6, -3]]) * CELL  # its feet, nearer to each other than a robot's (leg, xy) [m]
VALID = 0.65  # share of its cells that are valid
SEEDS = {FootholdStatus.NOMINAL: 7, FootholdStatus.WIDENED: 87}  # of its maps, by how their cascade ends
STAIR = Grid(110, 50, 0.02, (-1.09, -0.49))
PATCHES, PATCH, PATCH_SEED = 40, 0.04, 10  # unseen patches of the stair, their radius [m]; all three ways of the cascade occur
FINEST = 0.01  # cells [m] a map is thinned to: in smaller ones the features' windows take minutes to compile


def main(out: Path | None = None, quick: bool = False, terrain: Path | None = None, heading: float = 0.0) -> None:
    """Draw both figures and print every status; `quick` changes nothing. Exits with status 2 for a map that cannot serve."""
    del quick
    jax.config.update("jax_enable_x64", True)
    study, lab = setup()
    try:
        foot = float(lab.robot.foot_radius)
        ground = stair_map() if terrain is None else read_map(terrain, study.rectangle, foot, np.deg2rad(heading))
    except InputError as error:
        print(f"footholds: {error}", file=sys.stderr)
        sys.exit(2)
    cases, walk = [example(wanted) for wanted in SEEDS], on_map(study, lab, ground, np.deg2rad(heading))
    about = {"terrain": str(terrain or "a stair with unseen patches"), "resolution_m": float(ground.resolution)}
    rows = {"cases": [rows_of(case)[0] for case in cases], "cycles": rows_of(walk), "count": count(walk)}
    report(about, rows)
    folder = out or Path("runs") / "footholds"
    draw_cascade(*cases, folder / "cascade.png")
    draw_footholds(walk, folder / "map.png")
    write("footholds", out, about | {"heading_deg": heading} | rows)


def example(wanted: FootholdStatus) -> Planned:
    """Fig. 7's example on level ground with random valid cells; the planner must find its footholds in the wanted way."""
    valid = np.random.default_rng(SEEDS[wanted]).random((EXAMPLE.nx, EXAMPLE.ny)) < VALID
    box = SearchRectangle(*(jnp.asarray(x, float) for x in (5 * CELL, 3 * CELL, 2 * CELL, 0.5, 0.0)))
    reachable = Reachable(*map(jnp.asarray, (-0.1, 0.1, 0.1)))
    planned = plan(Site(flat(EXAMPLE), jnp.asarray(valid)), box, jnp.asarray(STANCE, float)[None], reachable)
    status = np.asarray(planned.choice.status)
    assert (status == wanted).all(), f"the planner's statuses are {status.tolist()}, but should be {wanted.name}"
    return planned


def plan(site: Site, box: SearchRectangle, nominal: jax.Array, reachable: Reachable) -> Planned:
    """One call of the planner for nominal footholds (stance, leg, xy) in W [m]; the extent follows from the map's cells."""
    size, resolution = float(box.length + box.longer), float(site.terrain.resolution)
    extent = extent_of(size, float(box.width), float(reachable.step), resolution, float(box.heading))
    stances = jax.jit(jax.vmap(functools.partial(choose_stance, extent=extent), in_axes=(0, None, None, None, None)))
    choice = stances(nominal, site.valid, site.terrain, box, reachable)
    return Planned(site, box, np.asarray(nominal), choice)


def stair_map() -> HeightMap:
    """A stair of 0.08 m / 0.30 m with round patches that nobody has seen."""
    ground, half = stairs(STAIR, 0.08, 0.30, 0.05), 0.5 * STAIR.resolution * np.array([STAIR.nx, STAIR.ny])
    centres = np.random.default_rng(PATCH_SEED).uniform(-half, half, (PATCHES, 1, 1, 2))
    unseen = (np.linalg.norm(np.asarray(STAIR.points()) - centres, axis=-1) < PATCH).any(axis=0)
    return dataclasses.replace(ground, elevation=jnp.where(unseen, jnp.nan, ground.elevation))


def read_map(path: Path, box: Rectangle, foot_radius: float, heading: float) -> HeightMap:
    """A map from a file, every n-th cell of it where they are smaller than `FINEST`.

    Raises `InputError` for cells larger than the foot's diameter or W_Search, and for a map smaller than the lengthened
    rectangle at that heading [rad]; radius in metres.
    """
    terrain = load_map(path).terrain
    resolution = float(terrain.resolution)
    check_map(f"{path}: ", terrain.elevation.shape, resolution, box, foot_radius, heading)
    return thinned(terrain, max(1, int(FINEST / resolution + 1e-6)))


def thinned(terrain: HeightMap, every: int) -> HeightMap:
    """Every n-th cell of a map; what lies between them is forgotten."""
    return HeightMap(terrain.elevation[::every, ::every], terrain.origin, terrain.resolution * every)


def on_map(study: Study, lab: Lab, terrain: HeightMap, heading: float) -> Planned:
    """Footholds of a walk of Pegasus with the paper's parameters through the middle of a map, at a heading [rad]."""
    planner = contestant(study, "stairs", "paper")
    params = planner.gait
    reachable = reachable_heights(lab.robot, params, np.deg2rad(study.kinds["stairs"].least_knee_bend_deg))
    box = dataclasses.replace(planner.foothold.rectangle, heading=jnp.asarray(heading, float))
    resolution, foot = float(terrain.resolution), float(lab.robot.foot_radius)
    valid = jax.jit(footing, static_argnums=(0, 1, 2))(footing_rule(study.terrains), foot, resolution, terrain)
    site = Site(terrain, valid)
    return plan(site, box, through_middle(params, terrain, heading), reachable)


def through_middle(params: GaitParams, terrain: HeightMap, heading: float) -> jax.Array:
    """Nominal footholds (stance, leg, xy) in W [m] of the walk's cycles; their mean is the middle of the map."""
    stations = Straight(jnp.asarray(heading, float)).stations(params, None, 2 * CYCLES)
    nominal, _ = nominal_stances(params, stations, CYCLES)
    size = jnp.array(terrain.elevation.shape, terrain.resolution.dtype)
    middle = terrain.origin + 0.5 * terrain.resolution * (size - 1.0)
    return nominal - jnp.mean(nominal, axis=(0, 1), keepdims=True) + middle[None, None]


def rows_of(planned: Planned) -> list[dict[str, Any]]:
    """Status and offset (x, y) in W [m] of each leg, a row a stance."""
    status, offset = np.asarray(planned.choice.status), np.round(planned.choice.offset, 6).tolist()
    names = [[FootholdStatus(int(s)).name for s in stance] for stance in status]
    return [{leg: {"status": s, "offset_m": o} for leg, s, o in zip(LEGS, *stance)} for stance in zip(names, offset)]


def count(planned: Planned) -> dict[str, int]:
    """How many footholds have each status."""
    return {status.name: int(np.sum(np.asarray(planned.choice.status) == status)) for status in FootholdStatus}


def report(about: dict[str, Any], rows: dict[str, Any]) -> None:
    """The tables on the terminal."""
    print("Fig. 7's example, offsets in x and y [m]")
    for panels, row in zip(("(a)-(d)", "(e)-(g)"), rows["cases"]):
        print(line(panels, row))
    print("twelve footholds on {terrain}, cells of {resolution_m:g} m:".format(**about), rows["count"])
    for cycle, row in enumerate(rows["cycles"]):
        print(line(f"cycle {cycle + 1}", row))


def line(title: str, row: dict[str, Any]) -> str:
    """One stance in one line."""
    legs = ("{} {:7s} {:+.3f} {:+.3f}".format(leg, found["status"], *found["offset_m"]) for leg, found in row.items())
    return f"{title:8s} " + "   ".join(legs)


if __name__ == "__main__":
    tyro.cli(main)
