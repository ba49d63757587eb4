"""What no single key of a study's configuration shows: its settings against each other and against the robot."""

import dataclasses
import functools
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from jaxleg.conventions import InputError
from jaxleg.foothold.rectangle import bounding_sides
from jaxleg.search.config import RULES, Kind, Rectangle, Span, Study
from jaxleg.search.contestants import rectangles, span_of
from jaxleg.search.leaves import require_known
from jaxleg.settings import convert
from jaxleg.terrain.generators import KINDS

MOST_CELLS = 2**31  # of all maps of a study together: 8 GiB
HEADINGS = frozenset({"route.heading", "foothold.rectangle.heading"})
HELD = {  # where the searched planners have a number from that no search moves
    **{f"gait.{name}": f"contestants.paper.{name}" for name in ("workspace.high", "skew", "step_length")},
    "foothold.rectangle.length": "rectangle.search_length",
}


class Legs(NamedTuple):
    """The robot's numbers [m] that a study is checked against."""

    length: float
    thigh: float
    foot_radius: float


def check_study(study: Study, source: str, legs: Legs) -> None:
    """Raise `InputError`, one sentence, for too few terrains, numbers that the planner does not have, an empty range, a map or
    a stance that cannot serve, or bounds that no gait can meet."""
    if not study.kinds:
        raise InputError(f"{source}: kinds is empty, but at least one table [kinds.NAME] is needed")
    for key in ("train", "held_out"):
        if getattr(study.terrains, key) < len(study.kinds):
            raise InputError(
                f"{source}: terrains.{key} is {getattr(study.terrains, key)}, but must be at least"
                f" {len(study.kinds)}, one for each of kinds"
            )
    most = max(study.terrains.train, study.terrains.held_out, study.randomise.lanes)
    cells = study.terrains.cells[0] * study.terrains.cells[1] * most
    if cells > MOST_CELLS:
        raise InputError(
            f"{source}: terrains.train, terrains.held_out and randomise.lanes times terrains.cells make {cells:.3g} cells, but"
            f" no more than {MOST_CELLS:.3g} are allowed"
        )
    for name, kind in study.kinds.items():
        if kind.generator not in KINDS:
            allowed = ", ".join(sorted(KINDS))
            raise InputError(f"{source}: kinds.{name}.generator is {kind.generator!r}, but must be one of {allowed}")
    _check_leaves(study, source)
    _check_spans(study, source)
    for box in rectangles(study):
        check_map(f"{source}: terrains.", study.terrains.cells, study.terrains.resolution, box, legs.foot_radius)
    _check_stances(study, source, legs)
    _check_workspaces(study, source, legs)
    _check_reach(study, source, legs)
    _check_randomised(study, source)


def _check_randomised(study: Study, source: str) -> None:
    """Lanes of each kind or none, of an engine that takes a robot a lane."""
    lanes, kinds = study.randomise.lanes, len(study.kinds)
    if 0 < lanes < kinds:
        raise InputError(f"{source}: randomise.lanes is {lanes}, but must be 0 or at least {kinds}, one for each of kinds")
    if lanes and study.simulation.engine == "mjx":
        raise InputError(
            f"{source}: simulation.engine is 'mjx', but must be 'legged' where randomise.lanes is above 0, because MJX's terms"
            " are those of one robot for all lanes"
        )


def _check_leaves(study: Study, source: str) -> None:
    """What is named is a number of the planner, within the limits of its key, and what moves does so once and within bounds."""
    _require_numbers(f"{source}: bounds", study.bounds)
    for name, span in study.bounds.items():
        convert(Span, span, source, f"bounds.{name}", RULES[name])
        if span[0] >= span[1]:
            raise InputError(f"{source}: bounds.{name} is {list(span)}, but its lower end must be below its upper end")
    _check_move(study, source)
    for kind, table in study.kinds.items():
        _require_numbers(f"{source}: kinds.{kind}.leaves", table.leaves)
        for name, value in table.leaves.items():
            key = f"kinds.{kind}.leaves.{name}"
            if name.startswith("gait."):
                raise InputError(f"{source}: {key} is {value:g}, but must be given as kinds.{kind}.{name}")
            convert(float, value, source, key, RULES[name])


def _check_move(study: Study, source: str) -> None:
    move = study.search.move
    if not move:
        raise InputError(f"{source}: search.move is [], but must name at least one number of the planner")
    _require_numbers(f"{source}: search.move", move)
    for name in move:
        if name not in study.bounds:
            raise InputError(f"{source}: bounds.{name} is missing; search.move names it, so it must be a list [low, high]")
        if move.count(name) > 1:
            raise InputError(f"{source}: search.move names {name} {move.count(name)} times, but must name each number once")


def _require_numbers(where: str, names: Iterable[str]) -> None:
    for name in HEADINGS.intersection(names):
        raise InputError(f"{where}: {name!r} may not be set, because a study's walks go along +x")
    try:
        require_known(names, RULES)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _check_spans(study: Study, source: str) -> None:
    spans = {f"kinds.{name}.difficulty": kind.difficulty for name, kind in study.kinds.items()}
    for key, span in (spans | {"band": study.band, "randomise.friction": study.randomise.friction}).items():
        if span[0] > span[1]:
            raise InputError(f"{source}: {key} is {list(span)}, but its lower end must not exceed its upper end")
    counted = study.search.counted
    if counted[0] >= counted[1]:
        raise InputError(f"{source}: search.counted is {list(counted)}, but its lower end must be below its upper end")


def check_map(
    where: str, cells: tuple[int, ...], resolution: float, box: Rectangle, foot_radius: float, heading: float = 0.0
) -> None:
    """Raise `InputError` for a map too coarse or too small to search footholds on for a walk at this heading [rad].

    Lengths in metres. `where` begins the sentence, up to the key: "map.npz: " or "study.toml: terrains.".
    """
    for what, limit in (("the foot's diameter", 2.0 * foot_radius), ("the rectangle's search_width", box.search_width)):
        if resolution > limit * (1.0 + 1e-6):
            raise InputError(f"{where}resolution is {resolution:g} m, but must be at most {what}, {limit:g} m")
    needs = bounding_sides(box.search_length + box.longer, box.search_width, heading)
    for count, axis, need in zip(cells, "xy", needs):
        if count * resolution < need - 1e-6:
            raise InputError(
                f"{where}cells along {axis} are {count}, {count * resolution:.3g} m, but the lengthened search rectangle"
                f" needs {need:.3g} m"
            )


def _check_stances(study: Study, source: str, legs: Legs) -> None:
    """H_COG lies between the thigh's length and the leg's; a skew is smaller than the stance, or feet pass one another."""
    for name, table in dataclasses.asdict(study.contestants).items():
        high = table["workspace"]["high"]
        if not legs.thigh < high < legs.length:
            raise InputError(
                f"{source}: contestants.{name}.workspace.high is {high:g}, but must be above the thigh's length,"
                f" {legs.thigh:g}, and below the leg's, {legs.length:g}"
            )
    stances = {f"contestants.{name}": table["skew"] for name, table in dataclasses.asdict(study.contestants).items()}
    for name, kind in study.kinds.items():
        for key, skew in (stances | {f"kinds.{name}.gait": kind.gait.skew}).items():
            if abs(skew) >= kind.gait.stance_length:
                raise InputError(
                    f"{source}: {key}.skew is {skew:g}, but must be smaller than kinds.{name}.gait.stance_length,"
                    f" {kind.gait.stance_length:g}"
                )
    key, *ends = _searched(study, "gait.skew")
    shortest = min(span_of(study, "gait.stance_length", [kind.gait.stance_length for kind in study.kinds.values()]))
    if max(map(abs, ends)) >= shortest:
        raise InputError(
            f"{source}: {key} is {_words(*ends)}, but must stay below the shortest gait.stance_length of kinds and bounds,"
            f" {shortest:g}"
        )


def _check_workspaces(study: Study, source: str, legs: Legs) -> None:
    """A foot somewhere in a workspace is within the leg's reach, and no search can turn one inside out."""
    spaces = {f"contestants.{name}": getattr(study.contestants, name).workspace for name in vars(study.contestants)}
    spaces |= {f"kinds.{name}.gait": kind.gait.workspace for name, kind in study.kinds.items()}
    for key, space in spaces.items():
        nearest = max(space.behind or 0.0, -(space.ahead or 0.0), 0.0)
        reach = float(np.hypot(nearest, space.low or 0.0))
        if reach >= legs.length:
            raise InputError(
                f"{source}: {key}.workspace begins {reach:.3g} m from the hip, but must begin within the leg's length,"
                f" {legs.length:g}"
            )
    for name, kind in study.kinds.items():
        behind, ahead = (_bound_of(study, kind, end) for end in ("behind", "ahead"))
        if behind[1] > ahead[0]:
            raise InputError(
                f"{source}: gait.workspace.behind may be {behind[1]:g} on {name}, but must not exceed the least"
                f" gait.workspace.ahead, {ahead[0]:g}; see bounds, search.move and kinds.{name}.gait.workspace"
            )
        low, high = kind.gait.workspace.low, study.contestants.paper.workspace.high
        if low is not None and low > high:
            raise InputError(
                f"{source}: kinds.{name}.gait.workspace.low is {low:g}, but must not exceed"
                f" contestants.paper.workspace.high, {high:g}, which the searched planners begin with"
            )


def _bound_of(study: Study, kind: Kind, end: str) -> Span:
    """Least and greatest value of a bound of the searched planners' workspace on a kind."""
    leaf, own = f"gait.workspace.{end}", getattr(kind.gait.workspace, end)
    if leaf in study.search.move:
        return study.bounds[leaf]
    return (own, own) if own is not None else {"behind": (-np.inf, -np.inf), "ahead": (np.inf, np.inf)}[end]


def _searched(study: Study, leaf: str) -> tuple[str, float, float]:
    """The key that says how far a number may go in the searched planners, and its least and greatest value."""
    if leaf in study.search.move:
        return f"bounds.{leaf}", *study.bounds[leaf]
    value: Any = functools.reduce(getattr, HELD[leaf].split("."), study)
    return HELD[leaf], value, value


def _words(low: float, high: float) -> str:
    return str([low, high]) if low < high else f"{low:g}"


def _check_reach(study: Study, source: str, legs: Legs) -> None:
    """Paper A's constraints (5)-(7) and H_COG > L2 at the corner of the bounds that is easiest to meet."""
    step, search = _searched(study, "gait.step_length"), _searched(study, "foothold.rectangle.length")
    _check_heights(source, legs, *_searched(study, "gait.workspace.high"), step[1:], search)
    if "gait.workspace.high" in study.search.move:
        _check_heights(source, legs, "band", *study.band, (study.contestants.paper.step_length,) * 2, search)


def _check_heights(
    source: str, legs: Legs, key: str, low: float, high: float, step: tuple[float, float], search: tuple[str, float, float]
) -> None:
    """The same for a range of H_COG with a range of steps [m]."""
    heights, half = f"{key} is {_words(low, high)}", np.sqrt(max(legs.length**2 - low**2, 0.0))
    box, least = search[:2]
    if high <= legs.thigh:
        raise InputError(f"{source}: {heights}, but H_COG > L2 (the knee's clearance) asks for more than {legs.thigh:g}")
    if low >= legs.length:
        raise InputError(f"{source}: {heights}, but the leg's length {legs.length:g} must exceed its lower end")
    if step[0] >= half:
        raise InputError(
            f"{source}: the step length of at least {step[0]:g} and {key} {_words(low, high)} exclude each other:"
            f" constraint (6), L_Step < sqrt(L_Leg^2 - H_COG^2), allows less than {half:.3f}"
        )
    if least >= 2.0 * step[1]:
        raise InputError(
            f"{source}: {box} is {least:g}, but constraint (5), L_Search < 2 L_Step, allows less than {2.0 * step[1]:g}"
        )
    if least >= 2.0 * half - 0.5 * step[0]:
        raise InputError(
            f"{source}: {box} is {least:g}, but constraint (7), L_Search < 2 sqrt(L_Leg^2 - H_COG^2)"
            f" - L_Step/2, allows less than {2.0 * half - 0.5 * step[0]:.3f} at {key} {_words(low, high)}"
        )
