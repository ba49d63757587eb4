"""The referee: C MuJoCo replays the same reference on its own height field with its own contacts and integrator.

Nothing of the batched simulation takes part: contacts are MuJoCo's (elliptic cones, Newton solver), the ground a height field
of twice the map's resolution, the step a uniform 2 ms with `implicitfast`. Only the robot's numbers and the joint reference
are shared.
"""

import contextlib
from collections.abc import Generator
from typing import NamedTuple

import jax
import mujoco
import numpy as np
from mujoco import rollout

from jaxleg.gait.support import stability_margin
from jaxleg.robot import Robot
from jaxleg.sim.model import STEP, TRUNK_CONTACT, build_model, over_unseen, surface_of
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference

SETTLE = 0.3  # the first pose is held this long before the walk [s]
LOADED = 5.0  # a foot slips only while it carries more than this [N]


class Verdict(NamedTuple):
    """What the referee measured over the metered part of one walk; numbers in SI units."""

    mechanical: float  # [J]
    mechanical_positive: float
    joule: float
    moved: np.ndarray  # how far the trunk has come (x, y) [m]
    time: float
    slip: float  # mean of the feet [m]
    margin: float  # least stability margin [m]
    fell: bool


def replay(
    robot: Robot, terrains: list[HeightMap], references: list[Reference], friction: float, metered_from: int = 0
) -> list[Verdict]:
    """Replay walks, each on its own terrain, on two threads. `metered_from` is the first metered sample of the references.

    A lane falls if it is tilted by more than 45 degrees, its trunk sinks below half its height or meets the ground, a foot
    comes over unseen ground, or MuJoCo finds it unstable, warned or not finite; also where the reference is not finite.
    """
    if not references:
        return []
    models = [build_model(robot, terrain, friction) for terrain in terrains]
    tracks = [controls(robot, reference) for reference in references]
    steps = max(len(track) for track in tracks)
    control = np.stack([np.concatenate([t, np.repeat(t[-1:], steps - len(t), axis=0)]) for t in tracks])
    start = np.stack([start_state(model, reference) for model, reference in zip(models, references)])
    workers = [mujoco.MjData(models[0]) for _ in range(2)]
    start, control = (np.nan_to_num(x, posinf=0.0, neginf=0.0) for x in (start, control))
    with no_log(), np.errstate(over="ignore", invalid="ignore"):
        states, sensors = rollout.rollout(models, workers, start, control, skip_checks=False)
        return [
            _verdict(robot, terrains[i], reference, states[i, : len(track)], sensors[i, : len(track)], track, metered_from)
            for i, (reference, track) in enumerate(zip(references, tracks))
        ]


@contextlib.contextmanager
def no_log() -> Generator[None]:
    """MuJoCo without its warnings on the console and in a MUJOCO_LOG.TXT of the working folder: a fall says it."""
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_file = silent.logto_console = False
    silent.set()
    try:
        yield
    finally:
        before.set()


def unstable(before: np.ndarray, states: np.ndarray) -> np.ndarray | np.bool_:
    """Whether MuJoCo warned, or found no finite state, in steps (..., step, state) from the time `before` (...) [s]: after a
    warning `rollout` repeats the last state, so that time stands still."""
    time = np.concatenate([before[..., None], states[..., 0]], axis=-1)
    stopped = ~(np.abs(np.diff(time) - STEP) < 0.01 * STEP).all(axis=-1)
    return stopped | ~(np.abs(states) < mujoco.mjMAXVAL).all(axis=(-2, -1))


def controls(robot: Robot, reference: Reference) -> np.ndarray:
    """Control of every step (step, 12): the reference held for `SETTLE`, then followed on a uniform time grid."""
    time = _clock(reference)
    at = np.clip(np.arange(int(np.ceil((SETTLE + time[-1]) / STEP))) * STEP - SETTLE, 0.0, None)
    flat = [
        np.asarray(x, float).reshape(len(time), 12) for x in (reference.joint_pos, reference.joint_vel, reference.joint_torque)
    ]
    position, velocity, torque = (np.stack([np.interp(at, time, x[:, j]) for j in range(12)], axis=1) for x in flat)
    velocity = velocity * (at > 0.0)[:, None]
    kp, kd = (np.asarray(x, float).reshape(12) for x in (robot.stiffness, robot.velocity_gain))
    return kp * position + kd * velocity + torque


def _clock(reference: Reference) -> np.ndarray:
    """Times of the samples [s] that never go back, whatever the plan says."""
    return np.maximum.accumulate(np.maximum(np.nan_to_num(np.asarray(reference.time, float), posinf=0.0, neginf=0.0), 0.0))


def start_state(model: mujoco.MjModel, reference: Reference) -> np.ndarray:
    """MuJoCo's full physics state of the reference's first pose at rest."""
    data = mujoco.MjData(model)
    data.qpos[:] = np.concatenate(
        [np.asarray(x, float)[0].reshape(-1) for x in (reference.trunk_pos, reference.trunk_quat, reference.joint_pos)]
    )
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def _verdict(robot, terrain, reference, states, sensors, control, metered_from) -> Verdict:
    """Meters from the trajectory: torques as the implicit step applied them, mid-step speeds."""
    q, v = states[:, 1:20], states[:, 20:38]  # after each step
    kp, kd, limit = (np.asarray(x, float).reshape(12) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit))
    first = round((SETTLE + _clock(reference)[metered_from]) / STEP)
    now, after = slice(first - 1, -1), slice(first, None)
    torque = np.clip(control[after] - kp * q[now, 7:] - kd * v[after, 6:], -limit, limit)
    power = torque * 0.5 * (v[now, 6:] + v[after, 6:])
    current = torque / float(robot.torque_constant * robot.gear_ratio)
    feet, load, com = sensors[:, :12].reshape(-1, 4, 3), sensors[:, 12:16], sensors[:, 16:19]
    moved = np.linalg.norm(np.diff(feet[first - 1 :], axis=0), axis=-1)
    held = (load[after] > LOADED) & (load[now] > LOADED)
    margin = _margins(com[after][::10, :2], feet[after][::10, :, :2], load[after][::10] > 1.0)
    return Verdict(
        mechanical=float(power.sum() * STEP),
        mechanical_positive=float(np.maximum(power, 0.0).sum() * STEP),
        joule=float((current**2).sum() * float(robot.resistance) * STEP),
        moved=q[-1, :2] - q[first - 1, :2],
        time=float(len(power) * STEP),
        slip=float((moved * held).sum(axis=0).mean()),
        margin=float(np.min(margin, initial=np.inf)),
        fell=_fell(terrain, states, sensors, feet) or not np.isfinite(control).all(),
    )


@jax.jit
def _margins(com, feet, loaded):
    return jax.vmap(stability_margin)(com, feet, loaded)


def _fell(terrain: HeightMap, states: np.ndarray, sensors: np.ndarray, feet: np.ndarray) -> bool:
    if unstable(np.zeros(()), states) or not np.isfinite(sensors).all() or sensors[:, TRUNK_CONTACT].any():
        return True
    q = states[:, 1:20]
    upright = 1.0 - 2.0 * (q[:, 4] ** 2 + q[:, 5] ** 2)
    stand = q[:, 2] - feet[..., 2].mean(axis=1)
    lost = np.isnan(terrain.elevation).any() and over_unseen(surface_of(terrain), feet).any()
    return bool((upright < np.sqrt(0.5)).any() or (stand < 0.5 * stand[0]).any() or lost)
