"""A series of static gaits along a path: the states that the tree search chooses from, and what makes one reachable.

Paper C, Section 3: the legs swing in the order of the crawl; each step has a state (foothold, height, pitch, roll) that is
reached by shifting the trunk over the standing feet, in five key poses, and moving the foot along a box, in five key points
(3.2). One lane; `vmap` it over maps.
"""

import dataclasses
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import GRAVITY, LEG_END, LEG_SIDE
from jaxleg.foothold.rectangle import cells_around, to_heading
from jaxleg.gait.order import STEP_LEGS
from jaxleg.gait.support import stability_margin
from jaxleg.leg.dynamics import Motion, all_leg_frames, torques_on_ground
from jaxleg.leg.energy import motor_power
from jaxleg.leg.kinematics import Reach, knee_bend, range_slack
from jaxleg.posture.body import com_position, joint_angles
from jaxleg.posture.collision import Obstacles, highest_near, leg_clearance, trunk_clearance
from jaxleg.posture.plane import PosePlan, shift_time, stand_pose, swing_pose
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_rotation
from jaxleg.route.stations import Stations
from jaxleg.swing.cycloid import cycloid_advance, cycloid_lift
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.candidates import Adjustments, Cause, Counts, adjustment, place_of, pruned
from jaxleg.walk.crawl import on_ground
from jaxleg.walk.tree import Nodes, Series, Tried, search

SHIFT_SHARES = (0.2, 0.4, 0.6, 0.8)  # Table 2: five equal parts of the shift, the last of them the swing's start
BOX = ((0.0, 0.0), (0.0, 1.0), (0.5, 1.0), (1.0, 1.0), (1.0, 0.0))  # Table 1: (part of the way, part of the height)
SWING_LOOKS = np.linspace(0.15, 0.85, 33)  # shares of a swing at which its ground is looked at: every 1/14 step at most
Order = Literal["paper", "energy"]


class State(NamedTuple):
    """Where the feet stand, and the trunk pose in which the last one swung."""

    feet: Float[Array, "leg 3"]  # centres in W [m]
    pose: Float[Array, "6"]


class Scene(NamedTuple):
    """The ground of one lane."""

    terrain: HeightMap
    valid: Bool[Array, "nx ny"]  # where a foot may stand
    cost: Float[Array, "leg heading nx ny"]  # of standing there, in [0, 1] (C6)
    obstacles: Obstacles


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class GaitPlan:
    """What a series of gaits is planned with. `counts`, `cells` and `order` are static, all else leaves."""

    pose: PosePlan
    adjustments: Adjustments
    stance_length: Float[Array, "*batch"]  # L_Stance [m]
    stance_width: Float[Array, "*batch"]  # W_Stance [m]
    search_length: Float[Array, "*batch"]  # of the rectangle round the default foothold, along the heading [m]
    search_width: Float[Array, "*batch"]
    cost_weight: Float[Array, "*batch"]  # footholds are ordered by this times their cost ...
    distance_weight: Float[Array, "*batch"]  # ... plus this times the distance to the default one over half the diagonal
    energy_weight: Float[Array, "*batch"]  # the order "energy" adds this times the energy of a step in the pose ...
    energy: Float[Array, "*batch"]  # ... over this much [J]
    acceleration: Float[Array, "*batch"]  # most of the trunk in a shift [m/s^2]
    swing_time: Float[Array, "*batch"]  # about what a swing takes [s]
    least_bend: Float[Array, "*batch"]  # of every knee [rad]
    least_margin: Float[Array, "*batch"]  # stability margin [m]
    clearance: Float[Array, "*batch"]  # of a swinging foot over the ground [m]
    swing_height: Float[Array, "*batch"]  # least apex over the higher end [m]
    lift_share: Float[Array, "*batch"]  # part of a swing at either end straight up or down
    counts: Counts = dataclasses.field(metadata={"static": True})
    cells: int = dataclasses.field(metadata={"static": True})  # looked at either way of a default foothold
    order: Order = dataclasses.field(default="paper", metadata={"static": True})
    prune: bool = dataclasses.field(default=True, metadata={"static": True})


class Footing(NamedTuple):
    """Candidate footholds of a step, best first."""

    foot: Float[Array, "foothold 3"]  # foot centre in W [m]
    exists: Bool[Array, "foothold"]
    cost: Float[Array, "foothold"]


def default_foothold(plan: GaitPlan, stations: Stations, station: Int[Array, ""], leg: Int[Array, ""]) -> Float[Array, "2"]:
    """Where a leg stands (x, y in W) [m] when the stance has reached a station."""
    last = stations.yaw.shape[0] - 1
    xy, yaw = stations.xy[jnp.minimum(station, last)], stations.yaw[jnp.minimum(station, last)]
    ahead = 0.5 * jnp.asarray(LEG_END, xy.dtype)[leg] * plan.stance_length
    aside = 0.5 * jnp.asarray(LEG_SIDE, xy.dtype)[leg] * plan.stance_width
    c, s = jnp.cos(yaw), jnp.sin(yaw)
    return xy + jnp.stack([c * ahead - s * aside, s * ahead + c * aside])


def footing(
    robot: Robot, plan: GaitPlan, scene: Scene, default: Float[Array, "2"], yaw: Float[Array, ""], leg: Int[Array, ""]
) -> Footing:
    """The best valid cells of the rectangle round a default foothold, turned to the heading. Paper C, (23)."""
    resolution, shape = scene.terrain.resolution, jnp.array([scene.valid.shape], jnp.int32)
    origin, default = scene.terrain.origin[None], default[None]
    middle = jnp.round((default - origin) / resolution).astype(jnp.int32)
    cell = middle + jnp.asarray(cells_around((plan.cells, plan.cells)), jnp.int32).reshape(-1, 2)
    xy = origin + resolution * cell.astype(default.dtype)
    along = jnp.abs(to_heading(xy - default, yaw))
    inside = jnp.all((cell >= 0) & (cell < shape), axis=1) & jnp.all(2.0 * along <= _rectangle(plan)[None] + 1e-4, axis=1)
    safe = jnp.clip(cell, 0, shape - 1)
    heading = jnp.round(yaw / (0.25 * jnp.pi)).astype(jnp.int32) % 8
    near = jnp.linalg.norm(xy - default, axis=1) / (0.5 * jnp.linalg.norm(_rectangle(plan)))
    value = plan.cost_weight * scene.cost[leg, heading, safe[:, 0], safe[:, 1]] + plan.distance_weight * near
    usable = inside & scene.valid[safe[:, 0], safe[:, 1]] & jnp.isfinite(value)
    worth, best = jax.lax.top_k(jnp.where(usable, -value, -jnp.inf), plan.counts.footholds)
    return Footing(on_ground(robot, scene.terrain, xy[best]), jnp.isfinite(worth), -worth)


def _rectangle(plan: GaitPlan):
    return jnp.stack([plan.search_length, plan.search_width])


def swing_apex(plan: GaitPlan, ground: Obstacles, start: Float[Array, "3"], end: Float[Array, "3"]) -> Float[Array, ""]:
    """Apex [m] of a swing over its higher end: the least one, raised until the foot clears the ground near all of its way.

    Between two looks the ground counts as the higher one's and the foot as the lower one's.
    """
    shares = jnp.asarray(SWING_LOOKS, start.dtype)
    along = cycloid_advance(jnp.clip((shares - plan.lift_share) / (1.0 - 2.0 * plan.lift_share), 0.0, 1.0))
    path = start[None, :2] + (end - start)[None, :2] * along[:, None]
    high = jax.vmap(highest_near, in_axes=(None, 0))(ground, path)
    base, lift = jnp.where(shares < 0.5, start[2], end[2]), cycloid_lift(shares)
    high, base, lift = (f(x[1:], x[:-1]) for f, x in ((jnp.maximum, high), (jnp.minimum, base), (jnp.minimum, lift)))
    top = base + (high + plan.clearance * lift - base) / lift
    return jnp.maximum(jnp.max(top) - jnp.maximum(start[2], end[2]), plan.swing_height)


class Look(NamedTuple):
    """What one key pose shows."""

    reach: Bool[Array, ""]
    margin: Float[Array, ""]
    legs: Float[Array, "leg"]  # clearance [m]
    trunk: Float[Array, ""]


def _look(robot: Robot, plan: GaitPlan, ground: Obstacles, pose, feet, loaded) -> Look:
    angles, status = joint_angles(robot, pose, feet)
    bend = jax.vmap(knee_bend)(robot.joint_axis, robot.link_offset, angles)
    bent = (bend >= plan.least_bend) & (status == Reach.OK)
    within = (range_slack(robot.joint_range, angles) >= 0.0) & bent[:, None]
    com = com_position(robot, pose, angles)
    margin = stability_margin(com[:2], feet[:, :2], loaded)
    legs = leg_clearance(robot, ground, pose, angles)
    return Look(jnp.all(within), margin, legs, trunk_clearance(robot, ground, pose))


def transition(
    robot: Robot, plan: GaitPlan, ground: Obstacles, state: State, leg: Int[Array, ""], target: Float[Array, "3"], pose
) -> Int[Array, ""]:
    """Why a step cannot be made (`Cause`, NONE if it can): key poses of the shift, key points of the swing. Paper C, 3.2."""
    start = state.feet[leg]
    top = jnp.maximum(start[2], target[2]) + swing_apex(plan, ground, start, target)
    shares = jnp.asarray(SHIFT_SHARES, pose.dtype)[:, None]
    poses = jnp.concatenate([state.pose[None] + shares * (pose - state.pose)[None], jnp.broadcast_to(pose, (len(BOX), 6))])
    way, lift = jnp.asarray(BOX, pose.dtype).T[:, :, None]
    base = jnp.where(way < 0.5, start, target)[:, 2:]
    foot = jnp.concatenate([start[None, :2] + way * (target - start)[None, :2], base + lift * (top - base)], axis=1)
    swinging = (jnp.arange(4) == leg)[None]
    held = jnp.broadcast_to(state.feet, (len(SHIFT_SHARES), 4, 3))
    feet = jnp.concatenate([held, jnp.where(swinging[..., None], foot[:, None], state.feet[None])])
    in_swing = (jnp.arange(poses.shape[0]) >= len(SHIFT_SHARES))[:, None]
    seen = jax.vmap(lambda *x: _look(robot, plan, ground, *x))(poses, feet, ~(swinging & in_swing))
    touched = jnp.any(seen.legs < 0.0, axis=0)
    finite = jnp.isfinite(jnp.sum(pose) + jnp.sum(target) + top)
    causes = [
        (~finite, Cause.NOT_FINITE),
        (~jnp.all(seen.reach), Cause.KINEMATICS),
        (jnp.min(seen.margin) < plan.least_margin, Cause.STABILITY),
        (touched[2] | touched[3], Cause.HIND_LEG),
        (touched[0], Cause.LEFT_LEG),
        (touched[1] | (jnp.min(seen.trunk) < 0.0), Cause.COLLISION),
    ]
    return jnp.select([bad for bad, _ in causes], [cause for _, cause in causes], Cause.NONE).astype(jnp.int32)


def holding_power(
    robot: Robot, feet: Float[Array, "leg 3"], pose: Float[Array, "6"], weight: Float[Array, "leg"]
) -> Float[Array, ""]:
    """Joule power [W] of holding a pose, its feet loaded by `weight` (1 standing, 0 in the air). Paper A, (1) and (3)."""
    angles, _ = joint_angles(robot, pose, feet)
    up = trunk_rotation(pose[3:])[2]
    still = jnp.zeros_like(angles)
    motion = Motion(still, still, jnp.zeros_like(up), jnp.zeros_like(up), GRAVITY * up)
    torque, _ = torques_on_ground(robot, all_leg_frames(robot, angles), motion, weight, up)
    return jnp.sum(motor_power(robot, torque, still).joule)


def gait_nodes(robot: Robot, plan: GaitPlan, scene: Scene, stations: Stations) -> Nodes:
    """The tree of paper C's search: states of the steps along the stations."""
    legs = jnp.array(STEP_LEGS)

    def expand(state: State, step):
        leg, station = legs[step % 4], step // 2 + 2
        yaw = stations.yaw[jnp.minimum(station, stations.yaw.shape[0] - 1)]
        seen = footing(robot, plan, scene, default_foothold(plan, stations, station, leg), yaw, leg)
        return seen, _order(robot, plan, state, leg, seen)

    def attempt(state: State, seen: Footing, step, candidate):
        """Whether one candidate can be stepped to and the state there, or why not and which others that rules out."""
        leg, place = legs[step % 4], place_of(candidate, plan.counts)
        target = seen.foot[place.foothold]
        feet = state.feet.at[leg].set(target)
        adjust = adjustment(place, plan.adjustments, plan.counts)
        pose = swing_pose(robot, plan.pose, state.feet, feet, leg, adjust, state.pose[5])
        cause = transition(robot, plan, scene.obstacles, state, leg, target, pose)
        cause = jnp.where(seen.exists[place.foothold], cause, Cause.NO_FOOTHOLD).astype(jnp.int32)
        gone = pruned(candidate, cause, plan.counts)
        if not plan.prune:
            gone = gone & (cause == Cause.NO_FOOTHOLD)
        return Tried(cause == Cause.NONE, State(feet, pose), gone, cause)

    return Nodes(expand, attempt)


def _order(robot: Robot, plan: GaitPlan, state: State, leg, seen: Footing) -> Int[Array, "candidate"]:
    """Candidates in the order of trial: paper C's (28), or by cost of the foothold plus energy of the step.

    The energy is the power of holding the pose for as long as the shift to it and the swing take: a better pose must be worth
    the time of going there. It is worked out over the best foothold: the pose decides it, the foothold hardly.
    """
    counts = plan.counts
    if plan.order == "paper":
        return jnp.arange(counts.candidates)
    poses = counts.candidates // counts.footholds
    adjust = adjustment(place_of(np.arange(poses), counts), plan.adjustments, counts)
    feet = state.feet.at[leg].set(seen.foot[0])
    weight = (jnp.arange(4) != leg).astype(feet.dtype)

    def energy(adjust):
        pose = swing_pose(robot, plan.pose, state.feet, feet, leg, adjust, state.pose[5])
        seconds = shift_time(state.pose, pose, plan.acceleration) + plan.swing_time
        return holding_power(robot, feet, pose, weight) * seconds

    value = plan.energy_weight / plan.energy * jax.vmap(energy)(adjust)
    return jnp.argsort((seen.cost[:, None] + jnp.nan_to_num(value, nan=jnp.inf)[None]).reshape(-1))


def first_state(robot: Robot, plan: GaitPlan, scene: Scene, stations: Stations) -> tuple[State, Bool[Array, ""]]:
    """The stance that the walk begins in, each foot on its best cell, and whether all four have one.

    The right feet stand at the first station, the left ones at the second: they swing last. A foot without a valid cell in
    its rectangle looks in one half as large again: no step before it binds its reach.
    """
    wide = dataclasses.replace(
        plan, search_length=1.5 * plan.search_length, search_width=1.5 * plan.search_width, cells=-(-3 * plan.cells // 2)
    )

    def choose(leg, station):
        default, yaw = default_foothold(plan, stations, station, leg), stations.yaw[station]
        near, far = (footing(robot, p, scene, default, yaw, leg) for p in (plan, wide))
        return jnp.where(near.exists[0], near.foot[0], far.foot[0]), near.exists[0] | far.exists[0]

    legs = jnp.arange(4)
    feet, found = jax.vmap(choose)(legs, jnp.where(legs % 2 == 0, 1, 0))
    level = jnp.stack([plan.adjustments.height, *jnp.zeros(2, feet.dtype)])
    return State(feet, stand_pose(robot, plan.pose, feet, level, stations.yaw[0])), jnp.all(found)


def gait_series(
    robot: Robot, plan: GaitPlan, scene: Scene, stations: Stations, root: State, steps: int, depth: int, budget: Int[Array, ""]
) -> Series:
    """The series of states from `root` along the stations, `steps` at most; `depth` and `budget` as in `search`."""
    count = jnp.minimum(2 * stations.count, steps)
    return search(gait_nodes(robot, plan, scene, stations), root, count, steps, depth, budget)
