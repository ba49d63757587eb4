"""`jaxleg plan CONFIG --terrain FILE_OR_KIND --start X Y --goal X Y`: a walk over one map (paper C)."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxleg.cli.options import check_outputs, first, needed, numbers, take
from jaxleg.cli.study import NO_CONFIG, read_study
from jaxleg.conventions import InputError

CELLS = (200, 100)  # of a map that is made here, each as wide as a foot
NEEDLESS = ("foot_offset", "skew", "shift_share", "hind_share", "lift_share")  # of a gait: paper C's planner has none


class Task(NamedTuple):
    """What is to be planned, read and checked; places count from the map's datum."""

    study: Any
    robot_file: Any
    robot: Any
    kind: str
    map: Any  # `terrain.files.MapFile`
    ends: dict[str, np.ndarray]
    out: Path
    figure: Path | None


def plan(arguments: list[str]) -> int:
    """Read and check everything, plan, write `plan.npz`. Exit status 1 where there is no walk, with the reason."""
    from rich.console import Console

    from jaxleg.cli.planning import make

    task = read(list(arguments))
    console = Console(width=None if Console().is_terminal else 110, highlight=False)
    for note in notes(task.study, task.kind):
        console.print(note)
    return make(task, console)


def read(rest: list[str]) -> Task:
    """Everything that the command line names. Raises `InputError` for what cannot be used."""
    ends = {name: take(rest, name, 2) for name in ("start", "goal")}
    ends = {name: np.array(numbers(needed(value, name, "X Y in metres"), name)) for name, value in ends.items()}
    source = needed(take(rest, "terrain"), "terrain", "a map (.npz) or a kind of terrain")[0]
    difficulty = numbers(take(rest, "difficulty") or ["0.5"], "difficulty")[0]
    out, figure, name = (take(rest, option) for option in ("out", "figure", "gait"))
    if not 0.0 <= difficulty <= 1.0:
        raise InputError(f"command line: --difficulty is {difficulty:g}, but must be from 0 to 1")
    study, file, robot = read_study(first(rest, NO_CONFIG), rest, "jaxleg plan CONFIG")
    kind = gait_kind(study, name[0] if name else None, source)
    wide = 2.0 * float(str(np.asarray(robot.foot_radius)))  # exact digits
    ground = find_terrain(study, source, difficulty, wide)
    ends = {name: xy - ground.datum[:2] for name, xy in ends.items()}
    check_map_and_ends(source, ground, robot, study.kinds[kind].gait, ends)
    plan_path, picture = Path(out[0] if out else "runs/plan.npz"), Path(figure[0]) if figure else None
    check_outputs({"--out": plan_path, "--figure": picture}, {"--figure": ".png"})
    return Task(study, file, robot, kind, ground, ends, plan_path, picture)


def gait_kind(study: Any, name: str | None, terrain: str) -> str:
    """The kind of terrain whose gait is walked."""
    if name is not None and name not in study.kinds:
        raise InputError(f"command line: --gait is {name}, but must be one of {', '.join(study.kinds)}")
    return name or (alike(study, terrain) + list(study.kinds))[0]


def alike(study: Any, terrain: str) -> list[str]:
    """CONFIG's kinds of this name, or made by this generator."""
    return [terrain] if terrain in study.kinds else [k for k, table in study.kinds.items() if table.generator == terrain]


def find_terrain(study: Any, source: str, difficulty: float, cell: float) -> Any:
    """The map of a file, or one of a kind of terrain, made with the kind's settings in CONFIG and cells so wide [m]."""
    import jax

    from jaxleg.search.config import Kind
    from jaxleg.search.sites import terrain_settings
    from jaxleg.terrain import KINDS, Grid, terrain
    from jaxleg.terrain.files import MapFile, load_map

    known = alike(study, source)
    if known or source in KINDS:
        table = study.kinds[known[0]] if known else Kind(source)
        grid = Grid(*CELLS, cell, (0.5 * cell, 0.5 * cell))
        ground = terrain(table.generator, grid, jax.random.key(study.seed), difficulty, terrain_settings(table))
        return MapFile(ground, np.zeros(3))
    if not source.endswith(".npz"):
        kinds = ", ".join(sorted({*KINDS, *study.kinds}))
        raise InputError(f"command line: --terrain is {source}, but must be a .npz file or one of {kinds}")
    return load_map(source)


def check_map_and_ends(source: str, ground: Any, robot: Any, gait: Any, ends: dict[str, np.ndarray]) -> None:
    """Raises `InputError` for a map (from `source`) that this robot cannot be planned on, and for ends that are not on it."""
    terrain, datum = ground.terrain, ground.datum[:2]
    resolution, origin = float(terrain.resolution), np.asarray(terrain.origin)
    last = origin + resolution * (np.array(terrain.elevation.shape) - 1)
    if resolution > 2.0 * float(robot.foot_radius) + 1e-6:
        wide = 2.0 * float(robot.foot_radius)
        raise InputError(f"{source}: resolution is {resolution:g} m, but must be at most the foot's width, {wide:g} m")
    needs = max(gait.stance_length, float(robot.trunk_size[0]))
    if min(last - origin) < needs:
        size = " x ".join(f"{x:.2f}" for x in last - origin)
        raise InputError(f"{source}: the map is {size} m, but the robot needs {needs:g} m either way to stand on it")
    for name, xy in ends.items():
        where = f"--{name} {xy[0] + datum[0]:.10g} {xy[1] + datum[1]:.10g}"
        if np.any((xy < origin - 0.5 * resolution) | (xy > last + 0.5 * resolution)):
            span = " and ".join(f"{a:.2f} to {b:.2f}" for a, b in zip(origin + datum, last + datum))
            raise InputError(f"{where} is outside the map, which spans {span} m along x and y")
        cell = np.clip(np.round((xy - origin) / resolution).astype(int), 0, np.array(terrain.elevation.shape) - 1)
        if not np.isfinite(terrain.elevation[tuple(cell)]):
            raise InputError(f"{where} is on ground that nobody has seen")


def notes(study: Any, kind: str) -> list[str]:
    """What of CONFIG's kind this planner does not use, though it was set."""
    table, own = study.kinds[kind], study.navigation.pose.least_knee_bend_deg
    gait, leaves, bend = table.gait, table.leaves, table.least_knee_bend_deg
    default = {field.name: field.default for some in (gait, table) for field in dataclasses.fields(some)}
    other = bend not in (own, default["least_knee_bend_deg"])
    unused = {
        f", navigation.pose.least_knee_bend_deg is {own:g}": {"least_knee_bend_deg": bend} if other else {},
        ".gait, paper C's planner has no such number": {
            n: getattr(gait, n) for n in NEEDLESS if getattr(gait, n) != default[n]
        },
        ".leaves, paper C's planner has its own": {n: x for n, x in leaves.items() if not n.startswith("swing.")},
    }
    return [
        f"not used of kinds.{kind}{why}: {', '.join(f'{name} {value:g}' for name, value in numbers.items())}"
        for why, numbers in unused.items()
        if numbers
    ]
