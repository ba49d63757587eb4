"""A planner's choices: footholds and poses along stations, exact and without a gradient. Paper A, IV.B; C, 3.3."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.foothold.cascade import Cascade
from jaxleg.foothold.contract import Footholds, FootholdStatus, Proposal
from jaxleg.foothold.soft import Softness, soft_stance
from jaxleg.gait.nominal import nominal_foothold, nominal_stances
from jaxleg.gait.order import STEP_LEGS
from jaxleg.gait.timing import shift_time
from jaxleg.planner import Planner
from jaxleg.posture.workspace import inside, nominal_rooms, stance_rooms
from jaxleg.robot import Robot
from jaxleg.rotations import to_heading, turned
from jaxleg.route.stations import Stations
from jaxleg.series.candidates import adjustment_of, pruned, steps_away
from jaxleg.series.kinds import Greedy
from jaxleg.series.tree import Nodes, SearchStatus, Series, Tried, search
from jaxleg.status import Status
from jaxleg.terrain.ground import on_ground
from jaxleg.terrain.site import Site
from jaxleg.walk.choices import Choices
from jaxleg.walk.feasible import Standing, feasible, holding_power

LEGS_OF = np.array(STEP_LEGS)
Find = Callable[..., Footholds]  # a stance's footholds, see `foothold.contract`


def choose(planner: Planner, robot: Robot, site: Site, stations: Stations, steps: int) -> tuple[Choices, Series | None]:
    """The choices of a walk of at most so many steps, and how a tree search found them.

    Raises ValueError for steps that are no whole cycles.
    """
    if steps % len(STEP_LEGS):
        raise ValueError(f"steps is {steps}, but must be a multiple of {len(STEP_LEGS)}: whole cycles")
    planner, robot, site, stations = jax.lax.stop_gradient((planner, robot, site, stations))
    if isinstance(planner.series, Greedy):
        return greedy(planner, robot, site, stations, steps), None
    return tree(planner, robot, site, stations, steps)


def greedy(planner: Planner, robot: Robot, site: Site, stations: Stations, steps: int) -> Choices:
    """The footholds that each stance's four feet find first. Paper A, IV.B.3."""
    return found_by(planner.foothold.stance, planner, robot, site, stations, steps)


def softly(planner: Planner, robot: Robot, site: Site, stations: Stations, steps: int, softness: Softness) -> Choices:
    """`greedy` of a cascade, its choice made soft: differentiable in the planner's numbers, the workspace's bounds too.

    Raises TypeError for a planner whose footholds are no `Cascade`.
    """
    if not isinstance(planner.foothold, Cascade):
        raise TypeError(f"this planner's foothold is {type(planner.foothold).__name__}, but must be Cascade to be made soft")
    return found_by(functools.partial(soft_stance, planner.foothold, softness), planner, robot, site, stations, steps)


def found_by(find: Find, planner: Planner, robot: Robot, site: Site, stations: Stations, steps: int) -> Choices:
    """The choices of a walk whose stances find their footholds one after another."""
    stances = steps // 4 + 1
    nominal, yaw = nominal_stances(planner.gait, stations, stances)
    found = stance_by_stance(find, planner, robot, site, stations, nominal, yaw[:, 0])
    count = jnp.minimum(2 * stations.count, steps) if planner.standing else jnp.full((), steps, jnp.int32)
    step = jnp.arange(steps, dtype=jnp.int32).reshape(-1, 4)
    walked = jnp.concatenate([jnp.ones((1, 4), bool), (step < count)[:, np.argsort(STEP_LEGS)]])
    missing = jnp.any(walked & (found.status == FootholdStatus.NONE))
    status = jnp.where(missing, Status.NO_FOOTHOLD, Status.OK).astype(jnp.int32)
    offset = jax.vmap(jax.vmap(to_heading))(found.offset, yaw)
    return Choices(offset, found.status, jnp.zeros((steps, 3), jnp.int32), count, status)


def stance_by_stance(find: Find, planner: Planner, robot: Robot, site: Site, stations: Stations, nominal, yaw) -> Footholds:
    """Footholds that `find` finds for stances (leading axis) one after another: where the hips are as the feet of one land,
    and so whether these are inside the workspace, depends on the stance before. Before the first they stood a step behind."""
    stance = np.arange(len(nominal))
    turns = stations.yaw[np.maximum(2 * stance[:, None] + np.array([-1, 0]), 0)]  # in the right and the left legs' swings
    first = jnp.asarray(stance == 0)
    # where not even the nominal stance is inside, shorter and shorter steps might be: no gait is bent into that
    fits = jnp.all(inside(nominal_rooms(robot, planner.gait, planner.posture)))

    def step_to(before, here):
        """The next stance's feet in W [m], and how they were found."""
        nominal, yaw, turns, first = here
        back = turned(jnp.stack([planner.gait.step_length, jnp.zeros_like(yaw)]), yaw)

        def room(feet):
            behind = feet.at[:, :2].add(-back[None])
            seen = stance_rooms(robot, planner.gait, planner.posture, jnp.where(first, behind, before), feet, turns)
            return jnp.where(fits, jnp.min(seen), -jnp.inf)

        found = find(robot, planner.gait, site, nominal, yaw, room)
        return on_ground(robot, site.terrain, nominal + found.offset), found

    nowhere = jnp.zeros((4, 3), nominal.dtype)
    return jax.lax.scan(step_to, nowhere, (nominal, yaw, turns, first))[1]


def tree(planner: Planner, robot: Robot, site: Site, stations: Stations, steps: int) -> tuple[Choices, Series]:
    """The series that a search with look-ahead finds. Paper C, 3.3.2."""
    root, first = first_stance(planner, robot, site, stations)
    standing = jnp.all(first.status != FootholdStatus.NONE)
    wanted = jnp.where(standing, jnp.minimum(2 * stations.count, steps), 0)
    nodes, series = step_nodes(planner, robot, site, stations), planner.tree
    found = search(nodes, root, wanted, steps, series.depth, series.budget)
    return chosen(planner, stations, found, first.status), found


def chosen(planner: Planner, stations: Stations, found: Series, first: Int[Array, "leg"]) -> Choices:
    """What a search has found, as choices; `first` says how the feet of the first stance were found."""
    steps = found.choice.shape[0]
    nominal, yaw = nominal_stances(planner.gait, stations, steps // 4 + 1)
    swung = found.states.feet[1:][np.arange(steps), LEGS_OF[np.arange(steps) % 4], :2]
    landed = swung.reshape(-1, 4, 2)[:, np.argsort(STEP_LEGS)]
    feet = jnp.concatenate([found.states.feet[:1, :, :2], landed])
    stance, leg = np.arange(steps) // 4 + 1, LEGS_OF[np.arange(steps) % 4]
    walked = jnp.arange(steps, dtype=jnp.int32) < found.step
    good = jnp.ones((steps // 4 + 1, 4), bool).at[stance, leg].set(walked)
    offset = jnp.where(good[..., None], jax.vmap(jax.vmap(to_heading))(feet - nominal, yaw), 0.0)
    status = jnp.select(
        [jnp.any(first == FootholdStatus.NONE), found.status == SearchStatus.DEAD_END, found.status == SearchStatus.BUDGET],
        [Status.NO_STANCE, Status.DEAD_END, Status.BUDGET],
        Status.OK,
    )
    how = jnp.zeros((steps // 4 + 1, 4), jnp.int32).at[0].set(first)
    adjust = jnp.where(walked[:, None], steps_away(found.choice, planner.tree.counts), 0)
    return Choices(offset, how, adjust, found.step, status.astype(jnp.int32))


def first_stance(planner: Planner, robot: Robot, site: Site, stations: Stations) -> tuple[Standing, Footholds]:
    """The stance that the walk begins in, each foot on its best cell, and how the feet were found.

    The right feet stand at the first station, the left ones at the second: they swing last.
    """
    nominal, _ = nominal_stances(planner.gait, stations, 1)
    found = planner.foothold.stance(robot, planner.gait, site, nominal[0], stations.yaw[0])
    feet = on_ground(robot, site.terrain, nominal[0] + found.offset)
    return Standing(feet, planner.posture.stand(robot, planner.gait, feet, stations.yaw[0])), found


def step_nodes(planner: Planner, robot: Robot, site: Site, stations: Stations) -> Nodes:
    """The tree of paper C's search: stances of the steps along the stations."""
    legs, series = jnp.array(STEP_LEGS), planner.tree

    def expand(stance: Standing, step):
        leg, station = legs[step % 4], step // 2 + 2
        nominal = jax.vmap(lambda leg: nominal_foothold(planner.gait, stations, station, leg))(jnp.arange(4))
        yaw = stations.yaw[jnp.minimum(station, stations.yaw.shape[0] - 1)]
        seen = planner.foothold.propose(robot, planner.gait, site, nominal, yaw, leg)
        return seen, _order(planner, robot, site, stance, leg, seen, stations.yaw[_heading(stations, step)])

    def attempt(stance: Standing, seen: Proposal, step, candidate):
        """Whether one candidate can be stepped to and the stance there, or why not and which others that rules out."""
        leg, foothold = legs[step % 4], candidate // series.counts.poses
        target = on_ground(robot, site.terrain, seen.xy[foothold])
        feet = stance.feet.at[leg].set(target)
        adjust = adjustment_of(steps_away(candidate, series.counts), series.adjustments)
        yaw = stations.yaw[_heading(stations, step)]
        pose = planner.posture.swing(robot, planner.gait, stance.feet, feet, leg, adjust, yaw)
        cause = feasible(robot, planner, site.obstacles, stance, leg, target, pose)
        cause = jnp.where(seen.exists[foothold], cause, Status.NO_FOOTHOLD).astype(jnp.int32)
        gone = pruned(candidate, cause, series.counts)
        if not series.prune:
            gone = gone & (cause == Status.NO_FOOTHOLD)
        return Tried(cause == Status.OK, Standing(feet, pose), gone, cause)

    return Nodes(expand, attempt)


def _heading(stations: Stations, step):
    """The station whose yaw the trunk has about, in a step: between the feet that swing and those that stand."""
    return jnp.minimum(step // 2 + 1, stations.yaw.shape[0] - 1)


def _order(planner: Planner, robot: Robot, site: Site, stance: Standing, leg, seen: Proposal, yaw) -> Int[Array, "candidate"]:
    """Candidates in the order of trial: paper C's (28), or by cost of the foothold plus energy of the step.

    The energy is the power of holding the pose for as long as the shift to it and the swing take: a better pose must be worth
    the time of going there. It is worked out over the best foothold: the pose decides it, the foothold hardly.
    """
    series = planner.tree
    if series.order == "paper":
        return jnp.arange(series.counts.candidates)
    adjust = adjustment_of(steps_away(np.arange(series.counts.poses), series.counts), series.adjustments)
    feet = stance.feet.at[leg].set(on_ground(robot, site.terrain, seen.xy[0]))
    weight = (jnp.arange(4) != leg).astype(feet.dtype)

    def energy(adjust: Float[Array, "3"]) -> Float[Array, ""]:
        """Of one pose [J]."""
        pose = planner.posture.swing(robot, planner.gait, stance.feet, feet, leg, adjust, yaw)
        seconds = shift_time(stance.pose, pose, series.acceleration) + series.swing_time
        return holding_power(robot, feet, pose, weight) * seconds

    value = series.energy_weight / series.energy * jax.vmap(energy)(adjust)
    return jnp.argsort((seen.cost[:, None] + jnp.nan_to_num(value, nan=jnp.inf)[None]).reshape(-1))
