"""Paper C's planner over many maps at once, and its walks in simulation.

The lanes of a stage run together; a lane that meets a dead end takes another path in the next round, with the others of its
kind. Results are NumPy arrays with a leading axis.
"""

import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxleg.batch import layout, over_lanes, shared_out
from jaxleg.gait.order import STEP_LEGS
from jaxleg.programs import of_method
from jaxleg.robot import Robot
from jaxleg.search.config import Gait, Study
from jaxleg.search.contestants import gait_params
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine
from jaxleg.sim.follow import Followed, follow, landing_errors
from jaxleg.status import Status
from jaxleg.terrain.heightmap import HeightMap, nearest_cell
from jaxleg.walk.navigation import Navigator, Planned, Survey, Walked, make_navigator

MOST = 8  # maps that a device works on at once


class Outcome(NamedTuple):
    """A walk in simulation."""

    followed: Followed
    landing: Float[Array, "step"]  # of each foot from its foothold at the end of its step [m]; 0 where none swung
    time: Float[Array, ""]  # of the plan [s]
    finished: Bool[Array, ""]  # followed to its end without a fall
    left: Float[Array, ""]  # trunk's horizontal distance to the goal at the end [m]
    knee_bend: Float[Array, ""]  # least of the plan [rad]
    torque_ratio: Float[Array, ""]  # greatest planned |torque| over its limit


def navigator_of(
    study: Study,
    robot: Robot,
    gait: Gait,
    resolution: float,
    leaves: Mapping[str, float] = MappingProxyType({}),
    programs: Path | None = None,
) -> Navigator:
    """The planner of a study's settings on maps of a resolution [m per cell]; of a kind's own numbers it takes the swing's. Its
    programs are kept in a folder, if one is named."""
    simulation = study.simulation
    swing = (leaves.get(f"swing.{name}", getattr(simulation, name)) for name in ("load_share", "clearance"))
    return make_navigator(robot, study.navigation, gait_params(gait), *swing, resolution, programs)


def navigate(
    navigator: Navigator, surveys: Survey, start: Float[np.ndarray, "map 2"], goal: Float[np.ndarray, "map 2"]
) -> tuple[Walked, Int[np.ndarray, "map"]]:
    """Plan a walk on every map, and how many detours each took. A lane stuck with every path keeps its last status."""
    share = layout(len(start), MOST)
    walk, detour = (
        over_lanes(getattr(navigator, name), *share, where=of_method(navigator, name)) for name in ("walk", "detour")
    )
    closed = np.zeros(surveys.site.valid.shape, bool)
    walked = walk(surveys, start, goal, closed)
    detours = np.zeros(len(closed), int)
    for _ in range(navigator.settings.path.detours):
        lost = np.flatnonzero(np.isin(walked.status, (Status.DEAD_END, Status.BUDGET)))
        if not len(lost):
            break
        part = _take((surveys, walked), lost)
        closed[lost] = detour(part[0].site.terrain, part[1], closed[lost])
        again = walk(part[0], start[lost], goal[lost], closed[lost])
        found = again.status <= Status.OK
        retry = found | np.isin(again.status, (Status.DEAD_END, Status.BUDGET))
        detours[lost[retry]] += 1
        walked = _put(walked, lost[retry], _take(again, retry))
        closed[lost[~retry]] = True  # no other path is left: the dead end stays its cause
    return walked, detours


def survey_all(navigator: Navigator, maps: HeightMap) -> Survey:
    """`Navigator.survey` of maps with a leading axis."""
    return over_lanes(navigator.survey, *layout(len(maps.elevation), MOST), where=of_method(navigator, "survey"))(maps)


def planned_all(navigator: Navigator, walked: Walked) -> Planned:
    """`Navigator.planned` of walks with a leading axis."""
    return over_lanes(navigator.planned, *layout(len(walked.status), MOST), where=of_method(navigator, "planned"))(walked)


def simulate_all(
    navigator: Navigator, engine: Engine, ground: Ground, surveys: Survey, walked: Walked, goal: Float[np.ndarray, "map 2"]
) -> Outcome:
    """Follow every plan in simulation; lanes without a plan stand. Lanes of about the same length run together."""
    count = len(goal)
    length = np.where(walked.status == Status.OK, walked.choices.count, 0)
    share = layout(count, MOST)
    order, group = np.argsort(length, kind="stable"), int(np.prod(share))
    plan = over_lanes(navigator.planned, *share, where=of_method(navigator, "planned"))
    lane = functools.partial(_simulated, navigator, engine, ground)
    run = shared_out(jax.vmap(lane, in_axes=(None, 0, 0, 0)), *share)
    parts = []
    for first in range(0, max(count, 1), group):
        lanes = order[first : first + group]
        part = _take((surveys, walked), lanes)
        planned = plan(part[1])
        time = planned.reference.time[np.arange(len(lanes)), planned.last]
        ticks = np.int32(np.ceil(time.max(initial=0.0) / navigator.settings.pace.tick) + 1)
        parts.append(run(part[0].site.terrain, planned, goal[lanes], common=(ticks,)))
    back = np.argsort(order)
    return jax.tree.map(lambda *x: np.concatenate(x)[back], *parts)


def _simulated(navigator: Navigator, engine: Engine, ground: Ground, ticks, terrain, planned: Planned, goal) -> Outcome:
    per_step, tick = sum(navigator.samples), jnp.asarray(navigator.settings.pace.tick, goal.dtype)
    seen = follow(engine, navigator.robot, ground, terrain, planned.reference, planned.last, per_step, tick, ticks)
    landing = landing_errors(planned.reference, seen, per_step, STEP_LEGS)
    swung = jnp.arange(landing.shape[0], dtype=jnp.int32) < jnp.minimum(seen.reached, planned.last) // per_step
    end = seen.trunk[jnp.minimum(planned.last // per_step, landing.shape[0] - 1), :2]
    finished = (seen.reached >= planned.last) & ~seen.meters.fell
    return Outcome(
        followed=seen,
        landing=jnp.where(swung, landing, 0.0),
        time=planned.reference.time[planned.last],
        finished=finished,
        left=jnp.linalg.norm(end - goal),
        knee_bend=planned.knee_bend,
        torque_ratio=planned.torque_ratio,
    )


def on_valid_cells(surveys: Survey, walked: Walked) -> Bool[np.ndarray, "map"]:
    """Whether every foothold of a walk, from its first stance on, is the centre of a valid cell."""

    def lane(terrain: HeightMap, valid, feet, count):
        cell = nearest_cell(terrain, feet[..., :2])
        centre = terrain.origin[None, None] + terrain.resolution * cell.astype(feet.dtype)
        fine = valid[cell[..., 0], cell[..., 1]] & (jnp.max(jnp.abs(centre - feet[..., :2]), axis=-1) < 1e-3)
        return jnp.all(fine | (jnp.arange(fine.shape[0], dtype=count.dtype) > count)[:, None])

    return over_lanes(lane, *layout(len(walked.status), MOST))(
        surveys.site.terrain, surveys.site.valid, walked.walk.feet, walked.choices.count
    )


def _take(tree: Any, lanes: np.ndarray) -> Any:
    return jax.tree.map(lambda x: np.asarray(x)[lanes], tree)


def _put(tree: Any, lanes: np.ndarray, values: Any) -> Any:
    """The tree with these lanes' values put in."""

    def put(x, new):
        x = np.array(x)
        x[lanes] = new
        return x

    return jax.tree.map(put, tree, values)
