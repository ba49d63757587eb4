"""What a plan's file must hold: layout and limits of every array that a replay reads, and how they fit together.

The limits keep out what no quadrupeds and walks have; they are far wider than what planning itself allows.
"""

import dataclasses
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jax import dtypes

from jaxleg.conventions import LEGS, InputError
from jaxleg.leg.energy import Convention
from jaxleg.npz import Layout
from jaxleg.settings import build, setting
from jaxleg.terrain.files import LAYOUTS as MAP
from jaxleg.terrain.files import check_map

FAR = 1e4  # of any place from the datum [m]: float32 then still holds it to a millimetre
DAY = 86400.0  # longest walk [s]
PAUSE = 60.0  # most between two samples [s]
UNIT, TURN = 1e-3, 0.9  # allowed error of a length 1; least cosine of half the trunk's turn from a sample to the next
SHORTEST = 0.01  # thigh and shank [m]
APART = 0.01  # most between a planned foot and where the joint angles put it [m]


class Numbers(NamedTuple):
    """An array's shape (T samples, K stances) and the limits of its numbers."""

    shape: tuple[int | str, ...]
    low: float
    high: float


WALK = {
    "time": Numbers(("T",), 0.0, DAY),
    "joint_pos": Numbers(("T", 4, 3), -10.0, 10.0),
    "joint_vel": Numbers(("T", 4, 3), -1e3, 1e3),
    "joint_torque_ff": Numbers(("T", 4, 3), -1e5, 1e5),
    "base_pos": Numbers(("T", 3), -FAR, FAR),
    "base_quat": Numbers(("T", 4), -1.0 - UNIT, 1.0 + UNIT),
    "base_vel": Numbers(("T", 6), -100.0, 100.0),
    "foot_pos": Numbers(("T", 4, 3), -FAR, FAR),
    "load": Numbers(("T", 4), 0.0, 1.0),
    "footholds": Numbers(("K", 4, 3), -FAR, FAR),
    "goal": Numbers((2,), -FAR, FAR),
    "origin_xy": Numbers((2,), -FAR, FAR),
}
ROBOT = {
    "hip_position": Numbers((4, 3), -5.0, 5.0),
    "joint_axis": Numbers((4, 3, 3), -1.0 - UNIT, 1.0 + UNIT),
    "link_offset": Numbers((4, 3, 3), -5.0, 5.0),
    "trunk_mass": Numbers((), 1e-2, 1e4),
    "trunk_com": Numbers((3,), -5.0, 5.0),
    "trunk_inertia": Numbers((3,), 1e-6, 1e5),
    "link_mass": Numbers((4, 3), 1e-9, 1e4),
    "link_com": Numbers((4, 3, 3), -5.0, 5.0),
    "link_inertia": Numbers((4, 3, 3), 1e-18, 1e4),
    "rotor_inertia": Numbers((4, 3), 0.0, 1e8),
    "joint_damping": Numbers((4, 3), 0.0, 1e4),
    "torque_limit": Numbers((4, 3), 1e-6, 1e6),
    "stiffness": Numbers((4, 3), 1e-3, 1e7),
    "velocity_gain": Numbers((4, 3), 0.0, 1e6),
    "foot_radius": Numbers((), 1e-4, 0.1),
    "contact_radius": Numbers((), 1e-4, 0.1),
    "leg_radius": Numbers((), 1e-4, 0.1),
    "joint_range": Numbers((4, 3, 2), -6.3, 6.3),
    "trunk_size": Numbers((3,), 1e-2, 10.0),
    "torque_constant": Numbers((), 1e-6, 1e3),
    "resistance": Numbers((), 1e-6, 1e4),
    "gear_ratio": Numbers((), 1e-2, 1e4),
    "knee_sign": Numbers((), -1.0, 1.0),
}
NUMBERS = WALK | {f"robot/{name}": rule for name, rule in ROBOT.items()}
LAYOUTS = {"valid": Layout(("T",), "booleans"), "params": Layout((), "a text")}
LAYOUTS |= {key: layout._replace(optional=False) for key, layout in MAP.items()}
LAYOUTS |= {key: Layout(rule.shape) for key, rule in NUMBERS.items()}


@dataclasses.dataclass(frozen=True)
class Params:
    """The keys of `params` that a replay needs; limits as in the settings they come from."""

    friction: float = setting(min=0.1, max=2.0)
    samples_a_step: int = setting(min=8, max=2000)
    tick: float = setting(min=0.0005, max=0.004, unit="s")
    steps: int = setting(min=0, max=100_000)
    power: Convention = setting()


def checked_params(path: Any, text: str) -> dict[str, Any]:
    """`params` as a table. Raises `InputError` naming the file and the key."""
    try:
        table = json.loads(text)
    except (ValueError, RecursionError):
        table = None
    if not isinstance(table, dict):
        raise InputError(f"{path}: params is no JSON object")
    names = [field.name for field in dataclasses.fields(Params)]
    build(Params, {name: table[name] for name in names if name in table}, f"{path}: params")
    return table


def check_plan(path: Any, arrays: Mapping[str, np.ndarray], params: Mapping[str, Any]) -> None:
    """Raises `InputError`, one sentence that names file and key, for what is no plan of a walk of a robot over a map."""
    for key, (_, low, high) in NUMBERS.items():
        value = arrays[key]
        if not np.all((value >= low) & (value <= high)):
            raise InputError(f"{path}: {key} {_first(value, low, high)}, but must be from {low:g} to {high:g}")
    check_map(path, arrays)
    _check_time(path, arrays["time"], params["tick"])
    _check_counts(path, arrays["valid"], len(arrays["footholds"]), params)
    _check_turns(path, arrays["base_quat"])
    robot = {name: arrays[f"robot/{name}"] for name in ROBOT}
    _check_robot(path, robot)
    _check_feet(path, robot, arrays, params["samples_a_step"])


def _first(value: np.ndarray, low: float, high: float) -> str:
    """The first number outside the limits, and where."""
    place = tuple(int(i) for i in np.argwhere(~((value >= low) & (value <= high)))[0])
    return f"is {value[place]:g}" + (f" at {list(place)}" if place else "")


def _check_time(path: Any, time: np.ndarray, tick: float) -> None:
    between = np.diff(time.astype(dtypes.canonicalize_dtype(float)))  # as it will be used: float32 stops rising after hours
    if len(between) and time[0] != 0.0:
        raise InputError(f"{path}: time begins at {time[0]:g} s, but must at 0")
    if not np.all((between > 0.0) & (between <= PAUSE)):
        at = int(np.argmin((between > 0.0) & (between <= PAUSE)))
        words = f"goes from {time[at]:g} to {time[at + 1]:g} s after sample {at}"
        raise InputError(f"{path}: time {words}, but must rise, by at most {PAUSE:g} s")
    if len(between) and time[-1] < tick * len(between):
        words = f"{len(between)} samples in {time[-1]:g} s, more than its ticks of {tick:g} s"
        raise InputError(f"{path}: time has {words}")


def _check_counts(path: Any, valid: np.ndarray, stances: int, params: Mapping[str, Any]) -> None:
    rows, steps, each = int(valid.sum()), params["steps"], params["samples_a_step"]
    if rows < 2 or not valid[:rows].all():
        raise InputError(f"{path}: valid is true {rows} times, but must be for at least the first 2 samples and no later gap")
    if stances != steps + 1:
        raise InputError(f"{path}: footholds has {stances} stances, but params.steps is {steps}, which needs {steps + 1}")
    if not 0 < rows - 1 - steps * each < each:
        words = f"params has {steps} steps of {each} samples, a shift of fewer and an end point"
        raise InputError(f"{path}: valid is true {rows} times, but {words}")


def _check_turns(path: Any, quaternion: np.ndarray) -> None:
    wrong = abs(np.linalg.norm(quaternion, axis=1) - 1.0) > UNIT
    if wrong.any():
        raise InputError(f"{path}: base_quat is {quaternion[wrong][0].tolist()}, but must have length 1")
    far = np.sum(quaternion[1:] * quaternion[:-1], axis=1) < TURN
    if far.any():
        raise InputError(f"{path}: base_quat turns too far, or to the other sign, after sample {int(np.argmax(far))}")


def _check_robot(path: Any, robot: Mapping[str, np.ndarray]) -> None:
    """What must hold between a robot's numbers."""
    if np.any(abs(np.linalg.norm(robot["joint_axis"], axis=-1) - 1.0) > UNIT):
        raise InputError(f"{path}: robot/joint_axis must have length 1 for every joint")
    if np.any(np.linalg.norm(robot["link_offset"][:, 1:], axis=-1) < SHORTEST):
        raise InputError(f"{path}: robot/link_offset must be at least {SHORTEST:g} m long for every thigh and shank")
    if robot["knee_sign"] not in (-1.0, 1.0):
        raise InputError(f"{path}: robot/knee_sign is {robot['knee_sign']:g}, but must be -1 or 1")
    low, high = np.moveaxis(robot["joint_range"], -1, 0)
    if np.any(low >= high):
        leg, joint = np.argwhere(low >= high)[0]
        words = f"from {low[leg, joint]:g} to {high[leg, joint]:g} rad"
        raise InputError(f"{path}: robot/joint_range of {LEGS[leg]}, joint {joint}, goes {words}, but must rise")
    for key in ("trunk_inertia", "link_inertia"):
        if np.any(2.0 * robot[key].max(axis=-1) > robot[key].sum(axis=-1)):
            raise InputError(f"{path}: robot/{key} has a moment that is greater than the other two together")


def _check_feet(path: Any, robot: Mapping[str, np.ndarray], arrays: Mapping[str, np.ndarray], each: int) -> None:
    """The joint angles must put the feet where the plan has them, and each step begin on its footholds."""
    in_trunk = _feet(robot, arrays["joint_pos"])
    real, vector = arrays["base_quat"][:, 0], arrays["base_quat"][:, 1:]
    length = np.linalg.norm(vector, axis=1)
    turn = _rotation(2.0 * np.arctan2(length, real), vector / np.maximum(length, 1e-12)[:, None])
    feet = arrays["base_pos"][:, None] + np.einsum("tab,tlb->tla", turn, in_trunk)
    starts = arrays["foot_pos"][np.arange(len(arrays["footholds"])) * each]
    cause = "where joint_pos, base_pos and base_quat put it"
    _check_near(path, "foot_pos", arrays["foot_pos"], feet, cause)
    _check_near(path, "footholds", arrays["footholds"], starts, "foot_pos as the step begins")


def _check_near(path: Any, key: str, feet: np.ndarray, others: np.ndarray, cause: str) -> None:
    apart = np.linalg.norm(feet - others, axis=-1)
    if np.any(apart > APART):
        at, leg = (int(i) for i in np.argwhere(apart > APART)[0])
        raise InputError(f"{path}: {key} of {LEGS[leg]} at {at} is {apart[at, leg]:.3g} m from {cause}")


def _feet(robot: Mapping[str, np.ndarray], angles: np.ndarray) -> np.ndarray:
    """Foot centres (T, leg, 3) in B [m] by the rotations about each joint's axis."""
    place, turn = robot["hip_position"], np.eye(3)
    for joint in range(3):
        turn = turn @ _rotation(angles[:, :, joint], robot["joint_axis"][:, joint])
        place = place + (turn @ robot["link_offset"][:, joint, :, None])[..., 0]
    return place


def _rotation(angle: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Rotation matrices by Rodrigues's formula; leading axes of both broadcast."""
    across = -np.cross(axis[..., None, :], np.eye(3))
    sine, cosine = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + sine * across + (1.0 - cosine) * across @ across
