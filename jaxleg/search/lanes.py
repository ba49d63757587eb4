"""What a search evaluates, one lane at a time: the proxy, the simulation, and how far each constraint is from binding.

A lane is a planner on one terrain; the vector that a search moves takes the place of its numbers of the names in `Lab.move`.
`Lab` holds what all lanes share and offers the batched, compiled functions.
"""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.batch import Picked, in_chunks, on_devices, over_lanes
from jaxleg.gait.limits import gait_constraints
from jaxleg.leg.energy import CONVENTIONS, Convention, Power, electrical
from jaxleg.planner import Planner
from jaxleg.posture.workspace import nominal_rooms
from jaxleg.programs import of_method
from jaxleg.robot import Robot
from jaxleg.route.stations import Stations
from jaxleg.search.config import EngineName, Span
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.search.model import Model, linearised
from jaxleg.search.penalty import fine
from jaxleg.search.worlds import Truth, set_down
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Engine, mjx_engine
from jaxleg.sim.legged import legged_engine
from jaxleg.sim.meters import Meters
from jaxleg.sim.rollout import simulate
from jaxleg.terrain.site import Site
from jaxleg.walk.build import build_walk
from jaxleg.walk.choices import Choices
from jaxleg.walk.choose import choose
from jaxleg.walk.data import PlanChecks, Reference, Walk
from jaxleg.walk.proxy import Needs, evaluate, needs_at
from jaxleg.walk.proxy import checks as plan_checks
from jaxleg.walk.reference import instants, to_reference

CYCLES = 2  # of a walk, both metered: it starts in its own periodic posture, so that there is nothing to warm up
OF_PLAN = ("knee_bend", "margin", "torque", "load", "joint_range")
CONSTRAINTS = (*OF_PLAN, "search_behind", "step_reach", "search_reach", "knee_clear", "workspace")
SCALES = np.array([np.deg2rad(1.0), 0.01, 0.05, 0.1, np.deg2rad(1.0), *[0.01] * 5])  # one unit of violation
UNBOUND = -10.0  # a margin floor [m] that never binds
SPARE = 0.1  # part of a foot's radius that its nominal stance keeps to the workspace's end: penalties give way a little
LEAST_LOAD = 0.05  # every standing foot presses down with at least this share of a quarter of the weight


class LanePlan(NamedTuple):
    """A lane's plan as the simulation follows it, and the walk that it samples."""

    walk: Walk
    reference: Reference
    slack: Float[Array, "constraint"]  # distance to each constraint, negative = violated, in its unit
    checks: PlanChecks


class Setting(NamedTuple):
    """The planner of a lane and what it is judged by."""

    planner: Planner  # a vector's numbers take the place of its own
    margin: Float[Array, ""]  # least stability margin [m]
    energy: Float[Array, ""]  # energy per metre that counts as 1 [J/m]

    @property
    def least_bend(self) -> Float[ArrayLike, "*lane"]:
        """Least knee bend [rad]: it binds whatever a search moves."""
        return self.planner.limits.knee_bend


class Score(NamedTuple):
    """A lane's judgement by proxy or simulation."""

    objective: Float[Array, ""]  # energy per metre over `Setting.energy`, plus penalties
    energy: Float[Array, "3"]  # energy per metre by convention [J/m]
    slack: Float[Array, "constraint"]  # distance to each constraint, negative = violated, in its unit
    checks: PlanChecks


def settings_of(planner: Planner, *count: int) -> Setting:
    """The setting of a lane, or of so many, of one planner that is judged by its energy alone [J/m]."""
    planners = jax.tree.map(lambda x: jnp.broadcast_to(x, (*count, *x.shape)), planner)
    return Setting(planners, jnp.full(count, UNBOUND, float), jnp.ones(count, float))


def penalty(slack: Float[Array, "constraint"]) -> Float[Array, ""]:
    """Penalty of violated constraints; one unit of `SCALES` costs about the baseline's energy."""
    return jnp.sum(fine(jax.nn.relu(-slack) / jnp.asarray(SCALES, slack.dtype)))


class Parts(NamedTuple):
    """A lane's judgement by the proxy in parts: `linearised` gives what they become near a vector."""

    score: Score
    cost: Float[Array, ""]  # without penalties
    rows: tuple[Float[Array, "instant"], ...]  # distance to each constraint in `SCALES`, its slack is the least


@dataclasses.dataclass(frozen=True)
class Lab:
    """The robot, the engine and the numbers that all lanes of a study share."""

    robot: Robot
    move: tuple[str, ...]  # names of the planner's numbers that a vector holds
    ground: Ground
    samples: tuple[int, int]
    steps: int
    chunk: int
    convention: Convention
    terms: EngineName = "legged"
    rows: int = 128  # of each constraint that a model keeps: the more numbers move, the more rows may become the least
    counted: Span = (0.0, 1.0)  # shares of the lanes, from the cheapest on, that a search counts: see `gauss_newton.counts`
    programs: Path | None = None  # folder in which traced programs are kept for later processes

    @functools.cached_property
    def engine(self) -> Engine:
        """Built on first use; not while tracing, MJX's arrays would leak."""
        with jax.ensure_compile_time_eval():
            return {"legged": legged_engine, "mjx": mjx_engine}[self.terms](self.robot)

    def planner(self, vector: Float[Array, "parameter"], setting: Setting) -> Planner:
        """The planner of one lane."""
        return with_leaves(setting.planner, self.move, vector)

    def walk(self, vector: Float[Array, "parameter"], site: Site, choice: Choices, setting: Setting) -> Walk:
        """The walk of one lane with its footholds chosen."""
        planner = self.planner(vector, setting)
        return build_walk(planner, self.robot, site, stations(planner, choice.adjust.shape[0] // 4), choice)

    def choose(self, vector: Float[Array, "parameter"], site: Site, setting: Setting, cycles: int = CYCLES) -> Choices:
        """The footholds of one lane; no gradient."""
        planner = self.planner(vector, setting)
        return choose(planner, self.robot, site, stations(planner, cycles), 4 * cycles)[0]

    def proxy(self, vector: Float[Array, "parameter"], site: Site, choice: Choices, setting: Setting) -> Score:
        """Judge one lane by the energy proxy of its walk."""
        return self.parts(vector, site, choice, setting).score

    def parts(self, vector: Float[Array, "parameter"], site: Site, choice: Choices, setting: Setting) -> Parts:
        """`proxy`, and what it is made of: the cost without penalties, every instant's distance to each constraint."""
        planner, seen = self.planner(vector, setting), evaluate(self.robot, self.walk(vector, site, choice, setting))
        energy = per_metre(seen.energy, seen.distance)
        lowered = 0.1 * seen.checks.lowering**2  # among equals, the height that needs no lowering
        cost = energy[CONVENTIONS.index(self.convention)] / setting.energy + lowered
        slack = self.slack(planner, seen.checks, setting)
        rows = self.distances(planner, seen.needs, seen.checks.lowering, setting)
        rows = tuple(row.reshape(-1) / unit for row, unit in zip(rows, SCALES.tolist()))
        return Parts(Score(cost + penalty(slack), energy, slack, seen.checks), cost, rows)

    def slack(self, planner: Planner, checks: PlanChecks, setting: Setting) -> Float[Array, "constraint"]:
        """Distance to each of `CONSTRAINTS`: radians, metres, share of the torque limit."""
        least = Needs(checks.knee_bend, checks.margin, -checks.torque_ratio, checks.load, checks.joint_room)
        return jnp.stack([jnp.min(x) for x in self.distances(planner, least, checks.lowering, setting)])

    def distances(
        self, planner: Planner, needs: Needs, lowering: Float[Array, ""], setting: Setting
    ) -> tuple[Float[Array, "*n"], ...]:
        """What is left of each need, or of all of them at many instants, to each of `CONSTRAINTS`."""
        height, step, search = read_leaves(planner, ("gait.workspace.high", "gait.step_length", "foothold.rectangle.length"))
        gait = gait_constraints(self.robot, height - lowering, step, search)
        of_plan = (needs.knee_bend - setting.least_bend, needs.margin - setting.margin, 1.0 + needs.torque)
        nominal = nominal_rooms(self.robot, planner.gait, planner.posture)  # of the footholds the choice sees to it itself
        return (*of_plan, needs.load - LEAST_LOAD, needs.joint_room, *gait, nominal - SPARE * self.robot.foot_radius)

    def plan(self, vector: Float[Array, "parameter"], site: Site, choice: Choices, setting: Setting) -> LanePlan:
        """The plan of one lane, sampled for the simulation. Differentiable in `vector`, the footholds held."""
        walk = self.walk(vector, site, choice, setting)
        time, at = instants(self.robot, walk, self.samples)
        used = jnp.ones(time.shape, bool)
        checks = plan_checks(self.robot, walk, at, needs_at(self.robot, at, used), used)
        return LanePlan(walk, to_reference(time, at), self.slack(self.planner(vector, setting), checks, setting), checks)

    def followed(self, plan: LanePlan, site: Site, setting: Setting, truth: Truth | None = None) -> tuple[Score, Meters]:
        """Judge one lane's plan in simulation, with the lab's robot on the site's map or with what is true instead; the
        constraints are those of the plan."""
        engine = self.engine if truth is None else legged_engine(truth.robot)
        robot, ground, terrain = truth or (self.robot, self.ground, site.terrain)
        track = plan.reference if truth is None else set_down(plan.reference, site.terrain, terrain)
        meters = simulate(engine, robot, ground, terrain, track, self.steps)
        energy = per_metre(meters.energy, meters.moved[0])
        objective = energy[CONVENTIONS.index(self.convention)] / setting.energy + penalty(plan.slack)
        return Score(objective, energy, plan.slack, plan.checks), meters

    def simulated(
        self, vector: Float[Array, "parameter"], site: Site, choice: Choices, setting: Setting
    ) -> tuple[Float[Array, ""], tuple[Score, Meters]]:
        """The objective of one lane in simulation, and what it came from. Differentiable in `vector`."""
        score, meters = self.followed(self.plan(vector, site, choice, setting), site, setting)
        return score.objective, (score, meters)

    @functools.cached_property
    def proxy_gradients(self) -> Callable[..., tuple[Score, Array]]:
        """Batched `proxy` with the cascade's choice, and the gradient of its objective with that choice held."""

        def lane(vector, site, setting):
            """Score and gradient of one lane."""
            choice = self.choose(vector, site, setting)

            def value(x):
                score = self.proxy(x, site, choice, setting)
                return score.objective, score

            gradient, score = jax.grad(value, has_aux=True)(vector)
            return score, gradient

        return over_lanes(lane, self.chunk, where=of_method(self, "proxy_gradients"))

    @functools.cached_property
    def models(self) -> Callable[..., Model]:
        """Batched `parts` with the cascade's choice, and how they change near each vector, that choice held. Called with
        (vectors, sites, settings, how far each number may move)."""

        def lane(vector, site, setting, reach):
            """The model of one lane."""
            choice = self.choose(vector, site, setting)
            return linearised(lambda x: self.parts(x, site, choice, setting), vector, reach, self.rows)

        return over_lanes(lane, max(1, self.chunk // 2), where=of_method(self, "models"))

    @functools.cached_property
    def _plans(self) -> Callable[[tuple, tuple], LanePlan]:
        """One chunk of `plan` with the cascade's choice; compiled once for all that follow plans."""

        def lane(vector, site, setting):
            return self.plan(vector, site, self.choose(vector, site, setting), setting)

        return on_devices(jax.vmap(lane), where=of_method(self, "plans"))

    def plan_lanes(self, vectors: Float[ArrayLike, "lane parameter"], sites: Site | Picked, settings: Setting) -> LanePlan:
        """Batched `plan` with the cascade's choice."""
        return in_chunks(lambda *lanes: self._plans((), lanes), self._lanes, vectors, sites, settings)

    @functools.cached_property
    def _follow(self) -> Callable[[tuple, tuple], tuple[Score, Meters]]:
        """One chunk of `followed`."""
        return on_devices(jax.vmap(self.followed), where=of_method(self, "follow"))

    def simulate_lanes(
        self,
        vectors: Float[ArrayLike, "lane parameter"],
        sites: Site | Picked,
        settings: Setting,
        truths: Truth | Picked | None = None,
    ) -> tuple[Score, Meters]:
        """Batched `simulated` with the cascade's choice, walked as in `followed`."""

        def lanes(vectors, sites, settings, truths):
            return self._follow((), (self._plans((), (vectors, sites, settings)), sites, settings, truths))

        return in_chunks(lanes, self._lanes, vectors, sites, settings, truths)

    @property
    def _lanes(self) -> int:
        """Lanes of one chunk on all devices."""
        return self.chunk * jax.local_device_count()

    @functools.cached_property
    def simulate_gradients(self) -> Callable[..., tuple[Score, Meters, Array]]:
        """Batched gradient of the simulated objective, reverse mode through the rollout, the footholds held."""

        def lane(vector, site, setting):
            choice = self.choose(vector, site, setting)
            gradient, (score, meters) = jax.grad(self.simulated, has_aux=True)(vector, site, choice, setting)
            return score, meters, gradient

        of_half = max(1, self.chunk // 2)  # reverse mode needs more memory a lane
        return over_lanes(lane, of_half, where=of_method(self, "simulate_gradients"))


def stations(planner: Planner, cycles: int) -> Stations:
    """Stations of a walk of so many cycles straight ahead."""
    return planner.route.stations(planner.gait, None, 2 * cycles + 2)


def per_metre(energy: Power, distance: Float[Array, ""]) -> Float[Array, "3"]:
    """Energy per metre [J/m] by convention, from the joints' energies [J] and the way [m]."""
    total = jax.tree.map(jnp.sum, energy)
    return jnp.stack([electrical(total, convention) for convention in CONVENTIONS]) / distance
