"""From choices to a walk: footholds, trunk poses, phases, times. Paper A, II.A and IV.C; C, 3.1 and 3.2.

One lane; `vmap` it over planners and sites. With the choices held everything is differentiable, forward and reverse, in the
planner's numbers, the robot's and the map's.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEFT_LEGS
from jaxleg.gait.nominal import nominal_offset, nominal_stances
from jaxleg.gait.order import SHIFT, STEP_LEGS
from jaxleg.gait.phases import Layout, Moves, Phases, layout
from jaxleg.numerics import norm_safe
from jaxleg.planner import Planner
from jaxleg.posture.incentre import lowering_needed
from jaxleg.robot import Robot
from jaxleg.rotations import turned
from jaxleg.route.stations import Stations
from jaxleg.series.candidates import adjustment_of
from jaxleg.series.kinds import Tree
from jaxleg.terrain.ground import on_ground
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.site import Site
from jaxleg.walk.choices import Choices
from jaxleg.walk.data import Walk
from jaxleg.walk.trajectory import foot_path, trunk_path

RANK = np.argsort(STEP_LEGS)  # of each leg in a cycle's order of swings


def build_walk(planner: Planner, robot: Robot, site: Site, stations: Stations, choices: Choices) -> Walk:
    """The walk of a planner along stations with its choices made."""
    steps = choices.adjust.shape[0]
    shape = layout(steps, planner.shared, planner.standing)
    footholds = chosen_footholds(planner, robot, site.terrain, stations, choices)
    feet = feet_by_step(footholds, steps)
    poses = _poses(planner, robot, site.terrain, stations, choices, feet)
    moves = _moves(planner, robot, site, shape, _Course(feet, poses, choices.count))
    legs, way = tuple(shape.leg.tolist()), _way(planner, stations, poses, choices.count)
    moves, poses, lowering = lowered(planner, robot, shape, moves, poses)
    used = jnp.asarray(shape.step - (shape.leg == SHIFT), jnp.int32) < choices.count
    duration = planner.timing.durations(planner.gait, planner.swing.load_share, moves, legs, used, way)
    return Walk(
        gait=planner.gait,
        footholds=footholds,
        found=choices.found,
        poses=poses,
        feet=feet,
        count=choices.count,
        way=way,
        lowering=lowering,
        phases=Phases(jnp.cumsum(duration) - duration, duration, *moves),
        used=used,
        load_share=planner.swing.load_share,
        status=choices.status,
        legs=legs,
    )


class _Course(NamedTuple):
    """Feet before each step, and poses before the first step and in each, and the steps walked."""

    feet: Float[Array, "step1 leg 3"]
    poses: Float[Array, "step2 6"]
    count: Int[Array, ""]


def chosen_footholds(
    planner: Planner, robot: Robot, terrain: HeightMap, stations: Stations, choices: Choices
) -> Float[Array, "stance leg 3"]:
    """The footholds: each nominal one and its offset, turned to the station's heading, on the ground."""
    nominal, yaw = nominal_stances(planner.gait, stations, choices.offset.shape[0])
    return on_ground(robot, terrain, nominal + jax.vmap(jax.vmap(turned))(choices.offset, yaw))


def feet_by_step(footholds: Float[Array, "stance leg 3"], steps: int) -> Float[Array, "step1 leg 3"]:
    """Where the feet stand before each step, and after the last."""
    step = np.arange(steps + 1)[:, None]
    stance = step // 4 + (RANK[None] < step % 4)
    return footholds[stance, np.arange(4)[None]]


def _poses(planner, robot, terrain, stations, choices, feet):
    """Trunk poses: before the first step, in each step's swing, and at the end."""
    posture, gait, steps = planner.posture, planner.gait, choices.adjust.shape[0]
    each = 2 if planner.shared else 1
    first = np.arange(0, steps, each)
    adjust = _adjustments(planner, choices)[first]
    leg = jnp.asarray([STEP_LEGS[s % 4] for s in first])
    yaw = stations.yaw[np.minimum(first // 2 + 1, stations.yaw.shape[0] - 1)]
    swing = jax.vmap(posture.swing, in_axes=(None, None, 0, 0, 0, 0, 0))
    poses = jnp.repeat(swing(robot, gait, feet[first], feet[first + each], leg, adjust, yaw), each, axis=0)
    if planner.standing:
        begin = posture.stand(robot, gait, feet[0], stations.yaw[0])
    else:
        begin = _in_mid_gait(planner, robot, terrain, stations, choices.offset[0], feet[0])
    poses = posture.settle(jnp.concatenate([begin[None], poses]))
    end = posture.stand(robot, gait, feet[choices.count], poses[choices.count, 5]) if planner.standing else poses[-1]
    return jnp.concatenate([poses, end[None]])


def _adjustments(planner, choices):
    """Height [m], pitch and roll [rad] added in each step."""
    if isinstance(planner.series, Tree):
        return adjustment_of(choices.adjust, planner.series.adjustments)
    return jnp.zeros(choices.adjust.shape, planner.gait.step_length.dtype)


def _in_mid_gait(planner, robot, terrain, stations, offset, feet):
    """The pose of the swings before the first step: the left feet came from one step behind."""
    back = stations.xy[0] - stations.xy[1]
    legs = np.array(LEFT_LEGS if planner.shared else STEP_LEGS[-1:])
    nominal = jax.vmap(nominal_offset, in_axes=(None, 0))(planner.gait, jnp.asarray(legs))
    yaw = stations.yaw[0]
    xy = (stations.xy[0] + back)[None] + turned(nominal + offset[legs], yaw)
    before = feet.at[legs].set(on_ground(robot, terrain, xy))
    leg, none = jnp.asarray(legs[-1]), jnp.zeros(3, feet.dtype)
    return planner.posture.swing(robot, planner.gait, before, feet, leg, none, yaw)


def _moves(planner, robot, site, shape: Layout, course: _Course) -> Moves:
    """What moves in each phase; beyond the last step everything stands."""
    step, count = jnp.asarray(shape.step, jnp.int32), course.count
    before, after = course.feet[jnp.minimum(step, count)], course.feet[jnp.minimum(step + 1, count)]
    shifts = jnp.asarray(shape.leg == SHIFT)

    def pose(index):
        return course.poses[jnp.where(index <= count, index, course.poses.shape[0] - 1)]  # beyond: the end's

    trunk_to = pose(step + 1)
    trunk_from = jnp.where(shifts[:, None], pose(step), trunk_to)
    return Moves(
        trunk_from=trunk_from,
        trunk_to=trunk_to,
        feet_from=before,
        feet_to=jnp.where(shifts[:, None, None], before, after),
        **_flights(planner, robot, site, shape, count, before, after),
    )


def _flights(planner, robot, site, shape: Layout, count, before, after):
    """Flight and leg of each swing; in a shift nothing flies."""
    row = np.flatnonzero(shape.leg != SHIFT)
    leg = shape.leg[row]
    start, end = before[row, leg], after[row, leg]
    flown = jax.vmap(planner.swing.flight, in_axes=(None, None, None, 0, 0))(robot, planner.gait, site.obstacles, start, end)
    on = (jnp.asarray(shape.step[row], jnp.int32) < count).astype(start.dtype)
    flight = jax.tree.map(lambda x: jnp.zeros((len(shape.leg), *x.shape[1:]), x.dtype).at[row].set(x), flown)
    return {"flight": flight, "swings": jnp.zeros((len(shape.leg), 4), start.dtype).at[row, leg].set(on)}


def lowered(
    planner: Planner, robot: Robot, shape: Layout, moves: Moves | Phases, poses: Float[Array, "pose 6"]
) -> tuple[Any, Float[Array, "pose 6"], Float[Array, ""]]:
    """Moves (or phases) and poses, the trunk lowered at each way-point until every leg keeps the least knee bend (A17), and how
    far at most [m].

    Distances to a fixed foot peak at the ends of a phase, those to a swinging one in between.
    """
    if planner.posture.lowering == "none":
        return moves, poses, jnp.zeros((), poses.dtype)
    shares = jnp.linspace(0.0, 1.0, 5, dtype=poses.dtype)

    def needed(move, share):
        pose = trunk_path(move, share)
        feet = foot_path(move, share, planner.swing.load_share)
        return jnp.max(lowering_needed(robot, pose, feet, planner.limits.knee_bend)[0])

    by_phase = jnp.max(jax.vmap(lambda s: jax.vmap(needed, in_axes=(0, None))(moves, s))(shares), axis=0)
    start, end = _way_points(planner, shape, poses.shape[0])
    down = jnp.zeros(poses.shape[0], poses.dtype).at[start].max(by_phase).at[end].max(by_phase)
    lower = jnp.zeros((1, 6), poses.dtype).at[0, 2].set(-1.0)
    trunk_from, trunk_to = moves.trunk_from + down[start][:, None] * lower, moves.trunk_to + down[end][:, None] * lower
    poses = poses + down[_first_alike(planner, np.arange(poses.shape[0]), poses.shape[0])][:, None] * lower
    return moves._replace(trunk_from=trunk_from, trunk_to=trunk_to), poses, jnp.max(down)


def _way_points(planner: Planner, shape: Layout, poses: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the poses that each phase begins and ends in; of poses that are one, the first."""
    before = np.where(shape.leg == SHIFT, shape.step, shape.step + 1)
    return _first_alike(planner, before, poses), _first_alike(planner, shape.step + 1, poses)


def _first_alike(planner: Planner, pose: np.ndarray, poses: int) -> np.ndarray:
    """The first of the poses that are one with each: a side's two swings share theirs, and a walk that does not come to stand
    ends in its last."""
    end = poses - 1 if planner.standing else poses - 2
    pose = np.minimum(pose, end)
    return np.where((pose > 0) & (pose < poses - 1), (pose - 1) // 2 * 2 + 1, pose) if planner.shared else pose


def _way(planner, stations, poses, count):
    """Way of the walk [m]: along its stations, or of the trunk along its heading where it goes on as it began."""
    if not planner.standing:
        ahead = stations.xy[-1] - stations.xy[0]
        return jnp.sum((poses[-1, :2] - poses[0, :2]) * ahead) / norm_safe(ahead)
    moved = norm_safe(jnp.diff(stations.xy, axis=0))
    return jnp.sum(jnp.where(jnp.arange(moved.shape[0], dtype=jnp.int32) < count // 2, moved, 0.0))
