"""Walks with a leg that feels its way over ground that the map has wrong, and by taut string over steps: parts of
`one_planner`, and what `reactive_climb` shares with it."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import stats

from jaxleg.batch import layout, over_lanes, shared_out
from jaxleg.control.reflex import reflex
from jaxleg.control.swing_leg import Feeling, feeling, reflexes
from jaxleg.gait.order import SHIFT
from jaxleg.numerics import smoothstep
from jaxleg.search.lanes import Lab
from jaxleg.search.navigate import navigate, survey_all
from jaxleg.sim.reactive import Tick, walk_reactively
from jaxleg.sim.referee_feedback import PERIOD, lockstep
from jaxleg.status import Status
from jaxleg.swing.flight import fly
from jaxleg.swing.taut import Taut
from jaxleg.terrain import Grid, HeightMap, rough
from jaxleg.walk.build import build_walk
from jaxleg.walk.data import Walk
from jaxleg.walk.navigation import Navigator
from jaxleg.walk.reference import reference

DT = 0.0025  # of a tick [s]
SPARE = 1.3  # time given to a walk over its plan's
ERROR, WAVE = 0.03, 0.5  # of the map: two standard deviations, and its correlation length [m]
KNOWN = (0.45, 0.75)  # the robot knows the ground it stands on: from here on its map begins to err, from there fully [m]
NOISY = {"torque_noise": 0.5, "angle_noise": 5e-5, "friction": 1.0}  # [N m, rad, N m]
CONTESTANTS: dict[str, dict[str, Any]] = {
    "clocked": {"reacts": False},
    "reactive": {},
    "reactive, links believed 10 % heavier, noise": NOISY | {"mass_error": 0.1},
    "reactive, links believed 10 % lighter, noise": NOISY | {"mass_error": -0.1},
}
STEPS = (0.05, 0.15)  # heights of the steps that the taut string goes over [m]
TOUCH, NEAR = 1.0, 0.02  # a touch: so much normal force [N], so far from where the swing starts and ends [m]


def react(lab: Lab, ticks: int, count: int) -> Callable[[Feeling, HeightMap, Walk], Tick]:
    """The function that walks plans, each on its own ground, with one way of feeling; compiled once for all of them."""
    lab.engine  # noqa: B018  built outside of any tracing
    machine, dt = reflexes(lab.robot), jnp.asarray(DT, float)

    def lane(feel, terrain, walk):
        return walk_reactively(lab.engine, lab.robot, lab.ground, terrain, walk, machine, feel, dt, ticks)

    share = layout(count, lab.chunk)
    run = shared_out(jax.vmap(lane, in_axes=(None, 0, 0)), *share)
    return lambda feel, terrain, walk: run(terrain, walk, common=(feel,))


def refereed(lab: Lab, feel: Feeling, terrain: HeightMap, walk: Walk, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """The same in C MuJoCo: which walks fell, and which came to their end."""
    count, dt = len(walk.count), jnp.asarray(PERIOD, float)
    lane = functools.partial(reflex, lab.robot, machine=reflexes(lab.robot), feel=feel, dt=dt)
    controllers = jax.jit(jax.vmap(lambda w: lane(walk=w)))(walk)
    starts = jax.jit(jax.vmap(lambda w: reference(lab.robot, w, (8, 8))))(walk)
    grounds, first = ([jax.tree.map(lambda x, i=i: np.asarray(x[i]), tree) for i in range(count)] for tree in (terrain, starts))
    seen = lockstep(lab.robot, grounds, controllers, first, float(lab.ground.friction), int(ticks * DT / PERIOD))
    return seen.verdict.fell, seen.over


def length_of(walk: Walk) -> int:
    """Ticks that the longest of walks is given."""
    ends = np.max(np.where(walk.used, walk.phases.start + walk.phases.duration, 0.0), axis=1)
    return int(np.ceil(SPARE * ends.max() / DT))


def wrong(maps: HeightMap, starts: np.ndarray, grid: Grid) -> HeightMap:
    """The maps with a smooth error that fades in round about where each walk starts."""

    @jax.jit
    @jax.vmap
    def lane(terrain, start, seed):
        error = rough(grid, jax.random.key(seed), ERROR, WAVE).elevation.astype(terrain.elevation.dtype)
        i, j = (terrain.resolution * jnp.arange(n, dtype=start.dtype) for n in terrain.elevation.shape)
        away = jnp.hypot((i + terrain.origin[0] - start[0])[:, None], (j + terrain.origin[1] - start[1])[None])
        share = smoothstep((away - KNOWN[0]) / (KNOWN[1] - KNOWN[0]))
        return dataclasses.replace(terrain, elevation=terrain.elevation + share * error)

    return jax.tree.map(np.asarray, lane(maps, starts, 9000 + np.arange(len(starts))))


def feel_the_way(
    lab: Lab, navigator: Navigator, maps: HeightMap, ends: tuple[np.ndarray, np.ndarray], grid: Grid, count: int, twice: int
) -> dict[str, Any]:
    """Paper C's walks, planned on wrong maps, by the clock and with the reflexes of paper B: who falls. `count` walks, of
    which `twice` are walked again in C MuJoCo."""
    surveys = survey_all(navigator, wrong(maps, ends[0], grid))
    walked, _ = navigate(navigator, surveys, *ends)
    lanes = np.flatnonzero(walked.status == Status.OK)[:count]
    true, walk = (jax.tree.map(lambda x: np.asarray(x)[lanes], tree) for tree in (maps, walked.walk))
    ticks, rows = length_of(walk), {}
    run = react(lab, ticks, len(lanes))
    again = np.linspace(0, len(lanes) - 1, min(twice, len(lanes))).round().astype(int)
    few = jax.tree.map(lambda x: x[again], (true, walk))
    for name, told in CONTESTANTS.items():
        feel = feeling(lab.robot, **told)
        tick = run(feel, true, walk)
        fell, over = ~tick.alive[:, -1], tick.done[:, -1]
        theirs, ended = refereed(lab, feel, *few, ticks)
        rows[name] = {
            "walks": len(lanes),
            "falls": int(fell.sum()),
            "unfinished": int((~fell & ~over).sum()),
            "falls_share": interval_of(int(fell.sum()), len(lanes)),
            "mujoco": {"walks": len(again), "falls": int(theirs.sum()), "unfinished": int((~theirs & ~ended).sum())},
            "same_verdict": int(np.sum(theirs == fell[again])),
        }
        print(f"feeling, {name}: {rows[name]}")
    return {"maps": len(ends[0]), "map_error_m": ERROR, "rows": rows}


def interval_of(count: int, of: int) -> list[float]:
    """95 % interval of a share (Wilson)."""
    return [float(end) for end in stats.binomtest(count, of).proportion_ci(method="wilson")]


def taut_string(
    lab: Lab, navigator: Navigator, maps: HeightMap, ends: tuple[np.ndarray, np.ndarray], swings: int
) -> dict[str, Any]:
    """Walks over single steps by the clock on a right map, along taut strings and along cycloids with the same footholds:
    touches of the swinging feet in simulation, and the lengths of the ways of those swings that go over the step."""
    planner = dataclasses.replace(navigator.planner, swing=Taut(*dataclasses.astuple(navigator.planner.swing)))
    other, surveys = dataclasses.replace(navigator, planner=planner), survey_all(navigator, maps)
    walked, _ = navigate(other, surveys, *ends)
    lanes = np.flatnonzero(walked.status == Status.OK)
    part = jax.tree.map(lambda x: np.asarray(x)[lanes], (surveys.site, walked.path))
    rows, walks = {}, {}
    for name, seen in {"taut": other, "cycloid": navigator}.items():
        walks[name] = over_lanes(functools.partial(_same, seen), *layout(len(lanes), 8))(
            *part, jax.tree.map(lambda x: np.asarray(x)[lanes], walked.choices)
        )
    crossing = crosses(walks["taut"], swings)
    for name, walk in walks.items():
        run = react(lab, length_of(walk), len(lanes))
        tick = run(feeling(lab.robot, reacts=False), part[0].terrain, walk)
        touched = touches(tick, walk)[crossing]
        rows[name] = {"swings": len(touched), "touched": int(touched.sum()), "falls": int((~tick.alive[:, -1]).sum())}
        rows[name]["length_m"] = float(lengths(lab, walk)[crossing].mean())
        print(f"taut string, {name}: {rows[name]}")
    saved = lengths(lab, walks["cycloid"])[crossing] - lengths(lab, walks["taut"])[crossing]
    ci = stats.bootstrap((saved,), np.mean, n_resamples=2000, random_state=np.random.default_rng(0)).confidence_interval
    print(f"the taut string is {saved.mean():.4f} m shorter {np.round(ci, 4)}")
    return {
        "maps": len(ends[0]),
        "walked": len(lanes),
        "rows": rows,
        "shorter_m": {"mean": float(saved.mean()), "ci95": list(ci)},
    }


def _same(navigator: Navigator, site, path, choices) -> Walk:
    """The walk of a planner along a path with choices made before."""
    return build_walk(navigator.planner, navigator.robot, site, navigator.stations(site.terrain, path), choices)


def swings_of(walk: Walk) -> np.ndarray:
    """Which phases swing a leg (lane, phase)."""
    return np.asarray(walk.used) & (np.array(walk.legs) != SHIFT)


def ends_of(walk: Walk) -> tuple[np.ndarray, np.ndarray]:
    """Where each phase's foot starts and is to land (lane, phase, 3) [m]; of no meaning in a shift."""
    leg = np.maximum(np.array(walk.legs), 0)
    phase = np.arange(len(leg))
    return tuple(np.asarray(x)[:, phase, leg] for x in (walk.phases.feet_from, walk.phases.feet_to))


def crosses(walk: Walk, most: int) -> np.ndarray:
    """The first so many swings that end on the other side of the step (lane, phase)."""
    start, end = ends_of(walk)
    over = swings_of(walk) & (np.abs(end - start)[..., 2] > 0.5 * STEPS[0])
    kept = np.zeros(over.size, bool)
    kept[np.flatnonzero(over)[:most]] = True
    return kept.reshape(over.shape)


def touches(tick: Tick, walk: Walk) -> np.ndarray:
    """Whether a foot on its way is pressed on anything farther than `NEAR` from its two ends (lane, phase)."""
    leg, (start, end) = np.maximum(np.array(walk.legs), 0), ends_of(walk)
    found = np.zeros(start.shape[:2], bool)
    for lane in range(len(found)):
        phase = np.minimum(tick.phase[lane], len(leg) - 1)
        at = np.arange(len(phase))
        foot, force = tick.foot[lane][at, leg[phase]], tick.normal_force[lane][at, leg[phase]]
        away = [np.linalg.norm(foot - place[lane][phase], axis=1) > NEAR for place in (start, end)]
        hit = (tick.mode[lane] >= 0) & tick.alive[lane] & away[0] & away[1] & (force > TOUCH)
        found[lane, phase[hit]] = True
    return found


def lengths(lab: Lab, walk: Walk) -> np.ndarray:
    """Length of each phase's flight (lane, phase) [m]."""

    def phase(start, end, flight):
        foot = jax.vmap(lambda s: fly(start, end, flight, s))(jnp.linspace(0.0, 1.0, 257, dtype=start.dtype))
        return jnp.sum(jnp.linalg.norm(jnp.diff(foot, axis=0), axis=1))

    lanes = jax.jit(jax.vmap(jax.vmap(phase)))
    return np.asarray(lanes(*ends_of(walk), walk.phases.flight))


def single_steps(count: int, grid: Grid) -> HeightMap:
    """Level ground with one step up or down across the way, half way and at some slant, of heights over all of `STEPS`."""
    rng, (x, y) = np.random.default_rng(0), (grid.resolution * np.arange(n) for n in (grid.nx, grid.ny))
    height = np.linspace(*STEPS, count) * np.where(np.arange(count) % 2, -1.0, 1.0)
    line = 1.55 + rng.uniform(-0.2, 0.2, (count, 1, 1)) + rng.uniform(-0.3, 0.3, (count, 1, 1)) * (y - 0.5 * y[-1])
    high = np.where(x[:, None] > line, height[:, None, None], 0.0).astype(np.float32)
    return jax.vmap(grid.map)(jnp.asarray(high))
