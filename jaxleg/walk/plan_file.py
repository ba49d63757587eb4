"""Plans as files: `plan.npz` holds all that a replay needs, energy included, without this package.

time (T) [s], joint_pos, joint_vel (T,4,3) [rad, rad/s], joint_torque_ff (T,4,3) [N m], base_pos (T,3) [m], base_quat (T,4),
base_vel (T,6), foot_pos (T,4,3) [m], contact (T,4), load (T,4) in [0, 1], valid (T)
footholds (K,4,3), com_waypoints (K,6) (trunk poses), leg_order
kp, kd (4,3); robot (name), robot_mjcf, motor, params (JSON); elevation, resolution, origin_xy (the map); goal (2)
robot/FIELD: the fields of `jaxleg.robot.Robot`
datum (3) [m, W], float64: all places and heights in the file, the map's too, count from it; what is at p is at datum + p in W

K stances are K - 1 steps; each has `params.samples_a_step` samples, the last shift some more, and the end one.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxleg.conventions import LEGS
from jaxleg.npz import read_npz, write_npz
from jaxleg.robot import Robot
from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.terrain.files import MapFile, map_arrays, to_terrain
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference
from jaxleg.walk.plan_check import LAYOUTS, check_plan, checked_params

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


class PlanFile(NamedTuple):
    """A plan as read: what a replay needs. All places count from `datum`."""

    robot: Robot
    terrain: HeightMap
    reference: Reference
    footholds: np.ndarray  # (K, 4, 3)
    goal: np.ndarray  # (2,)
    params: dict[str, Any]
    samples: int  # of the reference a step
    datum: np.ndarray  # (3,) in W [m], float64


def save_plan(
    path: str | Path,
    name: str,
    robot: Robot,
    ground: MapFile,
    reference: Reference,
    footholds: np.ndarray,
    poses: np.ndarray,
    goal: np.ndarray,
    params: dict[str, Any],
) -> None:
    """Write a plan; all its samples are valid, all its places count from the datum of `ground`.

    Raises `InputError` where nothing can be written.
    """
    arrays: dict[str, Any] = {key: np.asarray(getattr(reference, field)) for field, key in COLUMNS.items()}
    load = arrays["load"]
    arrays |= {"contact": load > 0.5, "valid": np.ones(len(load), bool), "leg_order": np.array(LEGS)}
    arrays |= {"footholds": footholds, "com_waypoints": poses, "goal": np.asarray(goal)} | map_arrays(*ground)
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
    write_npz(path, arrays)


def load_plan(path: str | Path) -> PlanFile:
    """Read a plan. Raises `InputError`, one sentence naming file, key and what is wrong; nothing is used unchecked."""
    arrays = read_npz(path, LAYOUTS, "is this a plan that `jaxleg plan` wrote?")
    params = checked_params(path, arrays["params"])
    check_plan(path, arrays, params)
    used = arrays["valid"]
    robot = Robot(**{field.name: jnp.asarray(arrays[f"robot/{field.name}"], float) for field in dataclasses.fields(Robot)})
    terrain = to_terrain(*(arrays[key] for key in ("elevation", "origin_xy", "resolution")))
    reference = Reference(**{field: jnp.asarray(arrays[key][used], float) for field, key in COLUMNS.items()})
    samples = params["samples_a_step"]
    return PlanFile(robot, terrain, reference, arrays["footholds"], arrays["goal"], params, samples, arrays["datum"])
