"""From a map, a start and a goal to a walk: cost map, body path, stations, a series of static gaits, phases. Paper C.

`Navigator` offers each stage for one lane; `vmap` over maps. Where no gait leads along a path, the ground at the dead end is
closed and another path is tried (`detour`).
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import HEADINGS, LEGS
from jaxleg.gait.params import GaitParams
from jaxleg.numerics import Code
from jaxleg.posture.collision import obstacles, trunk_spacing
from jaxleg.posture.incentre import CogPlan
from jaxleg.posture.plane import PosePlan
from jaxleg.robot import Robot
from jaxleg.route.path import BodyPath, PathStatus, PathWeights, find_path
from jaxleg.route.stations import Route, Stations, Stride, smooth_route, stations
from jaxleg.terrain.cost_map import CostMap, Windows, cost_weights, total_cost
from jaxleg.terrain.features import FeatureSettings, traversability
from jaxleg.terrain.foothold_cost import foothold_cost, least_footing
from jaxleg.terrain.foothold_features import foothold_features
from jaxleg.terrain.heightmap import HeightMap, nearest_cell
from jaxleg.terrain.validity import steepest_side, valid_cells
from jaxleg.walk.candidates import Adjustments, Counts
from jaxleg.walk.config import Navigation
from jaxleg.walk.data import Phases, Reference
from jaxleg.walk.gaits import GaitPlan, Scene, State, first_state, gait_series
from jaxleg.walk.reference import phase_instants, phase_samples, to_reference
from jaxleg.walk.tree import SearchStatus
from jaxleg.walk.walking import Timing, phase_legs, walk_phases


class NavigationStatus(Code):
    """Outcome of planning a walk; anything but `OK` is counted, never averaged over."""

    OK = 0
    NO_PATH = 1
    START_BLOCKED = 2
    GOAL_BLOCKED = 3
    TOO_LONG = 4  # more cells or steps than allowed
    NO_STANCE = 5  # no valid cell for some foot at the start
    DEAD_END = 6  # no state leads on
    BUDGET = 7  # as many candidates tried as allowed


class Survey(NamedTuple):
    """What is worked out of a map once."""

    scene: Scene
    cost: CostMap


class Walked(NamedTuple):
    """A planned walk of one lane: the path, and the states before each step and at the end."""

    status: Int[Array, ""]  # NavigationStatus
    path: BodyPath
    stations: Stations
    states: State  # leading axis step + 1
    count: Int[Array, ""]  # steps
    visited: Int[Array, ""]  # candidates tried
    causes: Int[Array, "cause"]
    stuck: Float[Array, "2"]  # where the search went no further (x, y) [m]


class Planned(NamedTuple):
    """A walk in time."""

    phases: Phases
    reference: Reference
    last: Int[Array, ""]  # the reference's last sample that takes part: the end of the final shift
    knee_bend: Float[Array, ""]  # least [rad]
    torque_ratio: Float[Array, ""]  # greatest |torque| over its limit


@dataclasses.dataclass(frozen=True)
class Navigator:
    """The robot and all numbers of a planner; `resolution` [m per cell] and the settings are static."""

    robot: Robot
    settings: Navigation
    gait: GaitPlan
    stride: Stride
    timing: Timing
    windows: Windows  # of the cost map, the feet where the gait puts them
    resolution: float

    def survey(self, terrain: HeightMap) -> Survey:
        """Costs of the ground, valid cells and obstacles of a map. Paper C, 2.1 and 2.2.

        Beyond the paper a path needs valid cells round every default foothold (`footing.least_share`).
        """
        dtype, resolution = terrain.elevation.dtype, self.resolution
        weights = jax.tree.map(lambda x: x.astype(dtype), cost_weights(self.settings.cost))
        features = foothold_features(terrain, resolution, self.windows.foothold)
        cost = total_cost(terrain, features, resolution, self.windows, weights)
        angles = 0.25 * jnp.pi * jnp.arange(len(HEADINGS), dtype=dtype)

        def of_leg(leg):  # one heading after another: a vmap would hold the scores of all of them at once
            return jax.lax.map(lambda angle: foothold_cost(features, weights.feet, leg, angle), angles)

        foot = jax.lax.map(of_leg, jnp.arange(len(LEGS)))
        scene = Scene(terrain, self.valid(terrain), foot, self.obstacles(terrain))
        footing = least_footing(scene.valid, resolution, self.windows.feet) >= self.settings.footing.least_share
        return Survey(scene, cost._replace(total=jnp.where(footing, cost.total, jnp.inf)))

    def valid(self, terrain: HeightMap) -> Bool[Array, "nx ny"]:
        """Where a foot may be placed."""
        rule, radius = self.settings.footing, float(self.robot.foot_radius)
        easy = traversability(terrain, self.resolution, FeatureSettings()) >= rule.least_traversability
        firm = steepest_side(terrain) <= float(np.deg2rad(rule.side_slope_limit_deg))
        slope = float(np.deg2rad(rule.slope_limit_deg))
        return valid_cells(terrain, self.resolution, radius, slope, rule.edge_height, easy) & firm

    def obstacles(self, terrain: HeightMap):
        """The map widened for legs and trunk."""
        radius = max(float(self.robot.leg_radius), float(self.robot.foot_radius))
        return obstacles(terrain, self.resolution, radius, trunk_spacing(np.asarray(self.robot.trunk_size)))

    def path(self, terrain: HeightMap, cost: Float[Array, "heading nx ny"], start: Float[Array, "2"], goal: Float[Array, "2"]):
        """The body path between two points (x, y in W) [m]. Paper C, 2.3."""
        weights = PathWeights(
            *(jnp.asarray(x, cost.dtype) for x in (self.settings.path.mu_distance, self.settings.path.mu_cost))
        )
        ends = (nearest_cell(terrain, xy) for xy in (start, goal))
        return find_path(cost, *ends, weights, jnp.full(2, self.resolution, cost.dtype), self.settings.path.cells)

    def route(self, terrain: HeightMap, path: BodyPath) -> Route:
        """The path, smoothed."""
        points = terrain.origin[None] + terrain.resolution * path.cells.astype(terrain.origin.dtype)
        spacing, window = (jnp.asarray(x, points.dtype) for x in (0.5 * self.resolution, self.settings.path.smoothing))
        return smooth_route(points, jnp.maximum(path.length, 1), spacing, window, 3 * self.settings.path.cells)

    def walk(self, survey: Survey, start: Float[Array, "2"], goal: Float[Array, "2"], closed: Bool[Array, "nx ny"]) -> Walked:
        """Path, stations and the series of gaits; `closed` cells are not walked over (detours). Paper C."""
        cost = jnp.where(closed, jnp.inf, survey.cost.total)
        return self.along(survey.scene, self.path(survey.scene.terrain, cost, start, goal))

    def along(self, scene: Scene, path: BodyPath) -> Walked:
        """Stations and the series of gaits along a body path. Paper C, 3."""
        settings, route = self.settings, self.route(scene.terrain, path)
        steps = settings.path.steps
        seen = stations(route, self.stride, route.direction[0], steps // 2 + 3)
        root, standing = first_state(self.robot, self.gait, scene, seen)
        tree = settings.tree
        usable = (path.status == PathStatus.OK) & standing
        seen = seen._replace(count=jnp.where(usable, seen.count, 0))
        found = gait_series(self.robot, self.gait, scene, seen, root, steps, tree.depth, jnp.asarray(tree.budget))
        status = jnp.where(found.status == SearchStatus.DEAD_END, NavigationStatus.DEAD_END, NavigationStatus.OK)
        status = jnp.where(found.status == SearchStatus.BUDGET, NavigationStatus.BUDGET, status)
        status = jnp.where(2 * seen.count > steps, NavigationStatus.TOO_LONG, status)
        status = jnp.where(standing, status, NavigationStatus.NO_STANCE)
        status = jnp.where(path.status == PathStatus.OK, status, path.status).astype(jnp.int32)
        ahead = found.states.pose[found.furthest][5]
        stuck = found.states.pose[found.furthest][:2] + 0.2 * jnp.stack([jnp.cos(ahead), jnp.sin(ahead)])
        return Walked(status, path, seen, found.states, found.step, found.visited, found.causes, stuck)

    def detour(self, terrain: HeightMap, walked: Walked, closed: Bool[Array, "nx ny"]) -> Bool[Array, "nx ny"]:
        """`closed` with the ground round a walk's dead end."""
        i, j = (terrain.resolution * jnp.arange(n, dtype=terrain.resolution.dtype) for n in closed.shape)
        x, y = walked.stuck - terrain.origin
        return closed | (jnp.hypot(i[:, None] - x, j[None, :] - y) < self.settings.path.detour_radius)

    @property
    def samples(self) -> tuple[int, int]:
        """Reference samples a shift and a swing."""
        return self.settings.pace.shift_samples, self.settings.pace.swing_samples

    def planned(self, survey: Survey, walked: Walked) -> Planned:
        """A walk's phases and reference; standing where there is no walk."""
        count = jnp.where(walked.status == NavigationStatus.OK, walked.count, 0)
        ground, steps = survey.scene.obstacles, self.settings.path.steps
        phases, valid = walk_phases(self.robot, self.gait, self.timing, ground, walked.states, count)
        legs = phase_legs(steps)
        time, at = phase_instants(self.robot, phases, legs, self.gait.lift_share, self.timing.load_share, self.samples)
        used = valid[phase_samples(self.samples, legs)[0]]
        bend = jnp.min(jnp.where(used[:, None], at.bend, jnp.inf))
        ratio = jnp.max(jnp.where(used[:, None, None], jnp.abs(at.torque) / self.robot.torque_limit[None], 0.0))
        return Planned(phases, to_reference(time, at), count * sum(self.samples) + self.samples[0], bend, ratio)


def make_navigator(
    robot: Robot, settings: Navigation, gait: GaitParams, load_share: float, clearance: float, resolution: float
) -> Navigator:
    """The planner of a robot with a gait's stance, height, step and swing height; lengths [m]."""
    tree, pose, pace = settings.tree, settings.pose, settings.pace
    number = lambda x: jnp.asarray(x, float)  # noqa: E731
    degrees = lambda x: number(np.deg2rad(x))  # noqa: E731
    cog = CogPlan(number(pose.median_ratio), number(0.0), pose.rule)
    half = 0.5 * float(np.hypot(tree.search_length, tree.search_width))
    plan = GaitPlan(
        pose=PosePlan(cog, number(pose.target_weight), number(pose.levelling)),
        adjustments=Adjustments(
            number(gait.hip_height), number(tree.height_step), degrees(tree.pitch_step_deg), degrees(tree.roll_step_deg)
        ),
        **{name: number(getattr(gait, name)) for name in ("stance_length", "stance_width", "swing_height")},
        **{name: number(getattr(tree, name)) for name in ("search_length", "search_width", "cost_weight", "distance_weight")},
        **{name: number(getattr(tree, name)) for name in ("energy_weight", "energy")},
        acceleration=number(pace.acceleration),
        swing_time=number(pace.least_swing / (1.0 - 2.0 * load_share)),
        least_bend=degrees(pose.least_knee_bend_deg),
        least_margin=number(pose.least_margin),
        clearance=number(clearance),
        lift_share=number(pace.lift_share),
        counts=Counts(tree.footholds, tree.rolls, tree.pitches, tree.heights),
        cells=int(np.ceil(half / resolution)),
        order=tree.order,
        prune=tree.prune,
    )
    radius = 0.5 * float(np.hypot(gait.stance_length, gait.stance_width))
    stride = Stride(number(gait.step_length), degrees(settings.path.turn_deg), number(radius))
    timing = Timing(
        **{
            name: number(getattr(pace, name))
            for name in ("acceleration", "least_shift", "reserve", "foot_speed", "least_swing")
        },
        load_share=number(load_share),
    )
    x, y = 0.5 * float(gait.stance_length), 0.5 * float(gait.stance_width)
    stance = ((x, y), (x, -y), (-x, y), (-x, -y))
    feet = dataclasses.replace(settings.cost.windows.feet, stance=stance)
    windows = dataclasses.replace(settings.cost.windows, feet=feet)
    return Navigator(robot, settings, plan, stride, timing, windows, resolution)
