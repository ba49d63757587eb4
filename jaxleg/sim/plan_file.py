"""Plans as files: `plan.npz` holds all that a replay needs, energy included, without this package.

time (T) [s], joint_pos, joint_vel (T,4,3) [rad, rad/s], joint_torque_ff (T,4,3) [N m], base_pos (T,3) [m], base_quat (T,4),
base_vel (T,6), foot_pos (T,4,3) [m, W], contact (T,4), load (T,4) in [0, 1], valid (T)
footholds (K,4,3), foothold_status (K,4), swing_status (K-1), com_waypoints (K,6) (trunk poses), leg_order
kp, kd (4,3); robot (name), robot_mjcf, motor, params (JSON); elevation, resolution, origin_xy (the map); goal (2)
robot/FIELD: the fields of `jaxleg.robot.Robot`
"""

import dataclasses
import json
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxleg.conventions import LEGS, InputError
from jaxleg.plan import Reference
from jaxleg.robot import Robot
from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.terrain.heightmap import HeightMap

COLUMNS = {  # of `Reference` in the file
    "time": "time",
    "joint_pos": "joint_pos",
    "joint_vel": "joint_vel",
    "joint_torque": "joint_torque_ff",
    "trunk_pos": "base_pos",
    "trunk_quat": "base_quat",
    "trunk_vel": "base_vel",
    "foot_pos": "foot_pos",
    "contact": "load",
}
SHAPES = {"time": (), "joint_pos": (4, 3), "joint_vel": (4, 3), "joint_torque_ff": (4, 3), "base_pos": (3,)}
SHAPES |= {"base_quat": (4,), "base_vel": (6,), "foot_pos": (4, 3), "load": (4,)}


class PlanFile(NamedTuple):
    """A plan as read: what a replay needs."""

    robot: Robot
    terrain: HeightMap
    reference: Reference
    footholds: np.ndarray  # (K, 4, 3)
    goal: np.ndarray  # (2,)
    params: dict[str, Any]
    samples: int  # of the reference a step


def save_plan(
    path: str | Path,
    name: str,
    robot: Robot,
    terrain: HeightMap,
    reference: Reference,
    footholds: np.ndarray,
    poses: np.ndarray,
    goal: np.ndarray,
    params: dict[str, Any],
) -> None:
    """Write a plan; all its samples are valid. Raises `InputError` where nothing can be written."""
    arrays: dict[str, Any] = {key: np.asarray(getattr(reference, field)) for field, key in COLUMNS.items()}
    load = arrays["load"]
    arrays |= {"contact": load > 0.5, "valid": np.ones(len(load), bool), "leg_order": np.array(LEGS)}
    count = len(footholds)
    arrays |= {
        "footholds": footholds,
        "foothold_status": np.zeros((count, 4), np.int32),
        "swing_status": np.zeros(count - 1, np.int32),
        "com_waypoints": poses,
        "goal": np.asarray(goal),
    }
    arrays |= {"elevation": terrain.elevation, "resolution": terrain.resolution, "origin_xy": terrain.origin}
    motor = {key: float(getattr(robot, key)) for key in ("torque_constant", "resistance", "gear_ratio")}
    arrays |= {
        "robot": np.array(name),
        "robot_mjcf": np.array(robot_mjcf(robot)),
        "motor": np.array(json.dumps(motor | {"convention": params.get("power", "positive")})),
        "params": np.array(json.dumps(params)),
        "kp": robot.stiffness,
        "kd": robot.velocity_gain,
    }
    arrays |= {f"robot/{field.name}": getattr(robot, field.name) for field in dataclasses.fields(Robot)}
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, allow_pickle=False, **{key: np.asarray(value) for key, value in arrays.items()})
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from error


def load_plan(path: str | Path) -> PlanFile:
    """Read a plan. Raises `InputError` naming file, key and what is wrong."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        reason = getattr(error, "strerror", None) or "it is not a .npz file of plain arrays"
        raise InputError(f"{path}: cannot be read: {reason}") from error
    fields = [f"robot/{field.name}" for field in dataclasses.fields(Robot)]
    for key in (*SHAPES, *fields, "valid", "footholds", "goal", "elevation", "resolution", "origin_xy", "params"):
        if key not in arrays:
            raise InputError(f"{path}: {key} is missing; is this a plan that `jaxleg plan` wrote?")
    rows = len(arrays["valid"])
    for key, shape in SHAPES.items():
        if arrays[key].shape != (rows, *shape):
            raise InputError(f"{path}: {key} has shape {arrays[key].shape}, but must be {(rows, *shape)}")
        if not np.isfinite(arrays[key]).all():
            raise InputError(f"{path}: {key} is not finite in all of its {rows} samples")
    used = arrays["valid"].astype(bool)
    robot = Robot(**{key.split("/")[1]: jnp.asarray(arrays[key], float) for key in fields})
    ground = HeightMap(*(jnp.asarray(arrays[key], float) for key in ("elevation", "origin_xy", "resolution")))
    reference = Reference(**{field: jnp.asarray(arrays[key][used], float) for field, key in COLUMNS.items()})
    params = json.loads(str(arrays["params"]))
    return PlanFile(robot, ground, reference, arrays["footholds"], arrays["goal"], params, int(params["samples_a_step"]))
