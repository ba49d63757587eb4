"""What no single key of a robot's file shows: its numbers against each other, and whether MuJoCo can build the robot.

A standing posture here has its foot below the hip at a quarter of the leg's length or more, at most 0.35 of it fore or aft and
aside of where it hangs, the knee bent by 5 degrees or more to its own side and above the foot. A range of joints is refused
only where it excludes all of these, a torque limit only where none of them can be held.
"""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from jaxleg.conventions import GRAVITY, JOINTS, InputError
from jaxleg.robot.file import Geometry, RobotFile, build_robot
from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.robot.model import Robot
from jaxleg.settings import load

LEAST_TRUNK = 0.1  # share of the trunk in the total mass
LEAST_LINK = 1e-4  # share of a link
LEAST_BEND = np.deg2rad(5.0)
SAMPLES = (25, 61, 61)  # of hip, thigh and knee over their ranges
OPEN = (-180.0, 180.0)
Spans = list[tuple[float, float]]  # [deg]


class _Standing(NamedTuple):
    """Standing postures, leading axis posture."""

    angles: np.ndarray  # (posture, joint) [rad]
    height: np.ndarray  # of the hip over the foot [m]
    arm: np.ndarray  # (posture, joint): torque of each joint over the force at the foot [m]


def load_robot(path: str | Path) -> Robot:
    """Read a robot's TOML file. Raises `InputError` naming the file, the key and what is allowed."""
    file = load(RobotFile, path)
    check_robot(file, str(path))
    return build_robot(file)


def check_robot(file: RobotFile, source: str) -> None:
    """Raise `InputError`, one sentence that begins with `source`, for a robot that cannot be: see this module."""
    _check_masses(file, source)
    spans = _spans(file.geometry)
    for joint, (low, high) in zip(JOINTS, spans):
        if low >= high:
            raise InputError(
                f"{source}: geometry.{joint}_range_deg is {[low, high]}, but must go from the least angle to the greatest"
            )
    standing = _standing(file.geometry, spans)
    if not len(standing.angles):
        raise InputError(f"{source}: {_excluded(file.geometry, spans)}")
    _check_torque(file, source, standing)
    _check_model(file, source)


def _check_masses(file: RobotFile, source: str) -> None:
    masses, size = file.masses, file.geometry.trunk_size
    for name in ("hip", "thigh", "shank"):
        if getattr(masses, name) < LEAST_LINK * masses.total:
            raise InputError(
                f"{source}: masses.{name} is {getattr(masses, name):g} kg, but must be at least {LEAST_LINK:g} of masses.total,"
                f" {LEAST_LINK * masses.total:g} kg"
            )
    legs = 4.0 * (masses.hip + masses.thigh + masses.shank)
    if masses.total * (1.0 - LEAST_TRUNK) < legs:
        raise InputError(
            f"{source}: masses.total is {masses.total:g} kg, but the four legs weigh {legs:g} kg and the trunk must have a"
            f" tenth of the total: it must be at least {legs / (1.0 - LEAST_TRUNK):.4g} kg"
        )
    for axis, offset, length in zip("xyz", masses.com_offset, size):
        if abs(offset) > 0.5 * length:
            raise InputError(
                f"{source}: masses.com_offset is {offset:g} m along {axis}, but must lie in the trunk's box:"
                f" from {-0.5 * length:g} to {0.5 * length:g}"
            )


def _spans(geometry: Geometry) -> Spans:
    return [geometry.hip_range_deg, geometry.thigh_range_deg, geometry.knee_range_deg]


def _standing(geometry: Geometry, spans: Spans) -> _Standing:
    """Standing postures with the joints in these ranges: paper A, equation (2), over a grid of angles."""
    axes = [np.deg2rad([*np.linspace(*span, count), np.clip(0.0, *span)]) for span, count in zip(spans, SAMPLES)]
    angles: np.ndarray = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    hip, thigh, shank = angles[:, 0], angles[:, 1], angles[:, 1] + angles[:, 2]
    knee_x, knee_drop = geometry.thigh * np.sin(thigh), geometry.thigh * np.cos(thigh)
    # as the inverse kinematics has it, the leg hangs down from its hip (drop > 0)
    x, drop = knee_x + geometry.shank * np.sin(shank), knee_drop + geometry.shank * np.cos(shank)
    y = geometry.hip_link * np.cos(hip) + drop * np.sin(hip)
    height = drop * np.cos(hip) - geometry.hip_link * np.sin(hip)
    leg, side = geometry.thigh + geometry.shank, 1.0 if geometry.knees == "backward" else -1.0
    stands = (height >= 0.25 * leg) & (drop > 0.0) & (np.cos(shank) * np.cos(hip) > 0.0) & (side * angles[:, 2] >= LEAST_BEND)
    stands &= (abs(x) <= 0.35 * leg) & (y >= -0.1 * leg) & (y <= geometry.hip_link + 0.35 * leg)
    arm = abs(np.stack([y, x * np.cos(hip), (x - knee_x) * np.cos(hip)], axis=-1))
    return _Standing(angles[stands], height[stands], arm[stands])


def _excluded(geometry: Geometry, spans: Spans) -> str:
    """Why no standing posture is left: the one range that excludes them, or all three."""
    for j, joint in enumerate(JOINTS):
        opened = _standing(geometry, [*spans[:j], OPEN, *spans[j + 1 :]])
        if len(opened.angles):
            low, high = np.rad2deg([opened.angles[:, j].min(), opened.angles[:, j].max()])
            return (
                f"geometry.{joint}_range_deg is {list(spans[j])}, but the robot stands with its {joint}s between {low:.0f} and"
                f" {high:.0f} degrees{_hint(spans[j : j + 1])}"
            )
    named = ", ".join(f"{joint}_range_deg {list(span)}" for joint, span in zip(JOINTS, spans))
    return f"geometry.{named} exclude every standing posture with the knees {geometry.knees}{_hint(spans)}"


def _hint(spans: Spans) -> str:
    radians = max(abs(angle) for span in spans for angle in span) <= np.pi + 0.01
    return "; these look like radians, but must be degrees" if radians else ""


def _check_torque(file: RobotFile, source: str, standing: _Standing) -> None:
    arm = standing.arm.max(axis=1)
    best = int(np.argmin(arm))
    needed, joint = 0.25 * file.masses.total * GRAVITY * arm[best], JOINTS[int(np.argmax(standing.arm[best]))]
    if file.motor.torque_limit < needed:
        raise InputError(
            f"{source}: motor.torque_limit is {file.motor.torque_limit:g} N m, but must be at least {needed:.3g}: so much asks"
            f" a quarter of the weight of the {joint} in the easiest standing posture, {standing.height[best]:.2f} m high"
        )


def _check_model(file: RobotFile, source: str) -> None:
    robot = build_robot(file)
    for name, leaf in vars(robot).items():
        if not np.isfinite(np.asarray(leaf, np.float32)).all():
            raise InputError(f"{source}: the robot's {name} is not a finite number of single precision")
    try:
        mujoco.MjModel.from_xml_string(robot_mjcf(robot))
    except ValueError as error:
        reason = str(error).strip().splitlines()[0].removeprefix("Error: ")
        raise InputError(f"{source}: MuJoCo cannot build this robot: {reason}") from error
