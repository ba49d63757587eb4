"""A small plan's file, made by hand: one second of standing, called a walk of one step."""

import json
from pathlib import Path

import jax
import numpy as np

from jaxleg.posture.body import joint_angles
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_quaternion
from jaxleg.terrain.files import MapFile
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference
from jaxleg.walk.plan_file import save_plan

FEET = np.array([[1.34, 1.2, 0.0], [1.34, 0.8, 0.0], [0.74, 1.2, 0.0], [0.74, 0.8, 0.0]])
TRUNK = np.array([1.04, 1.0, 0.46])
SHIFT, EACH, SECONDS = 8, 16, 1.0  # samples of the last shift and of a step
PARAMS = {"friction": 0.8, "samples_a_step": EACH, "tick": 0.0025, "steps": 1, "power": "positive"}


def standing(robot: Robot, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Reference:
    """A second of standing over `FEET`, the trunk turned by (pitch, roll, yaw) [rad]."""
    count = EACH + SHIFT + 1
    feet = FEET + np.array([0.0, 0.0, float(robot.contact_radius)])
    angles, _ = jax.jit(joint_angles)(robot, np.array([*TRUNK, *turn]), feet)
    zero, quaternion = np.zeros((4, 3)), jax.jit(trunk_quaternion)(np.array(turn))
    rows = (angles, zero, zero, TRUNK, quaternion, np.zeros(6), feet, np.ones(4))
    return Reference(np.linspace(0.0, SECONDS, count), *(np.repeat(np.asarray(x)[None], count, axis=0) for x in rows))


def save_standing(
    path: Path,
    robot: Robot,
    elevation: np.ndarray | None = None,
    datum: np.ndarray | None = None,
    walk: Reference | None = None,
) -> Path:
    """Write the plan, or another `walk`, on level ground of 60 x 50 cells unless another is given."""
    elevation = np.zeros((60, 50)) if elevation is None else elevation
    terrain = HeightMap(elevation, np.zeros(2), np.array(0.04))
    ground = MapFile(terrain, np.zeros(3) if datum is None else datum)
    walk = standing(robot) if walk is None else walk
    save_plan(path, "standing", robot, ground, walk, walk.foot_pos[[0, EACH]], np.zeros((2, 6)), TRUNK[:2], PARAMS)
    return path


def arrays_of(path: Path) -> dict[str, np.ndarray]:
    """All of an archive."""
    with np.load(path) as file:
        return {key: file[key] for key in file.files}


def with_params(arrays: dict[str, np.ndarray], **changes) -> dict[str, np.ndarray]:
    """The arrays with other `params`; None takes a key out."""
    params = json.loads(str(arrays["params"])) | changes
    return arrays | {"params": np.array(json.dumps({key: value for key, value in params.items() if value is not None}))}
