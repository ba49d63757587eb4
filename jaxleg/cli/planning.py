"""The work of `jaxleg plan`: a walk, or why there is none."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.cli.start import EXIT_INFEASIBLE, cache_folder
from jaxleg.conventions import InputError
from jaxleg.search.navigate import navigate, navigator_of, planned_all, survey_all
from jaxleg.settings import to_table
from jaxleg.status import Status
from jaxleg.terrain.heightmap import nearest_cell
from jaxleg.walk.level import level_stance
from jaxleg.walk.plan_file import save_plan

FAULTS = {  # why there is no walk, in words
    Status.NO_PATH: "no path leads from start to goal over ground that the body and the feet can cross",
    Status.START_BLOCKED: "the ground round the start cannot be walked on",
    Status.GOAL_BLOCKED: "the ground round the goal cannot be walked on",
    Status.TOO_LONG: "the walk is longer than navigation.path.cells or navigation.path.steps allow",
    Status.NO_STANCE: "no valid foothold for some foot at the start",
    Status.DEAD_END: "a path is there, but no series of gaits leads along it",
    Status.BUDGET: "a path is there, but no series of gaits along it was found within navigation.tree.budget candidates",
}
STEP_FAULTS = {  # why a step cannot be made, in words
    Status.NO_FOOTHOLD: "no foothold left",
    Status.KINEMATICS: "out of reach, a knee too straight or a joint out of its range",
    Status.STABILITY: "stability margin too small",
    Status.HIND_LEG: "a hind leg touches the ground",
    Status.LEFT_LEG: "the left front leg touches the ground",
    Status.COLLISION: "the right front leg or the trunk touches the ground",
    Status.NOT_FINITE: "unseen ground on the way",
    Status.TORQUE: "a motor would need more torque than it has",
    Status.LOAD: "a standing foot would have to pull",
    Status.WORKSPACE: "a foot outside the workspace under its hip",
}


def make(task: Any, console: Any) -> int:
    """Plan, write, show."""
    terrain, kind = task.map.terrain, task.study.kinds[task.kind]
    navigator = navigator_of(task.study, task.robot, kind.gait, float(terrain.resolution), kind.leaves, cache_folder())
    check_stance(task, navigator)
    lanes = jax.tree.map(lambda x: np.asarray(x)[None], terrain)
    start, goal = (task.ends[name].astype(lanes.elevation.dtype)[None] for name in ("start", "goal"))
    with console.status("cost map, then path and gaits (compiled on first use)"):
        surveys = survey_all(navigator, lanes)
        walked, detours = navigate(navigator, surveys, start, goal)
    survey, walk = jax.tree.map(lambda x: x[0], (surveys, walked))
    if walk.status != Status.OK:
        for line in reasons(survey, walk, start[0], goal[0]):
            console.print(line)
        return EXIT_INFEASIBLE
    with console.status("reference"):
        planned = jax.tree.map(lambda x: x[0], planned_all(navigator, walked))
    save(task, navigator, walk, planned, goal[0])
    show(task, console, walk, planned, int(detours[0]))
    if task.figure:
        picture(task, survey, walk, start[0], goal[0])
        console.print(f"picture: {task.figure}")
    return 0


def check_stance(task: Any, navigator: Any) -> None:
    """Raises `InputError` where the robot cannot stand on level ground as the gait asks, at no candidate height."""
    seen = jax.jit(level_stance)(task.robot, navigator.planner)
    least = float(navigator.planner.limits.knee_bend)
    fits = seen.reach & (seen.bend >= least) & (seen.room >= 0.0) & (seen.torque <= 1.0)
    if np.any(fits):
        return
    first = jax.tree.map(lambda x: x[0], seen)
    faults = [
        (~first.reach, "a foot is out of reach"),
        (first.bend < least, f"a knee bends {np.rad2deg(first.bend):.0f} deg, less than navigation.pose.least_knee_bend_deg"),
        (first.room < 0.0, f"a joint is {np.rad2deg(-first.room):.0f} deg beyond its range"),
        (first.torque > 1.0, f"a joint needs {100.0 * first.torque:.0f} % of its torque limit"),
    ]
    why = ", ".join(words for fault, words in faults if fault)
    raise InputError(
        f"kinds.{task.kind}.gait: {task.robot_file.name} cannot stand on level ground at workspace.high {first.height:.3g} m"
        f" (nor at the other candidate heights, {np.min(seen.height):.3g} to {np.max(seen.height):.3g}): {why}"
    )


def reasons(survey: Any, walk: Any, start: np.ndarray, goal: np.ndarray) -> list[str]:
    """Why there is no walk, with what was counted on the way."""
    status = Status(walk.status)
    lines = [f"no walk: {FAULTS[status]}"]
    ends = {Status.START_BLOCKED: start, Status.GOAL_BLOCKED: goal}
    if status in ends:
        lines[0] += f": {blocked_by(survey, ends[status])}"
    counts = {cause: int(walk.causes[cause]) for cause in STEP_FAULTS if walk.causes[cause]}
    if counts:
        lines.append(f"{int(walk.visited)} candidate states tried; not reached: {sum(counts.values())}")
        lines += [f"  {count:6d}  {STEP_FAULTS[cause]}" for cause, count in sorted(counts.items(), key=lambda x: -x[1])]
    return lines


def blocked_by(survey: Any, xy: np.ndarray) -> str:
    """What makes a cell one that the trunk's centre cannot be over."""
    cell = tuple(np.asarray(nearest_cell(survey.site.terrain, jnp.asarray(xy))))
    if not np.isfinite(survey.cost.body[cell]):
        return "steps or unseen ground under the body"
    if not np.isfinite(survey.cost.feet[:, *cell]).any():
        return "no ground seen under a foot"
    return "hardly a cell where a foot may stand round a default foothold (navigation.footing)"


def save(task: Any, navigator: Any, walk: Any, planned: Any, goal: np.ndarray) -> None:
    """Write `plan.npz`."""
    count, last = int(walk.choices.count), int(planned.last)
    reference = jax.tree.map(lambda x: np.asarray(x)[: last + 1], planned.reference)
    params = {
        "navigation": to_table(task.study.navigation),
        "power": task.study.power,
        "friction": task.study.simulation.friction,
        "samples_a_step": sum(navigator.samples),
        "tick": task.study.navigation.pace.tick,
        "steps": count,
    }
    feet, poses = (np.asarray(x)[: count + 1] for x in (walk.walk.feet, walk.walk.poses))
    save_plan(task.out, task.robot_file.name, task.robot, task.map, reference, feet, poses, goal, params)


def show(task: Any, console: Any, walk: Any, planned: Any, detours: int) -> None:
    """The plan in a few lines."""
    time = float(planned.reference.time[int(planned.last)])
    cells = np.asarray(walk.path.cells)[: int(walk.path.length)]
    console.print(f"path of {len(cells)} cells, cost {float(walk.path.cost):.2f}; detours round dead ends: {detours}")
    console.print(f"{int(walk.choices.count)} steps in {time:.1f} s; {int(walk.visited)} candidate states tried")
    bend, ratio = np.rad2deg(float(planned.knee_bend)), float(planned.torque_ratio)
    console.print(f"least knee bend {bend:.1f} deg, greatest torque {100.0 * ratio:.0f} % of its limit")
    if np.any(task.map.datum):
        x, y, z = task.map.datum
        console.print(f"places in the file count from its datum, ({x:.0f}, {y:.0f}, {z:.0f}) m")
    console.print(f"written: {task.out}")


def picture(task: Any, survey: Any, walk: Any, start: np.ndarray, goal: np.ndarray) -> None:
    """The walk from above."""
    from jaxleg.viz.navigation import draw_walk, trail

    trunk = np.asarray(walk.walk.poses)[: int(walk.choices.count) + 1, :2]
    seen, (x, y, _) = trail(task.map.terrain, walk, trunk, start, goal, simulated=False), task.map.datum
    draw_walk(task.map.terrain, survey.site.valid, seen, task.figure, (x, y))
