"""From a map, a start and a goal to a walk: cost map, body path, stations, choices, the walk. Paper C.

`Navigator` offers each stage for one lane; `vmap` over maps. Where no gait leads along a path, the ground at the dead end is
closed and another path is tried (`detour`).
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.conventions import HEADINGS, LEGS
from jaxleg.gait.params import GaitParams
from jaxleg.planner import Planner
from jaxleg.posture.collision import Sizes
from jaxleg.robot.model import Robot
from jaxleg.route.path import BodyPath, PathWeights, find_path
from jaxleg.route.stations import Line, Stations, smoothed
from jaxleg.status import Status
from jaxleg.terrain.cost_map import CostMap, cost_weights, total_cost
from jaxleg.terrain.foothold_cost import Stance, foothold_cost, least_footing
from jaxleg.terrain.foothold_features import foothold_features
from jaxleg.terrain.footing import FootingRule
from jaxleg.terrain.heightmap import HeightMap, nearest_cell
from jaxleg.terrain.site import Site
from jaxleg.walk.build import build_walk
from jaxleg.walk.choices import Choices
from jaxleg.walk.choose import choose
from jaxleg.walk.config import Navigation
from jaxleg.walk.data import Reference, Walk
from jaxleg.walk.feasible import count_causes
from jaxleg.walk.presets import paper_c
from jaxleg.walk.proxy import checks, needs_at
from jaxleg.walk.reference import instants, last_sample, phase_samples, to_reference
from jaxleg.walk.site import site_of


class Survey(NamedTuple):
    """What is worked out of a map once."""

    site: Site
    cost: CostMap


class Walked(NamedTuple):
    """A planned walk of one lane: the path, and the walk along it as far as it goes."""

    status: Int[Array, ""]  # Status
    path: BodyPath
    stations: Stations
    choices: Choices
    walk: Walk
    visited: Int[Array, ""]  # candidates tried
    causes: Int[Array, "cause"]  # of these, those that failed, by Status
    stuck: Float[Array, "2"]  # where the search went no further (x, y) [m]


class Planned(NamedTuple):
    """A walk in time."""

    reference: Reference
    last: Int[Array, ""]  # the reference's last sample that takes part: the end of the final shift
    knee_bend: Float[Array, ""]  # least [rad]
    torque_ratio: Float[Array, ""]  # greatest |torque| over its limit


@dataclasses.dataclass(frozen=True)
class Navigator:
    """The robot and all numbers of a planner; `resolution` [m per cell] and the settings are static."""

    robot: Robot
    settings: Navigation
    planner: Planner
    stance: Stance  # where the gait puts the feet
    resolution: float
    programs: Path | None = None  # folder in which traced programs are kept for later processes

    def survey(self, terrain: HeightMap) -> Survey:
        """Costs of the ground, valid cells and obstacles of a map. Paper C, 2.1 and 2.2.

        Beyond the paper a path needs valid cells round every default foothold (`footing.least_share`).
        """
        dtype, resolution = terrain.elevation.dtype, self.resolution
        weights = jax.tree.map(lambda x: x.astype(dtype), cost_weights(self.settings.cost))
        windows = self.settings.cost.windows
        features = foothold_features(terrain, resolution, windows.foothold)
        cost = total_cost(terrain, features, resolution, windows, self.stance, weights)
        angles = 0.25 * jnp.pi * jnp.arange(len(HEADINGS), dtype=dtype)

        def of_leg(leg):  # one heading after another: a vmap would hold the scores of all of them at once
            return jax.lax.map(lambda angle: foothold_cost(features, weights.feet, leg, angle), angles)

        foot = jax.lax.map(of_leg, jnp.arange(len(LEGS)))
        site = self.site(terrain)._replace(cost=foot)
        enough = least_footing(site.valid, resolution, windows.feet, self.stance) >= self.settings.footing.least_share
        return Survey(site, cost._replace(total=jnp.where(enough, cost.total, jnp.inf)))

    def site(self, terrain: HeightMap) -> Site:
        """Where a foot may be placed, and the map widened for legs and trunk."""
        rule = self.settings.footing
        limits = (rule.slope_limit_deg, rule.edge_height, rule.least_traversability, rule.side_slope_limit_deg)
        return site_of(FootingRule(*limits), Sizes.of(self.robot), self.resolution, terrain)

    def path(self, terrain: HeightMap, cost: Float[Array, "heading nx ny"], start: Float[Array, "2"], goal: Float[Array, "2"]):
        """The body path between two points (x, y in W) [m]. Paper C, 2.3."""
        weights = PathWeights(
            *(jnp.asarray(x, cost.dtype) for x in (self.settings.path.mu_distance, self.settings.path.mu_cost))
        )
        ends = (nearest_cell(terrain, xy) for xy in (start, goal))
        return find_path(cost, *ends, weights, jnp.full(2, self.resolution, cost.dtype), self.settings.path.cells)

    def line(self, terrain: HeightMap, path: BodyPath) -> Line:
        """The path, smoothed."""
        points = terrain.origin[None] + terrain.resolution * path.cells.astype(terrain.origin.dtype)
        spacing, window = (jnp.asarray(x, points.dtype) for x in (0.5 * self.resolution, self.settings.path.smoothing))
        return smoothed(points, jnp.maximum(path.length, 1), spacing, window, 3 * self.settings.path.cells)

    @property
    def steps(self) -> int:
        """Most steps of a walk, whole cycles."""
        return -(-self.settings.path.steps // 4) * 4

    def stations(self, terrain: HeightMap, path: BodyPath) -> Stations:
        """Stations along a body path."""
        return self.planner.route.stations(self.planner.gait, self.line(terrain, path), self.steps // 2 + 3)

    def walk(self, survey: Survey, start: Float[Array, "2"], goal: Float[Array, "2"], closed: Bool[Array, "nx ny"]) -> Walked:
        """Path, stations and the series of gaits; `closed` cells are not walked over (detours). Paper C."""
        cost = jnp.where(closed, jnp.inf, survey.cost.total)
        return self.along(survey.site, self.path(survey.site.terrain, cost, start, goal))

    def along(self, site: Site, path: BodyPath) -> Walked:
        """Stations, the choices and the walk along a body path. Paper C, 3."""
        seen = self.stations(site.terrain, path)
        usable = seen._replace(count=jnp.where(path.status == Status.OK, seen.count, 0))
        choices, series = choose(self.planner, self.robot, site, usable, self.steps)
        planned = build_walk(self.planner, self.robot, site, seen, choices)
        causes = count_causes(self.planner, self.robot, site, planned) if series is None else series.causes
        refused = jnp.any(causes[1:] > 0) & (series is None) & (choices.status == Status.OK)
        status = jnp.where(refused, Status.DEAD_END, choices.status)
        status = jnp.where(2 * seen.count > self.settings.path.steps, Status.TOO_LONG, status)
        status = jnp.where(choices.status == Status.NO_STANCE, choices.status, status)
        status = jnp.where(path.status == Status.OK, status, path.status).astype(jnp.int32)
        furthest = planned.poses[choices.count] if series is None else series.states.pose[series.furthest]
        stuck = furthest[:2] + 0.2 * jnp.stack([jnp.cos(furthest[5]), jnp.sin(furthest[5])])
        visited = choices.count if series is None else series.visited
        return Walked(status, path, seen, choices, planned, visited, causes, stuck)

    def detour(self, terrain: HeightMap, walked: Walked, closed: Bool[Array, "nx ny"]) -> Bool[Array, "nx ny"]:
        """`closed` with the ground round a walk's dead end."""
        i, j = (terrain.resolution * jnp.arange(n, dtype=terrain.resolution.dtype) for n in closed.shape)
        x, y = walked.stuck - terrain.origin
        return closed | (jnp.hypot(i[:, None] - x, j[None, :] - y) < self.settings.path.detour_radius)

    @property
    def samples(self) -> tuple[int, int]:
        """Reference samples a shift and a swing."""
        return self.settings.pace.shift_samples, self.settings.pace.swing_samples

    def planned(self, walked: Walked) -> Planned:
        """A walk's reference; where there is no walk to the goal only its first shift takes part."""
        made = walked.walk
        time, at = instants(self.robot, made, self.samples)
        used = made.used[phase_samples(self.samples, made.legs)[0]]
        seen = checks(self.robot, made, at, needs_at(self.robot, at, used), used)
        last = jnp.where(walked.status == Status.OK, last_sample(made, self.samples), self.samples[0])
        return Planned(to_reference(time, at), last.astype(jnp.int32), seen.knee_bend, seen.torque_ratio)


def make_navigator(
    robot: Robot,
    settings: Navigation,
    gait: GaitParams,
    load_share: float,
    clearance: float,
    resolution: float,
    programs: Path | None = None,
) -> Navigator:
    """Paper C's planner of a robot with a gait's stance, height, step and swing height; lengths [m]."""
    planner = paper_c(settings, gait, load_share, clearance, resolution)
    x, y = 0.5 * float(gait.stance_length), 0.5 * float(gait.stance_width)
    return Navigator(robot, settings, planner, ((x, y), (x, -y), (-x, y), (-x, -y)), resolution, programs)
