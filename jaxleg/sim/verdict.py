"""What the referee says of C MuJoCo's steps, with feedback or without: the meters of `meters`, the falls of `fall`.

Arrays have leading axes lane and step. `states` are MuJoCo's full physics states: time, q, v; `sensors` are `build_model`'s.
"""

from typing import NamedTuple

import jax
import mujoco
import numpy as np

from jaxleg.gait.support import stability_margin
from jaxleg.leg.energy import Power, motor_power
from jaxleg.robot import Robot
from jaxleg.sim.fall import overturned
from jaxleg.sim.meters import least_load
from jaxleg.sim.model import STEP, TRUNK_CONTACT, Surface, over_unseen, surface_of
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference

LOOK = 10  # steps from one look at the margin to the next: rigid feet lose contact for shorter than that


class Verdict(NamedTuple):
    """What the referee measured, leading axis lane; SI units."""

    energy: Power  # of all joints [J]
    moved: np.ndarray  # how far the trunk has come (lane, 3) [m]
    time: np.ndarray  # [s]
    slip: np.ndarray  # mean of the feet [m]
    margin: np.ndarray  # least stability margin [m]
    fell: np.ndarray


class Seen(NamedTuple):
    """What the steps of a stretch come to, by lane."""

    energy: Power  # of all joints [J]
    slip: np.ndarray  # mean of the feet [m]
    margin: np.ndarray  # least stability margin [m]


def measured(robot: Robot, states: np.ndarray, sensors: np.ndarray, control: np.ndarray) -> Seen:
    """Meters of steps under a control (lane, step, 12); states and sensors (lane, step + 1, ...) from before the first on.

    Torque is the one that the implicit step applied, speed that of mid-step. Between two steps a foot slips that is loaded in
    both and stands that is loaded in either: at the edges of the height field's cells a contact is lost for single steps.
    """
    speed, torque = states[..., 26:38], applied(robot, control, states)
    feet, load, com = sensors[..., :12].reshape(*sensors.shape[:2], 4, 3), sensors[..., 12:16], sensors[..., 16:18]
    loaded = load > float(least_load(robot))
    way = np.linalg.norm(np.diff(feet, axis=1), axis=-1)
    slip = np.where(loaded[:, 1:] & loaded[:, :-1], way, 0.0)
    stands = loaded[:, 1:] | loaded[:, :-1]
    rows = torque, 0.5 * (speed[:, :-1] + speed[:, 1:]), com[:, 1:], feet[:, 1:, :, :2], stands
    *power, margin = _by_step(robot, *rows)
    energy = Power(*(x.sum(axis=1) * STEP for x in power))
    looked = np.round(states[:, :-1, 0] / STEP) % LOOK == 0
    return Seen(energy, slip.sum(axis=1).mean(axis=-1), np.min(margin, axis=1, initial=np.inf, where=looked))


def applied(robot: Robot, control: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Torques [N m] that the implicit steps applied under a control (lane, step, 12), states from before the first on."""
    kp, kd, limit = (np.asarray(x, float).reshape(12) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit))
    return np.clip(control - kp * states[:, :-1, 8:20] - kd * states[:, 1:, 26:38], -limit, limit)


def _by_step(robot: Robot, *rows: np.ndarray) -> list[np.ndarray]:
    """Power of all joints [W] and margin [m] of every lane's steps: padded, so that few lengths are compiled."""
    lanes, steps = rows[0].shape[:2]
    count = 1 << max(lanes * steps - 1, 0).bit_length()
    flat = [np.zeros((count, *x.shape[2:]), x.dtype) for x in rows]
    for padded, x in zip(flat, rows):
        padded[: lanes * steps] = x.reshape(lanes * steps, *x.shape[2:])
    return [np.asarray(x, float)[: lanes * steps].reshape(lanes, steps) for x in _figures(robot, *flat)]


@jax.jit
def _figures(robot, torque, speed, com, feet, loaded):
    dtype = robot.torque_constant.dtype
    power = motor_power(robot, torque.astype(dtype), speed.astype(dtype))
    return *(x.sum(axis=1) for x in power), jax.vmap(stability_margin)(com, feet, loaded)


class Stand(NamedTuple):
    """What the falls of lanes are judged by."""

    height: np.ndarray  # of the trunk over the feet at the start (lane,) [m]
    unseen: dict[int, Surface]  # of the lanes whose terrain nobody has seen all of


def stand_of(terrains: list[HeightMap], references: list[Reference]) -> Stand:
    """From the walks' terrains and references."""
    first = [(np.asarray(x.trunk_pos, float)[0, 2], np.asarray(x.foot_pos, float)[0, :, 2].mean()) for x in references]
    height = np.nan_to_num([trunk - feet for trunk, feet in first], posinf=0.0, neginf=0.0)
    unseen = [i for i, terrain in enumerate(terrains) if np.isnan(terrain.elevation).any()]
    return Stand(height, {i: surface_of(terrains[i]) for i in unseen})


def down(stand: Stand, states: np.ndarray, sensors: np.ndarray) -> np.ndarray:
    """Whether a lane fell over or sank in any of its steps, or a foot came over ground that nobody has seen."""
    q, feet = states[..., 1:20], sensors[..., :12].reshape(*sensors.shape[:2], 4, 3)
    upright = 1.0 - 2.0 * (q[..., 4] ** 2 + q[..., 5] ** 2)
    fell = overturned(upright, q[..., 2] - feet[..., 2].mean(axis=-1), stand.height[:, None]).any(axis=1)
    lost = [i in stand.unseen and over_unseen(stand.unseen[i], feet[i]).any() for i in range(len(feet))]
    return fell | np.array(lost, bool)


def grounded(sensors: np.ndarray) -> np.ndarray:
    """Whether a lane's trunk met the ground in any of its steps."""
    return np.asarray(sensors[..., TRUNK_CONTACT].any(axis=1))


def broken(before: np.ndarray, states: np.ndarray, sensors: np.ndarray, control: np.ndarray) -> np.ndarray:
    """Whether a lane cannot be computed, its control included; `before` (lane,) as in `unstable`."""
    finite = np.isfinite(sensors).all(axis=(1, 2)) & np.isfinite(control).all(axis=(1, 2))
    return np.asarray(unstable(before, states) | ~finite)


def unstable(before: np.ndarray, states: np.ndarray) -> np.ndarray | np.bool_:
    """Whether MuJoCo warned, or found no finite state, in steps (..., step, state) from the time `before` (...) [s]: after a
    warning `rollout` repeats the last state, so that time stands still."""
    time = np.concatenate([before[..., None], states[..., 0]], axis=-1)
    stopped = ~(np.abs(np.diff(time) - STEP) < 0.01 * STEP).all(axis=-1)
    return stopped | ~(np.abs(states) < mujoco.mjMAXVAL).all(axis=(-2, -1))
