"""What one planner makes possible: A's parts on C's paths, C's walks with gradients, both walks' energy searched.

python -m experiments.one_planner [--quick]
"""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, write
from experiments.walk_maps import GRID as MAP
from experiments.walk_maps import world
from jaxleg.batch import layout, over_lanes
from jaxleg.foothold.cascade import Cascade
from jaxleg.foothold.rectangle import SearchRectangle, extent_of
from jaxleg.gait.support import CogRule
from jaxleg.leg.energy import Power, electrical
from jaxleg.planner import Planner
from jaxleg.posture.collision import Sizes
from jaxleg.posture.incentre import Incentre
from jaxleg.route.stations import Line, Stations
from jaxleg.search.config import Gait, Study, baseline
from jaxleg.search.lanes import Lab, to_params
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.search.navigate import navigate, navigator_of, simulate_all, survey_all
from jaxleg.search.sites import footing_rule
from jaxleg.series.kinds import Greedy
from jaxleg.sim.rollout import simulate
from jaxleg.status import Status
from jaxleg.terrain import Grid, HeightMap, TerrainSettings, terrain
from jaxleg.terrain.site import Site
from jaxleg.walk.build import build_walk
from jaxleg.walk.choices import Choices
from jaxleg.walk.choose import choose
from jaxleg.walk.navigation import Navigator
from jaxleg.walk.proxy import evaluate
from jaxleg.walk.reference import reference
from jaxleg.walk.site import site_of

GRID, START, GOAL = Grid(100, 50, 0.04, (0.02, 0.02)), (0.8, 1.0), (3.2, 1.1)
GAIT = Gait(hip_height=0.46)
MOVED = (
    *(f"gait.{name}" for name in ("step_length", "stance_length", "stance_width", "skew", "foot_offset", "hip_height")),
    *("gait.swing_height", "gait.lift_share", "posture.levelling", "posture.cog.ratio", "timing.acceleration", "route.turn"),
)
SIX = MOVED[:6]  # that must not be without effect
STEP = 1e-5  # of a number's scale
SCALE = np.array([0.2, 0.6, 0.4, 0.1, 0.1, 0.5, 0.1, 0.2, 1.0, 1.0, 1.0, 0.3])
TARGETS = {"proxy": 1e-4, "simulated, flat": 1e-3, "simulated, rough": 1e-2}
CYCLES, SAMPLES, STEPS = 2, (60, 50), 3
HEADINGS = (0.0, 30.0, 77.0, 180.0)  # [deg]


class Walks(NamedTuple):
    """Planned walks of paper C's planner: what its walk is a function of; leading axis lane."""

    site: Site
    line: Line
    choices: Choices


def main(out: Path | None = None, quick: bool = False) -> None:
    """All rows; `quick` takes few maps."""
    jax.config.update("jax_enable_x64", True)
    study, lab = setup()
    navigation = dataclasses.replace(study.navigation, path=dataclasses.replace(study.navigation.path, steps=96, cells=120))
    navigator = navigator_of(dataclasses.replace(study, navigation=navigation), lab.robot, GAIT, GRID.resolution)
    result = {
        "headings": headings(study, lab),
        "a_on_curves": a_on_curves(study, lab, 8 if quick else 64),
        "c_gradients": c_gradients(lab, navigator, 4 if quick else 32),
    }
    write("one_planner", out, result)


def headings(study: Study, lab: Lab) -> dict[str, Any]:
    """Energy per metre of paper A's walk on level ground in four directions, by proxy and in MJX."""
    gait = to_params(jnp.asarray(baseline(study, "flat", "paper")))
    ground = Grid(151, 151, 0.02, (-1.5, -1.5)).map(jnp.zeros((151, 151)))
    site = site_of(footing_rule(study.terrains), Sizes.of(lab.robot), 0.02, ground)
    extent = extent_of(0.38, 0.08, 0.3, 0.02, heading=None)
    lab.engine  # noqa: B018  built outside of any tracing

    @jax.jit
    def at(heading):
        """Proxy's and MJX's energy per metre at one heading [J/m]."""
        turned = dataclasses.replace(lab, rectangle=dataclasses.replace(lab.rectangle, heading=heading), extent=extent)
        planner = turned.planner(gait, jnp.asarray(np.deg2rad(20.0)))
        stations = planner.route.stations(gait, None, 2 * CYCLES + 2)
        choices, _ = choose(planner, lab.robot, site, stations, 4 * CYCLES)
        made = build_walk(planner, lab.robot, site, stations, choices)
        meters = simulate(lab.engine, lab.robot, lab.ground, ground, reference(lab.robot, made, SAMPLES), STEPS)
        seen = evaluate(lab.robot, made)
        ahead = jnp.sum(meters.moved * jnp.stack([jnp.cos(heading), jnp.sin(heading)]))
        return _electrical(lab, seen.energy) / seen.distance, _electrical(lab, meters.energy) / ahead, meters.fell

    rows = {str(degrees): [float(x) for x in at(jnp.asarray(np.deg2rad(degrees)))] for degrees in HEADINGS}
    energies = np.array(list(rows.values()))[:, :2]
    apart = np.ptp(energies, axis=0) / energies.mean(axis=0)
    print("A at headings:", rows, "apart", apart)
    return {"proxy_mjx_fell": rows, "apart": apart.tolist()}


def a_on_curves(study: Study, lab: Lab, count: int) -> dict[str, Any]:
    """Paper A's cascade and in-centre posture along the body paths of maps that C's planner walks (difficulty <= 0.6): in C's
    tree search, and greedily as A has it. Both are followed in MJX."""
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
    greedy = {"posture": Incentre(CogRule(zero, "overlap"), zero, "way-point"), "series": Greedy()}
    return {"tree": searched, "greedy": dataclasses.replace(searched, **greedy)}


def planned(navigator: Navigator, maps: HeightMap) -> tuple[Walks, np.ndarray]:
    """Walks over maps, and which maps have one."""

    def lane(survey, start, goal):
        found = navigator.walk(survey, start, goal, jnp.zeros(survey.site.valid.shape, bool))
        return Walks(survey.site, navigator.line(survey.site.terrain, found.path), found.choices), found.status

    count = len(maps.elevation)
    ends = (np.broadcast_to(np.asarray(xy), (count, 2)) for xy in (START, GOAL))
    walks, status = over_lanes(lane, *layout(count, 8))(survey_all(navigator, maps), *ends)
    return walks, status == Status.OK


def some_maps(count: int, hardest: float) -> HeightMap:
    """Cuboids and fractal ground in turn, difficulty rising to the hardest."""
    make = jax.jit(lambda kind, seed, d: terrain(kind, GRID, jax.random.key(seed), d, TerrainSettings()), static_argnums=0)
    maps = [make(("cuboids", "fractal")[i % 2], 500 + i, hardest * (i + 0.5) / count) for i in range(count)]
    return jax.tree.map(lambda *x: np.stack(x), *maps)


def c_gradients(lab: Lab, navigator: Navigator, count: int) -> dict[str, Any]:
    """Gradients of C's walks, their choices held: proxy over the whole walk, simulated energy over two cycles, against
    Richardson-extrapolated central differences and forward mode; float64."""
    rough, found = planned(navigator, some_maps(2 * count, 0.6))
    rough = take(rough, np.flatnonzero(found)[:count])
    level, _ = planned(navigator, jax.tree.map(lambda x: x[:1], some_maps(2, 0.0)))
    values = np.asarray(read_leaves(navigator.planner, MOVED))
    vectors = values + SCALE * 0.02 * np.random.default_rng(0).standard_normal((count, len(values)))
    proxy = functools.partial(proxy_energy, lab, navigator.planner)
    simulated = functools.partial(simulated_energy, lab, navigator.planner)
    lab.engine  # noqa: B018  built outside of any tracing
    few = max(count // 4, 1)
    rows = {
        "proxy": gradient_errors(proxy, vectors, rough),
        "simulated, flat": gradient_errors(simulated, vectors[:few], take(level, np.zeros(few, int))),
        "simulated, rough": gradient_errors(simulated, vectors[:few], take(rough, np.arange(few))),
    }
    for name, row in rows.items():
        row["target"] = TARGETS[name]
        print(f"{name:18s} {row}")
    return rows


def take(tree: Any, lanes: np.ndarray) -> Any:
    """Some lanes."""
    return jax.tree.map(lambda x: np.asarray(x)[lanes], tree)


def stations_of(planner: Planner, line: Line, steps: int) -> Stations:
    """As many as a walk of so many steps needs."""
    return planner.route.stations(planner.gait, line, steps // 2 + 3)


def proxy_energy(lab: Lab, planner: Planner, vector: jax.Array, walks: Walks) -> jax.Array:
    """Energy per metre of a whole walk by the proxy [J/m]."""
    planner = with_leaves(planner, MOVED, vector)
    made = build_walk(
        planner, lab.robot, walks.site, stations_of(planner, walks.line, walks.choices.adjust.shape[0]), walks.choices
    )
    seen = evaluate(lab.robot, made)
    return _electrical(lab, seen.energy) / seen.distance


def simulated_energy(lab: Lab, planner: Planner, vector: jax.Array, walks: Walks) -> jax.Array:
    """Energy of the first cycles of a walk in MJX, from standing to standing [J]."""
    planner = with_leaves(planner, MOVED, vector)
    made = build_walk(planner, lab.robot, walks.site, stations_of(planner, walks.line, 4 * CYCLES), first_cycles(walks.choices))
    meters = simulate(lab.engine, lab.robot, lab.ground, walks.site.terrain, reference(lab.robot, made, SAMPLES), STEPS)
    return _electrical(lab, meters.energy)


def _electrical(lab: Lab, energy: Power) -> jax.Array:
    return electrical(jax.tree.map(jnp.sum, energy), lab.convention)


def first_cycles(choices: Choices) -> Choices:
    """The choices of the first `CYCLES` cycles."""
    steps = 4 * CYCLES
    return choices._replace(
        offset=choices.offset[: CYCLES + 1],
        found=choices.found[: CYCLES + 1],
        adjust=choices.adjust[:steps],
        count=jnp.minimum(choices.count, steps),
    )


def gradient_errors(value: Callable[..., jax.Array], vectors: np.ndarray, walks: Walks) -> dict[str, Any]:
    """Reverse mode against differences and forward mode, and how often each of the six numbers has an effect."""
    share = layout(len(vectors), 4)
    lanes = over_lanes(value, *share)
    gradient = over_lanes(jax.grad(value), *share)(vectors, walks) * SCALE
    along = over_lanes(lambda v, w, d: jax.jvp(lambda x: value(x, w), (v,), (d,))[1], *share)
    forward = along(vectors, walks, np.broadcast_to(SCALE, vectors.shape))
    columns = []
    for i in range(vectors.shape[1]):
        unit = STEP * SCALE[i] * np.eye(vectors.shape[1])[i]
        at = [lanes(vectors + h * unit, walks) for h in (1.0, -1.0, 0.5, -0.5)]
        columns.append((4.0 * (at[2] - at[3]) / STEP - (at[0] - at[1]) / (2.0 * STEP)) / 3.0)
    difference = np.stack(columns, axis=1)
    scale = np.maximum(np.abs(difference), 1e-2 * np.abs(difference).max(axis=1, keepdims=True))
    error = (np.abs(gradient - difference) / scale).max(axis=1)
    size = np.linalg.norm(gradient, axis=1)
    acts = np.mean(np.abs(gradient[:, : len(SIX)]) > 1e-6 * size[:, None], axis=0)
    return {
        "walks": len(vectors),
        "error_median": float(np.median(error)),
        "error_p95": float(np.percentile(error, 95)),
        "forward_reverse": float(np.max(np.abs(gradient.sum(axis=1) - forward) / size)),
        "not_zero": dict(zip(SIX, acts.tolist())),
    }


if __name__ == "__main__":
    tyro.cli(main)
