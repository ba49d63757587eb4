"""The referee: C MuJoCo replays the same reference on its own height field with its own contacts and integrator.

Nothing of the batched simulation takes part: contacts are MuJoCo's (elliptic cones, Newton solver), the ground a height field
of twice the map's resolution, the step a uniform 2 ms with `implicitfast`. Only the robot's numbers and the joint reference
are shared.
"""

import contextlib
from collections.abc import Generator

import jax
import mujoco
import numpy as np
from mujoco import rollout

from jaxleg.leg.energy import Power
from jaxleg.robot import Robot
from jaxleg.sim.model import STEP, build_model
from jaxleg.sim.verdict import Verdict, broken, down, grounded, measured, stand_of
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.between import at_share
from jaxleg.walk.data import Reference

SETTLE = 0.3  # the first pose is held this long before the walk [s]


def replay(
    robot: Robot, terrains: list[HeightMap], references: list[Reference], friction: float, metered_from: int = 0
) -> Verdict:
    """Replay walks of one robot, each on its own terrain: see `replay_each`."""
    count = len(references)
    return replay_each([robot] * count, terrains, references, [friction] * count, metered_from)


def replay_each(
    robots: list[Robot],
    terrains: list[HeightMap],
    references: list[Reference],
    frictions: list[float],
    metered_from: int = 0,
) -> Verdict:
    """Replay walks on two threads; a lane has a robot, a terrain and a friction of its own. `metered_from` is the first metered
    sample of the references.

    A lane falls as `fall` says, its trunk's contacts being MuJoCo's; and if a foot comes over unseen ground, if MuJoCo finds
    it unstable, warned or not finite, or if the reference is not finite.
    """
    if not references:
        none = np.zeros(0)
        return Verdict(Power(none, none, none), np.zeros((0, 3)), none, none, none, none.astype(bool))
    models = [build_model(*lane) for lane in zip(robots, terrains, frictions)]
    tracks = [controls(*lane) for lane in zip(robots, references)]
    steps = max(len(track) for track in tracks)
    control = np.stack([np.concatenate([t, np.repeat(t[-1:], steps - len(t), axis=0)]) for t in tracks])
    start = np.stack([start_state(model, reference) for model, reference in zip(models, references)])
    workers = [mujoco.MjData(models[0]) for _ in range(2)]
    start, control = (np.nan_to_num(x, posinf=0.0, neginf=0.0) for x in (start, control))
    with no_log(), np.errstate(over="ignore", invalid="ignore"):
        states, sensors = rollout.rollout(models, workers, start, control, skip_checks=False)
        alone = [
            _verdict(*lane, states[i, : len(track)], sensors[i, : len(track)], track, metered_from)
            for i, (*lane, track) in enumerate(zip(robots, terrains, references, tracks))
        ]
    return jax.tree.map(lambda *lanes: np.concatenate(lanes), *alone)


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
    index = np.clip(np.searchsorted(time, at, side="right") - 1, 0, max(len(time) - 2, 0))
    tracked = jax.tree.map(lambda x: np.asarray(x, float), reference)._replace(time=time)
    low, high = (jax.tree.map(lambda x, i=i: x[i], tracked) for i in (index, np.minimum(index + 1, len(time) - 1)))
    share = np.clip((at - low.time) / np.maximum(high.time - low.time, 1e-6), 0.0, 1.0)
    row = at_share(low, high, share)
    position, velocity, torque = (x.reshape(len(at), 12) for x in (row.joint_pos, row.joint_vel, row.joint_torque))
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
    """The verdict on one walk (lane axis of one), from the states after each step, the sensors seen in it and its control."""
    first = round((SETTLE + _clock(reference)[metered_from]) / STEP)
    states, sensors, control, began = states[None], sensors[None], control[None], np.zeros(1)
    seen = measured(robot, states[:, first - 1 :], sensors[:, first - 1 :], control[:, first:])
    fell = down(stand_of([terrain], [reference]), states, sensors) | grounded(sensors)
    fell = fell | broken(began, states, sensors, control)
    moved, time = states[:, -1, 1:4] - states[:, first - 1, 1:4], np.array([(control.shape[1] - first) * STEP])
    return Verdict(seen.energy, moved, time, seen.slip, seen.margin, fell)
