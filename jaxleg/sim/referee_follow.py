"""The referee follows a long plan: C MuJoCo's contacts, integrator and height field, the feedback law of `follow`.

As in `referee` nothing of the batched simulation takes part but the robot's numbers, the plan and the joint controllers.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import rollout

from jaxleg.dynamics import all_leg_frames
from jaxleg.gait import stability_margin
from jaxleg.kinematics import foot_jacobian, rotation_from_quaternion
from jaxleg.numerics import matmul
from jaxleg.plan import Reference
from jaxleg.robot import Robot
from jaxleg.sim.follow import Posture, command, held_feet
from jaxleg.sim.referee import LOADED, SETTLE, STEP, build_model, start_state
from jaxleg.terrain.heightmap import HeightMap

STEPS = 2  # simulation steps a control period


class Judged(NamedTuple):
    """What the referee measured, leading axis lane; SI units."""

    mechanical: np.ndarray  # [J]
    mechanical_positive: np.ndarray
    joule: np.ndarray
    time: np.ndarray  # [s]
    slip: np.ndarray  # mean of the feet [m]
    margin: np.ndarray  # least stability margin [m]
    fell: np.ndarray
    trunk: np.ndarray  # position at the end (lane, 3)
    shots: np.ndarray  # configuration at the start of every frame (lane, frame, 19)


def follow_all(
    robot: Robot, terrains: list[HeightMap], references: list[Reference], friction: float, frame: float = 1.0
) -> Judged:
    """Follow plans, each on its own terrain, on two threads; a plan ends with its reference's last sample.

    Fall: as `referee`. A frame every `frame` [s].
    """
    models = [build_model(robot, terrain, friction) for terrain in terrains]
    tracks = [jax.tree.map(lambda x: np.asarray(x, np.float64), r) for r in references]
    state = np.stack([start_state(model, track) for model, track in zip(models, tracks)])
    ends = np.array([track.time[-1] for track in tracks])
    meter = _Meter(robot, len(tracks), np.array([t.trunk_pos[0, 2] - t.foot_pos[0, :, 2].mean() for t in tracks]))
    held = feet = np.stack([track.foot_pos[0] for track in tracks])
    period, shots = STEPS * STEP, []
    with rollout.Rollout(nthread=2) as runner:
        workers = [mujoco.MjData(models[0]) for _ in range(2)]
        for time in np.arange(-SETTLE, ends.max(), period):
            if time >= len(shots) * frame:
                shots.append(state[:, 1:20].copy())
            rows = [_samples(track, max(time, 0.0)) for track in tracks]
            low, high = (jax.tree.map(lambda *x: np.stack(x), *side) for side in zip(*rows))
            now = (max(time, 0.0), period * (time >= 0.0))
            control, held = (np.asarray(x) for x in _control(robot, low, high, *now, state[:, 1:20], held, feet))
            steady = np.repeat(control[:, None], STEPS, axis=1)
            states, sensors = runner.rollout(models, workers, np.nan_to_num(state), steady)
            meter.add(state, states, sensors, control, (time >= 0.0) & (time < ends))
            state, feet = states[:, -1], sensors[:, -1, :12].reshape(-1, 4, 3)
    return meter.judged(ends, np.stack(shots, axis=1))


def _samples(track: Reference, time: float) -> tuple[Reference, Reference]:
    """The samples before and after a time [s]."""
    index = int(np.clip(np.searchsorted(track.time, time, side="right") - 1, 0, len(track.time) - 2))
    low, high = (Reference(*(x[index + k] for x in track)) for k in (0, 1))
    return low, high


@jax.jit
def _control(robot: Robot, low: Reference, high: Reference, time, period, q, held, feet):
    """Control of each lane, kp (corrected angles) + kd velocity + torque as the actuators of `build_model` take it, and where
    its feet are held."""

    def lane(low, high, q, held, feet):
        held = held_feet(held, feet, low.contact, period)
        angles = q[7:].reshape(4, 3)
        jacobian = jax.vmap(foot_jacobian)(all_leg_frames(robot, angles))
        now = Posture(q[:3], q[3:7], held, matmul(rotation_from_quaternion(q[3:7]), jacobian))
        wanted = command(low, high, time, period, now)
        velocity = jnp.where(period > 0.0, wanted.velocity, 0.0)
        control = robot.stiffness * wanted.position + robot.velocity_gain * velocity + wanted.torque
        return control.reshape(-1), held

    return jax.vmap(lane)(low, high, q, held, feet)


class _Meter:
    """Sums up what the lanes do, period by period."""

    def __init__(self, robot: Robot, lanes: int, stand: np.ndarray) -> None:
        self.gains = [np.asarray(x, float).reshape(12) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit)]
        self.amperes = 1.0 / float(robot.torque_constant * robot.gear_ratio)
        self.resistance, self.stand = float(robot.resistance), stand
        self.sums = {name: np.zeros(lanes) for name in ("mechanical", "mechanical_positive", "joule", "slip")}
        self.margin, self.fell, self.trunk = np.full(lanes, np.inf), np.zeros(lanes, bool), np.zeros((lanes, 3))
        self.feet = np.full((lanes, 4, 3), np.nan)

    def add(self, before, states, sensors, control, counts) -> None:
        """One period of all lanes: states (lane, step, ...) after each of its steps."""
        kp, kd, limit = self.gains
        chain = np.concatenate([before[:, None], states], axis=1)
        q, v = chain[:, :, 1:20], chain[:, :, 20:38]
        torque = np.clip(control[:, None] - kp * q[:, :-1, 7:] - kd * v[:, 1:, 6:], -limit, limit)
        power = torque * 0.5 * (v[:, :-1, 6:] + v[:, 1:, 6:])
        heat = (torque * self.amperes) ** 2 * self.resistance
        for name, value in (("mechanical", power), ("mechanical_positive", np.maximum(power, 0.0)), ("joule", heat)):
            self.sums[name] += np.where(counts, value.sum(axis=(1, 2)) * STEP, 0.0)
        self._feet(sensors[:, -1], counts)
        upright = 1.0 - 2.0 * (q[:, -1, 4] ** 2 + q[:, -1, 5] ** 2)
        low = q[:, -1, 2] - self.feet[..., 2].mean(axis=1) < 0.5 * self.stand
        self.fell |= counts & ((upright < np.sqrt(0.5)) | low | ~np.isfinite(states).all(axis=(1, 2)))
        self.trunk = np.where(counts[:, None], q[:, -1, :3], self.trunk)

    def _feet(self, sensors, counts) -> None:
        feet, load, com = sensors[:, :12].reshape(-1, 4, 3), sensors[:, 12:16], sensors[:, 16:19]
        moved = np.nan_to_num(np.linalg.norm(feet - self.feet, axis=-1)) * (load > LOADED)
        self.sums["slip"] += np.where(counts, moved.mean(axis=1), 0.0)
        margin = np.asarray(_margins(com[:, :2], feet[..., :2], load > 1.0))
        self.margin = np.where(counts, np.minimum(self.margin, margin), self.margin)
        self.feet = feet

    def judged(self, time: np.ndarray, shots: np.ndarray) -> Judged:
        """The result; `time` of each lane [s]."""
        return Judged(**self.sums, time=time, margin=self.margin, fell=self.fell, trunk=self.trunk, shots=shots)


@jax.jit
def _margins(com, feet, loaded):
    return jax.vmap(stability_margin)(com, feet, loaded)
