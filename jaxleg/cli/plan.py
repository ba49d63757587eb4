"""`jaxleg plan CONFIG --terrain FILE_OR_KIND --start X Y --goal X Y`: a walk over one map (paper C)."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxleg.cli.options import needed, numbers, take
from jaxleg.cli.start import EXIT_INFEASIBLE, USAGE, configure_jax, quietly
from jaxleg.conventions import InputError
from jaxleg.robot import RobotFile, build_robot

NAMES = {  # statuses of a planned walk, in words
    "NO_PATH": "no path leads from start to goal over ground that the body and the feet can cross",
    "START_BLOCKED": "the ground round the start cannot be walked on: steps, unseen or no place for the feet",
    "GOAL_BLOCKED": "the ground round the goal cannot be walked on: steps, unseen or no place for the feet",
    "TOO_LONG": "the walk is longer than navigation.path.cells or navigation.path.steps allow",
    "NO_STANCE": "no valid foothold for some foot at the start",
    "DEAD_END": "a path is there, but no series of gaits leads along it",
    "BUDGET": "a path is there, but no series of gaits along it was found within navigation.tree.budget candidates",
}


def plan(arguments: list[str]) -> int:
    """Read and check everything, plan, write `plan.npz`. Exit status 1 where there is no walk, with the reason."""
    rest = list(arguments)
    if {"-h", "--help"} & set(rest):
        print(USAGE)
        return 0
    ends = {name: take(rest, name, 2) for name in ("start", "goal")}
    ends = {name: np.array(numbers(needed(value, name, "X Y in metres"), name)) for name, value in ends.items()}
    source = needed(take(rest, "terrain"), "terrain", "a map (.npz) or a kind of terrain")[0]
    difficulty = numbers(take(rest, "difficulty") or ["0.5"], "difficulty")[0]
    out, figure, name = (take(rest, option) for option in ("out", "figure", "gait"))
    if not 0.0 <= difficulty <= 1.0:
        raise InputError(f"command line: --difficulty is {difficulty:g}, but must be from 0 to 1")
    study, file = read_config(rest)
    configure_jax()  # before any array is made, the robot's included
    robot = build_robot(file)
    kind = gait_kind(study, name[0] if name else None, source)
    terrain = find_terrain(study, source, difficulty)
    check(terrain, robot, study.kinds[kind].gait, ends)
    return make(study, robot, file.name, kind, terrain, ends, Path(out[0] if out else "runs/plan.npz"), figure)


def read_config(rest: list[str]) -> tuple[Any, RobotFile]:
    """The study of CONFIG with its overrides, and its robot's file."""
    from jaxleg.search.config import Study, robot_path
    from jaxleg.settings import from_command_line, load

    if not rest or rest[0].startswith("-"):
        raise InputError("command line: CONFIG is missing; give a TOML file such as configs/quickstart.toml")
    source = rest.pop(0)
    study = from_command_line(Study, load(Study, source), rest, prog="jaxleg plan CONFIG")
    return study, load(RobotFile, robot_path(study, source))


def gait_kind(study: Any, name: str | None, terrain: str) -> str:
    """The kind of terrain whose gait is walked."""
    if name is not None and name not in study.kinds:
        raise InputError(f"command line: --gait is {name}, but must be one of {', '.join(study.kinds)}")
    alike = [kind for kind, table in study.kinds.items() if terrain in (kind, table.generator)]
    return name or (alike + list(study.kinds))[0]


def find_terrain(study: Any, source: str, difficulty: float) -> Any:
    """The map of a file, or one of a kind of terrain: 8 x 4 m in cells of 0.04 m."""
    import jax

    from jaxleg.terrain import KINDS, Grid, TerrainSettings, terrain
    from jaxleg.terrain.files import load_map

    if source in KINDS:
        return terrain(source, Grid(200, 100, 0.04, (0.02, 0.02)), jax.random.key(study.seed), difficulty, TerrainSettings())
    if not source.endswith(".npz"):
        raise InputError(f"command line: --terrain is {source}, but must be a .npz file or one of {', '.join(sorted(KINDS))}")
    return load_map(source).terrain


def check(terrain: Any, robot: Any, gait: Any, ends: dict[str, np.ndarray]) -> None:
    """Raises `InputError` for a map that this robot cannot be planned on, and for ends that are not on it."""
    resolution, origin = float(terrain.resolution), np.asarray(terrain.origin)
    last = origin + resolution * (np.array(terrain.elevation.shape) - 1)
    if resolution > 2.0 * float(robot.foot_radius) + 1e-6:
        raise InputError(f"the map's cells are {resolution:g} m, but the foot is {2.0 * float(robot.foot_radius):g} m wide")
    needs = max(gait.stance_length, float(robot.trunk_size[0]))
    if min(last - origin) < needs:
        size = " x ".join(f"{x:.2f}" for x in last - origin)
        raise InputError(f"the map is {size} m, but the robot needs {needs:g} m either way to stand on it")
    for name, xy in ends.items():
        if np.any((xy < origin - 0.5 * resolution) | (xy > last + 0.5 * resolution)):
            span = " and ".join(f"{a:.2f} to {b:.2f}" for a, b in zip(origin, last))
            raise InputError(f"--{name} {xy[0]:g} {xy[1]:g} is outside the map, which spans {span} m along x and y")
        cell = np.clip(np.round((xy - origin) / resolution).astype(int), 0, np.array(terrain.elevation.shape) - 1)
        if not np.isfinite(terrain.elevation[tuple(cell)]):
            raise InputError(f"--{name} {xy[0]:g} {xy[1]:g} is on ground that nobody has seen")


def make(study, robot, robot_name: str, kind: str, terrain, ends, out: Path, figure: list[str] | None) -> int:
    """Plan, write, show."""
    import jax
    from rich.console import Console

    quietly()
    from jaxleg.planning.navigation import NavigationStatus
    from jaxleg.search.navigate import navigate, navigator_of, survey_all

    console = Console(width=None if console_is_wide() else 110, highlight=False)
    navigator = navigator_of(study, robot, study.kinds[kind].gait, float(terrain.resolution))
    lanes = jax.tree.map(lambda x: np.asarray(x)[None], terrain)
    start, goal = (ends[name].astype(lanes.elevation.dtype)[None] for name in ("start", "goal"))
    with console.status("cost map, then path and gaits (compiled on first use)"):
        surveys = survey_all(navigator, lanes)
        walked, detours = navigate(navigator, surveys, start, goal)
    status = NavigationStatus(walked.status[0])
    if status != NavigationStatus.OK:
        console.print(f"no walk: {NAMES[status.name]}")
        return EXIT_INFEASIBLE
    with console.status("reference"):
        survey, walk = jax.tree.map(lambda x: x[0], (surveys, walked))
        planned = jax.jit(navigator.planned)(survey, walk)
    save(study, robot, robot_name, navigator, terrain, walk, planned, goal[0], out)
    show(console, walk, planned, int(detours[0]), out)
    if figure:
        from jaxleg.viz.navigation import draw_walk, trail

        trunk = np.asarray(walk.states.pose)[: int(walk.count) + 1, :2]
        draw_walk(terrain, survey.scene.valid, trail(terrain, walk, trunk, start[0], goal[0]), figure[0])
        console.print(f"picture: {figure[0]}")
    return 0


def console_is_wide() -> bool:
    """Whether the output is a terminal, whose own width is then used."""
    import sys

    return sys.stdout.isatty()


def save(study, robot, robot_name: str, navigator, terrain, walk, planned, goal, out: Path) -> None:
    """Write `plan.npz`."""
    import jax

    from jaxleg.settings import to_table
    from jaxleg.sim.plan_file import save_plan
    from jaxleg.terrain.files import MapFile

    count, last = int(walk.count), int(planned.last)
    reference = jax.tree.map(lambda x: np.asarray(x)[: last + 1], planned.reference)
    params = {
        "navigation": to_table(study.navigation),
        "power": study.power,
        "friction": study.simulation.friction,
        "samples_a_step": sum(navigator.samples),
        "tick": study.navigation.pace.tick,
        "steps": count,
    }
    states = jax.tree.map(lambda x: np.asarray(x)[: count + 1], walk.states)
    save_plan(out, robot_name, robot, MapFile(terrain, np.zeros(3)), reference, states.feet, states.pose, goal, params)


def show(console, walk, planned, detours: int, out: Path) -> None:
    """The plan in a few lines."""
    time = float(planned.reference.time[int(planned.last)])
    cells = np.asarray(walk.path.cells)[: int(walk.path.length)]
    console.print(f"path of {len(cells)} cells, cost {float(walk.path.cost):.2f}; detours round dead ends: {detours}")
    console.print(f"{int(walk.count)} steps in {time:.1f} s; {int(walk.visited)} candidate states tried")
    bend, ratio = np.rad2deg(float(planned.knee_bend)), float(planned.torque_ratio)
    console.print(f"least knee bend {bend:.1f} deg, greatest torque {100.0 * ratio:.0f} % of its limit")
    console.print(f"written: {out}")
