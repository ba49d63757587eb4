"""What no single key of a study's configuration shows: its settings against each other and against the robot."""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxleg.conventions import InputError
from jaxleg.foothold.rectangle import bounding_sides
from jaxleg.search.config import Rectangle, Study
from jaxleg.terrain.generators import KINDS

MOST_CELLS = 2**31  # of all maps of a study together: 8 GiB


class Legs(NamedTuple):
    """The robot's numbers [m] that a study is checked against."""

    length: float
    thigh: float
    foot_radius: float


def check_study(study: Study, source: str, legs: Legs) -> None:
    """Raise `InputError`, one sentence, for too few terrains, an empty range, a map or a stance that cannot serve, or bounds
    that no gait can meet."""
    if not study.kinds:
        raise InputError(f"{source}: kinds is empty, but at least one table [kinds.NAME] is needed")
    for key in ("train", "held_out"):
        if getattr(study.terrains, key) < len(study.kinds):
            raise InputError(
                f"{source}: terrains.{key} is {getattr(study.terrains, key)}, but must be at least"
                f" {len(study.kinds)}, one for each of kinds"
            )
    cells = study.terrains.cells[0] * study.terrains.cells[1] * max(study.terrains.train, study.terrains.held_out)
    if cells > MOST_CELLS:
        raise InputError(
            f"{source}: terrains.train and terrains.held_out times terrains.cells make {cells:.3g} cells, but no more than"
            f" {MOST_CELLS:.3g} are allowed"
        )
    for name, kind in study.kinds.items():
        if kind.generator not in KINDS:
            allowed = ", ".join(sorted(KINDS))
            raise InputError(f"{source}: kinds.{name}.generator is {kind.generator!r}, but must be one of {allowed}")
    _check_spans(study, source)
    check_map(f"{source}: terrains.", study.terrains.cells, study.terrains.resolution, study.rectangle, legs.foot_radius)
    _check_stances(study, source, legs)
    _check_reach(study, source, legs)


def _check_spans(study: Study, source: str) -> None:
    spans = {f"bounds.{name}": span for name, span in dataclasses.asdict(study.bounds).items()}
    spans |= {f"kinds.{name}.difficulty": kind.difficulty for name, kind in study.kinds.items()}
    for key, span in (spans | {"band": study.band}).items():
        if span[0] > span[1]:
            raise InputError(f"{source}: {key} is {list(span)}, but its lower end must not exceed its upper end")


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
        if not legs.thigh < table["hip_height"] < legs.length:
            raise InputError(
                f"{source}: contestants.{name}.hip_height is {table['hip_height']:g}, but must be above the thigh's length,"
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
    skew, shortest = max(map(abs, study.bounds.skew)), study.bounds.stance_length[0]
    if skew >= shortest:
        raise InputError(
            f"{source}: bounds.skew is {list(study.bounds.skew)}, but must stay below the shortest stance of"
            f" bounds.stance_length, {shortest:g}"
        )


def _check_reach(study: Study, source: str, legs: Legs) -> None:
    """Paper A's constraints (5)-(7) and H_COG > L2 at the corner of the bounds that is easiest to meet."""
    for key, low, high, step in (
        ("bounds.hip_height", *study.bounds.hip_height, study.bounds.step_length),
        ("band", *study.band, (study.contestants.paper.step_length,) * 2),
    ):
        half = np.sqrt(max(legs.length**2 - low**2, 0.0))
        search = study.rectangle.search_length
        if high <= legs.thigh:
            raise InputError(
                f"{source}: {key} is {[low, high]}, but H_COG > L2 (the knee's clearance) asks for more than {legs.thigh:g}"
            )
        if low >= legs.length:
            raise InputError(
                f"{source}: {key} is {[low, high]}, but the leg's length {legs.length:g} must exceed its lower end"
            )
        if step[0] >= half:
            raise InputError(
                f"{source}: the step length of at least {step[0]:g} and {key} {[low, high]} exclude each other:"
                f" constraint (6), L_Step < sqrt(L_Leg^2 - H_COG^2), allows less than {half:.3f}"
            )
        if search >= 2.0 * step[1]:
            raise InputError(
                f"{source}: rectangle.search_length is {search:g}, but constraint (5), L_Search < 2 L_Step, allows less than"
                f" {2.0 * step[1]:g}"
            )
        if search >= 2.0 * half - 0.5 * step[0]:
            raise InputError(
                f"{source}: rectangle.search_length is {search:g}, but constraint (7), L_Search < 2 sqrt(L_Leg^2 - H_COG^2)"
                f" - L_Step/2, allows less than {2.0 * half - 0.5 * step[0]:.3f} at {key} {[low, high]}"
            )
