"""What one planner makes possible: A's parts on C's paths, C's walks with gradients and their energy searched, B's leg that
feels its way and its taut string under C's walks, and all three on one map.

python -m experiments.one_planner [--quick]
"""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.c_energy_search import c_energy_search
from experiments.c_gradients import c_gradients
from experiments.c_walks import (
    CYCLES,
    GAIT,
    GRID,
    NEAR,
    SAMPLES,
    STEPS,
    electrical_of,
    ends_on,
    small,
    some_maps,
    take,
)
from experiments.common import setup, write
from experiments.felt_walks import feel_the_way, single_steps, taut_string
from experiments.three_walks import three_walks
from experiments.walk_maps import GRID as MAP
from experiments.walk_maps import world
from jaxleg.batch import layout, over_lanes
from jaxleg.foothold.cascade import Cascade
from jaxleg.foothold.rectangle import SearchRectangle, extent_of
from jaxleg.gait.support import CogRule
from jaxleg.planner import Planner
from jaxleg.posture.collision import Sizes
from jaxleg.posture.incentre import Incentre
from jaxleg.search.config import Study
from jaxleg.search.contestants import contestant
from jaxleg.search.lanes import Lab
from jaxleg.search.leaves import with_leaves
from jaxleg.search.navigate import navigate, navigator_of, simulate_all, survey_all
from jaxleg.search.sites import footing_rule
from jaxleg.series.kinds import Greedy
from jaxleg.sim.rollout import simulate
from jaxleg.status import Status
from jaxleg.terrain import Grid
from jaxleg.walk.build import build_walk
from jaxleg.walk.choose import choose
from jaxleg.walk.proxy import evaluate
from jaxleg.walk.reference import reference
from jaxleg.walk.site import site_of

HEADINGS = (0.0, 30.0, 77.0, 180.0)  # [deg]


def main(out: Path | None = None, quick: bool = False, parts: tuple[str, ...] = ()) -> None:
    """All rows, or the `parts` named, added one by one to the result that is there; `quick` takes few maps. Gradients and
    headings in double precision, walks in single."""
    folder = out or Path("runs") / "one_planner"
    rows: dict[str, Callable[[], dict[str, Any]]] = {
        "headings": lambda: doubled(headings),
        "a_on_curves": lambda: a_on_curves(*setup(), 8 if quick else 64),
        "c_energy_search": lambda: c_energy_search(*setup(), *((6, 4, 3) if quick else (64, 32, 12))),
        "feeling": lambda: felt(*setup(), *((8, 2) if quick else (64, 16))),
        "taut_string": lambda: taut(*setup(), *((6, 16) if quick else (72, 256))),
        "three_walks": lambda: side_by_side(*setup(), folder / "three_walks.png"),
        "c_gradients": lambda: doubled(lambda study, lab: c_gradients(lab, small(study, lab), 4 if quick else 32)),
    }
    result: dict[str, Any] = {}
    for name in parts or rows:
        row, file = rows[name](), folder / "result.json"
        before = json.loads(file.read_text()) if parts and file.exists() else result  # another process may have added a part
        result = before | {name: row, "quick": quick}
        write("one_planner", folder, result)


def doubled(part: Callable[[Study, Lab], dict[str, Any]]) -> dict[str, Any]:
    """A part in double precision."""
    with jax.enable_x64(True):
        return part(*setup())


def headings(study: Study, lab: Lab) -> dict[str, Any]:
    """Energy per metre of paper A's walk on level ground in four directions, by proxy and in simulation."""
    paper, bend = contestant(study, "flat", "paper"), jnp.asarray(np.deg2rad(20.0))
    ground = Grid(151, 151, 0.02, (-1.5, -1.5)).map(jnp.zeros((151, 151)))
    site = site_of(footing_rule(study.terrains), Sizes.of(lab.robot), 0.02, ground)
    foothold = dataclasses.replace(paper.foothold, extent=extent_of(0.38, 0.08, 0.3, 0.02, heading=None))
    paper = dataclasses.replace(paper, foothold=foothold)
    lab.engine  # noqa: B018  built outside of any tracing

    @jax.jit
    def at(heading):
        """Proxy's and simulation's energy per metre at one heading [J/m]."""
        names = ("route.heading", "foothold.least_bend", "limits.knee_bend")
        planner = with_leaves(paper, names, jnp.stack([heading, bend, bend]))
        stations = planner.route.stations(planner.gait, None, 2 * CYCLES + 2)
        choices, _ = choose(planner, lab.robot, site, stations, 4 * CYCLES)
        made = build_walk(planner, lab.robot, site, stations, choices)
        meters = simulate(lab.engine, lab.robot, lab.ground, ground, reference(lab.robot, made, SAMPLES), STEPS)
        seen = evaluate(lab.robot, made)
        ahead = jnp.sum(meters.moved * jnp.stack([jnp.cos(heading), jnp.sin(heading)]))
        return electrical_of(lab, seen.energy) / seen.distance, electrical_of(lab, meters.energy) / ahead, meters.fell

    rows = {str(degrees): [float(x) for x in at(jnp.asarray(np.deg2rad(degrees)))] for degrees in HEADINGS}
    energies = np.array(list(rows.values()))[:, :2]
    apart = np.ptp(energies, axis=0) / energies.mean(axis=0)
    print("A at headings:", rows, "apart", apart)
    return {"proxy_simulation_fell": rows, "apart": apart.tolist()}


def a_on_curves(study: Study, lab: Lab, count: int) -> dict[str, Any]:
    """Paper A's cascade and in-centre posture along the body paths of maps that C's planner walks (difficulty <= 0.6): in C's
    tree search, and greedily as A has it. Both are followed in simulation."""
    there = world(count, 0.6)
    navigator = navigator_of(study, lab.robot, GAIT, MAP.resolution)
    surveys = survey_all(navigator, there.maps)
    walked, _ = navigate(navigator, surveys, there.start, there.goal)
    ours = np.flatnonzero(walked.status == Status.OK)
    surveys, walked, goal = take(surveys, ours), take(walked, ours), there.goal[ours]
    rows = {"maps": count, "walked by C": len(ours)}
    for name, planner in a_planners(study, lab, navigator.planner).items():
        other = dataclasses.replace(navigator, planner=planner)
        made = over_lanes(other.along, *layout(len(ours), 8))(surveys.site, walked.path)
        seen = simulate_all(other, lab.engine, lab.ground, surveys, made, goal)
        done = (made.status == Status.OK) & seen.finished & (seen.left < 0.3)
        causes = {Status(i).name: int(n) for i, n in enumerate(made.causes.sum(axis=0)) if n}
        rows[name] = {"planned": int((made.status == Status.OK).sum()), "walked": int(done.sum())}
        rows[name] |= {"falls": int(seen.followed.meters.fell.sum()), "causes": causes}
        print(f"A on curves, {name}: {rows[name]} of {len(ours)}")
    return rows


def a_planners(study: Study, lab: Lab, planner: Planner) -> dict[str, Planner]:
    """C's planner with A's cascade and posture, its trunk heights searched or lowered way-point by way-point."""
    box, zero = study.rectangle, jnp.zeros(())
    numbers = (box.search_length, box.search_width, box.longer, box.nominal_weight, 0.0)
    rectangle = SearchRectangle(*(zero + x for x in numbers))
    extent = extent_of(box.search_length + box.longer, box.search_width, 0.3, MAP.resolution, heading=None)
    parts = {
        "foothold": Cascade(rectangle, planner.limits.knee_bend, extent),
        "posture": Incentre(CogRule(zero, "overlap"), zero, "none"),
    }
    searched = dataclasses.replace(planner, **parts)
    greedy = {"posture": Incentre(CogRule(zero, "overlap"), zero), "series": Greedy()}
    return {"tree": searched, "greedy": dataclasses.replace(searched, **greedy)}


def felt(study: Study, lab: Lab, count: int, twice: int) -> dict[str, Any]:
    """Walks on cuboids and fractal ground, difficulty up to 0.6, with maps that are wrong; `count` of them."""
    maps = some_maps(count + count // 4, 0.6)
    return feel_the_way(lab, small(study, lab), maps, ends_on(maps), GRID, count, twice)


def taut(study: Study, lab: Lab, count: int, swings: int) -> dict[str, Any]:
    """Walks over single steps."""
    maps = single_steps(count, GRID)
    return taut_string(lab, small(study, lab), maps, ends_on(maps, NEAR), swings)


def side_by_side(study: Study, lab: Lab, path: Path) -> dict[str, Any]:
    """Papers A, B and C on one map of fractal ground."""
    maps = jax.tree.map(lambda x: x[-1:], some_maps(2, 0.4))
    return three_walks(study, lab, small(study, lab), maps, ends_on(maps), GRID, path)


if __name__ == "__main__":
    tyro.cli(main)
