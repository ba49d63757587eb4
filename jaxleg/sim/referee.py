"""The referee: C MuJoCo replays the same reference on its own height field with its own contacts and integrator.

Nothing of the batched simulation takes part: contacts are MuJoCo's (elliptic cones, Newton solver), the ground a height field
of twice the map's resolution, the step a uniform 2 ms with `implicitfast`. Only the robot's numbers and the joint reference
are shared.
"""

import contextlib
from collections.abc import Generator
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import rollout

from jaxleg.robot import Robot
from jaxleg.sim.model import STEP, build_model
from jaxleg.sim.verdict import broken, down, grounded, measured, stand_of
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference

SETTLE = 0.3  # the first pose is held this long before the walk [s]


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

    A lane falls as `fall` says, its trunk's contacts being MuJoCo's; and if a foot comes over unseen ground, if MuJoCo finds
    it unstable, warned or not finite, or if the reference is not finite.
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
    """The verdict on one walk, from the states after each step, the sensors seen in it and its control."""
    first = round((SETTLE + _clock(reference)[metered_from]) / STEP)
    states, sensors, control, began = states[None], sensors[None], control[None], np.zeros(1)
    seen = measured(robot, states[:, first - 1 :], sensors[:, first - 1 :], control[:, first:])
    fell = down(stand_of([terrain], [reference]), states, sensors) | grounded(sensors)
    return Verdict(
        **{name: float(value[0]) for name, value in seen.energy._asdict().items()},
        moved=states[0, -1, 1:3] - states[0, first - 1, 1:3],
        time=float((control.shape[1] - first) * STEP),
        slip=float(seen.slip[0]),
        margin=float(seen.margin[0]),
        fell=bool((fell | broken(began, states, sensors, control))[0]),
    )
