"""What one planner makes possible: A's parts on C's paths, C's walks with gradients and their energy searched, B's leg that
feels its way and its taut string under C's walks, and all three on one map.

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
import optax
import tyro

from experiments.common import setup, write
from experiments.felt_walks import feel_the_way, single_steps, taut_string
from experiments.three_walks import three_walks
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
from jaxleg.search.config import Gait, Study
from jaxleg.search.contest import saving
from jaxleg.search.contestants import contestant
from jaxleg.search.lanes import Lab
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

GRID, START, GOAL, NEAR = Grid(100, 50, 0.04, (0.02, 0.02)), (0.8, 1.0), (3.2, 1.1), (2.3, 1.05)
GAIT = Gait(hip_height=0.46)
MOVED = (
    *(f"gait.{name}" for name in ("step_length", "stance_length", "stance_width", "skew", "foot_offset", "hip_height")),
    *("gait.swing_height", "gait.lift_share", "posture.levelling", "posture.cog.ratio", "timing.acceleration", "route.turn"),
)
SIX = MOVED[:6]  # that must not be without effect
STEP = 1e-5  # of a number's scale
SCALE = np.array([0.2, 0.6, 0.4, 0.1, 0.1, 0.5, 0.1, 0.2, 1.0, 1.0, 1.0, 0.3])
POSTURE = {  # numbers of C's posture that its energy search moves, and their bounds
    "gait.hip_height": (0.40, 0.55),
    "gait.foot_offset": (-0.12, 0.12),
    "posture.levelling": (-0.01, 1.01),
    "posture.target_weight": (-0.01, 1.01),
    "posture.cog.ratio": (0.2, 0.8),
}
TARGETS = {"proxy": 1e-4, "simulated, flat": 1e-3, "simulated, rough": 1e-2}
CYCLES, SAMPLES, STEPS = 2, (60, 50), 3
HEADINGS = (0.0, 30.0, 77.0, 180.0)  # [deg]


class Walks(NamedTuple):
    """Planned walks of paper C's planner: what its walk is a function of; leading axis lane."""

    site: Site
    line: Line
    choices: Choices


def main(out: Path | None = None, quick: bool = False, parts: tuple[str, ...] = ()) -> None:
    """All rows, or the `parts` named; `quick` takes few maps. Gradients and headings in double precision, walks in single."""
    rows: dict[str, Callable[[], dict[str, Any]]] = {
        "headings": lambda: doubled(headings),
        "a_on_curves": lambda: a_on_curves(*setup(), 8 if quick else 64),
        "c_energy_search": lambda: c_energy_search(*setup(), *((6, 4, 3) if quick else (64, 32, 16))),
        "feeling": lambda: felt(*setup(), *((8, 2) if quick else (64, 16))),
        "taut_string": lambda: taut(*setup(), *((6, 16) if quick else (72, 256))),
        "three_walks": lambda: side_by_side(*setup(), (out or Path("runs") / "one_planner") / "three_walks.png"),
        "c_gradients": lambda: doubled(lambda study, lab: c_gradients(lab, small(study, lab), 4 if quick else 32)),
    }
    write("one_planner", out, {name: rows[name]() for name in parts or rows} | {"quick": quick})


def doubled(part: Callable[[Study, Lab], dict[str, Any]]) -> dict[str, Any]:
    """A part in double precision."""
    with jax.enable_x64(True):
        return part(*setup())


def small(study: Study, lab: Lab) -> Navigator:
    """Paper C's planner for the small maps."""
    path = dataclasses.replace(study.navigation.path, steps=96, cells=120)
    study = dataclasses.replace(study, navigation=dataclasses.replace(study.navigation, path=path))
    return navigator_of(study, lab.robot, GAIT, GRID.resolution)


def headings(study: Study, lab: Lab) -> dict[str, Any]:
    """Energy per metre of paper A's walk on level ground in four directions, by proxy and in MJX."""
    paper, bend = contestant(study, "flat", "paper"), jnp.asarray(np.deg2rad(20.0))
    ground = Grid(151, 151, 0.02, (-1.5, -1.5)).map(jnp.zeros((151, 151)))
    site = site_of(footing_rule(study.terrains), Sizes.of(lab.robot), 0.02, ground)
    foothold = dataclasses.replace(paper.foothold, extent=extent_of(0.38, 0.08, 0.3, 0.02, heading=None))
    paper = dataclasses.replace(paper, foothold=foothold)
    lab.engine  # noqa: B018  built outside of any tracing

    @jax.jit
    def at(heading):
        """Proxy's and MJX's energy per metre at one heading [J/m]."""
        names = ("route.heading", "foothold.least_bend", "limits.knee_bend")
        planner = with_leaves(paper, names, jnp.stack([heading, bend, bend]))
        stations = planner.route.stations(planner.gait, None, 2 * CYCLES + 2)
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


def c_energy_search(study: Study, lab: Lab, train: int, held: int, steps: int) -> dict[str, Any]:
    """Numbers of C's posture moved by gradient over training maps, its choices made anew in each step; the walks of hand-set
    and moved numbers followed in MJX on other maps."""
    navigator = small(study, lab)
    walks, found = planned(navigator, some_maps(train, 0.5))
    walks = take(walks, np.flatnonzero(found))
    low, high = (np.array(x, np.float32) for x in zip(*POSTURE.values()))
    numbers = np.asarray(read_leaves(navigator.planner, tuple(POSTURE)), np.float32)
    free, optimiser = np.log((numbers - low) / (high - numbers)), optax.adam(0.3)
    state, slope, history = optimiser.init(free), over_lanes(jax.value_and_grad(held_cost(lab, navigator)), 8), []
    rechoose = over_lanes(functools.partial(_choices, navigator), 8)
    for step in range(steps):
        batch = take(walks, (16 * step + np.arange(16)) % len(walks.site.valid))
        at = low + (high - low) / (1.0 + np.exp(-free))
        choices, good = rechoose(np.tile(at, (16, 1)), batch.site, batch.line)
        value, gradient = slope(np.tile(at, (16, 1)), batch._replace(choices=choices))
        good = good & np.isfinite(gradient).all(axis=1)
        mean = np.where(good[:, None], gradient, 0.0).sum(axis=0) / max(good.sum(), 1)
        history.append({"cost": float(value[good].mean()), "planned": int(good.sum())} | dict(zip(POSTURE, at.tolist())))
        print(step, history[-1])
        update, state = optimiser.update(mean * (at - low) * (high - at) / (high - low), state)
        free = np.asarray(optax.apply_updates(free, update))
    at = low + (high - low) / (1.0 + np.exp(-free))
    return {"moved": dict(zip(POSTURE, at.tolist())), "history": history} | compared(lab, navigator, at, held)


def held_cost(lab: Lab, navigator: Navigator) -> Callable[[jax.Array, Walks], jax.Array]:
    """Energy per metre by the proxy over 1000 J/m, and what knee bend and margin lack; the choices held."""

    def cost(numbers: jax.Array, walks: Walks) -> jax.Array:
        planner = with_leaves(navigator.planner, tuple(POSTURE), numbers)
        stations = stations_of(planner, walks.line, walks.choices.adjust.shape[0])
        seen = evaluate(lab.robot, build_walk(planner, lab.robot, walks.site, stations, walks.choices))
        bend = jax.nn.relu(planner.limits.knee_bend - seen.checks.knee_bend) / 0.02
        margin = jax.nn.relu(planner.limits.margin - seen.checks.margin) / 0.01
        return _electrical(lab, seen.energy) / seen.distance / 1000.0 + 0.1 * (bend + margin)

    return cost


def _choices(navigator: Navigator, numbers: jax.Array, site: Site, line: Line):
    """The choices along a line with these numbers, and whether there are any."""
    planner = with_leaves(navigator.planner, tuple(POSTURE), numbers)
    stations = stations_of(planner, line, navigator.steps)
    choices, _ = choose(planner, navigator.robot, site, stations, navigator.steps)
    return choices, choices.status == Status.OK


def compared(lab: Lab, navigator: Navigator, numbers: np.ndarray, held: int) -> dict[str, Any]:
    """Energy of the walks with hand-set and with moved numbers on maps that no search has seen; pairs that both walk."""
    maps = some_maps(2 * held, 0.5)
    maps = jax.tree.map(lambda x: x[held:], maps)
    ends, surveys, energy, walked = ends_on(maps), survey_all(navigator, maps), [], []
    for planner in (navigator.planner, with_leaves(navigator.planner, tuple(POSTURE), jnp.asarray(numbers))):
        other = dataclasses.replace(navigator, planner=planner)
        made, _ = navigate(other, surveys, *ends)
        seen = simulate_all(other, lab.engine, lab.ground, surveys, made, ends[1])
        joints = seen.followed.meters.energy
        energy.append((joints.mechanical_positive + joints.joule).sum(axis=(1, 2)) / made.walk.way)
        walked.append((made.status == Status.OK) & seen.finished)
    both = walked[0] & walked[1]
    saved = saving(energy[1][both], energy[0][both], 2000, 0)
    print(f"C, moved against hand-set: {saved} over {both.sum()} of {held} maps")
    return {"saving": saved, "maps": held, "walked": [int(w.sum()) for w in walked]}


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


def ends_on(maps: HeightMap, goal: tuple[float, float] = GOAL) -> tuple[np.ndarray, np.ndarray]:
    """Start and goal on each map [m]."""
    count = len(maps.elevation)
    start, end = (np.tile(np.asarray(xy, np.float32), (count, 1)) for xy in (START, goal))
    return start, end


def planned(navigator: Navigator, maps: HeightMap) -> tuple[Walks, np.ndarray]:
    """Walks over maps, and which maps have one."""

    def lane(survey, start, goal):
        found = navigator.walk(survey, start, goal, jnp.zeros(survey.site.valid.shape, bool))
        return Walks(survey.site, navigator.line(survey.site.terrain, found.path), found.choices), found.status

    walks, status = over_lanes(lane, *layout(len(maps.elevation), 8))(survey_all(navigator, maps), *ends_on(maps))
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
