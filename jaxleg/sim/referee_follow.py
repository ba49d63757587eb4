"""The referee follows a long plan: C MuJoCo's contacts, integrator and height field, the feedback law of `control.course`.

As in `referee` nothing of the batched simulation takes part but the robot's numbers, the plan and the joint controllers.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import rollout

from jaxleg.control.course import Posture, between, command, held_feet
from jaxleg.leg.dynamics import all_leg_frames
from jaxleg.leg.energy import Power
from jaxleg.leg.kinematics import foot_jacobian
from jaxleg.numerics import matmul
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.model import STEP, build_model
from jaxleg.sim.referee import SETTLE, no_log, start_state
from jaxleg.sim.verdict import Seen, Stand, broken, down, grounded, measured, stand_of
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference

STEPS = 2  # simulation steps a control period


class Judged(NamedTuple):
    """What the referee measured, leading axis lane; SI units."""

    mechanical: np.ndarray  # [J]
    mechanical_positive: np.ndarray
    joule: np.ndarray
    time: np.ndarray  # [s]
    slip: np.ndarray  # mean of the feet [m]
    margin: np.ndarray  # least stability margin [m]
    fell: np.ndarray  # otherwise it walked to the plan's end
    trunk: np.ndarray  # position at the end (lane, 3)
    shots: np.ndarray  # configuration at the start of every frame (lane, frame, 19)


def follow_all(
    robot: Robot, terrains: list[HeightMap], references: list[Reference], friction: float, frame: float = 1.0
) -> Judged:
    """Follow plans, each on its own terrain, on two threads; a plan ends with its reference's last sample.

    Fall: as `referee`; a fallen lane is measured no further. A frame every `frame` [s].
    """
    if not references:
        none = np.zeros(0)
        return Judged(*[none] * 6, fell=none.astype(bool), trunk=np.zeros((0, 3)), shots=np.zeros((0, 0, 19)))
    models = [build_model(robot, terrain, friction) for terrain in terrains]
    tracks = [jax.tree.map(np.asarray, reference) for reference in references]
    start = np.nan_to_num(np.stack([start_state(model, track) for model, track in zip(models, tracks)]))
    ends, period = np.array([float(track.time[-1]) for track in tracks]), STEPS * STEP
    settle, walk = round(SETTLE / period), int(np.ceil(ends.max() / period))
    rows = _rows(tracks, period * np.arange(walk + 2))
    meter = _Meter(robot, stand_of(terrains, tracks), start)
    control, held = _controller(robot, period), np.stack([track.foot_pos[0] for track in tracks])
    state, feet, shots, every = start, held, [], max(round(frame / period), 1)
    with no_log(), np.errstate(over="ignore", invalid="ignore"), rollout.Rollout(nthread=2) as runner:
        workers = [mujoco.MjData(models[0]) for _ in range(2)]
        for tick in range(-settle, walk):
            if tick >= 0 and tick % every == 0:
                shots.append(state[:, 1:20].copy())
            now, later = (_at(rows, max(tick, 0) + k) for k in (0, 1))
            wanted, held = (np.asarray(x) for x in control(now, now if tick < 0 else later, state[:, 1:20], held, feet))
            wanted = np.repeat(wanted[:, None], STEPS, axis=1)
            states, sensors = runner.rollout(models, workers, state, np.nan_to_num(wanted))
            meter.add(state, states, sensors, wanted, (tick >= 0) & (period * tick < ends))
            state, feet = states[:, -1], sensors[:, -1, :12].reshape(-1, 4, 3)
            if meter.broken.any():  # such a lane stands where it began, unmeasured
                state = np.where(meter.broken[:, None], start, state)
                held, feet = np.nan_to_num(held), np.nan_to_num(feet)
    shots = np.stack(shots, axis=1) if shots else start[:, None, 1:20]
    return meter.judged(np.minimum(meter.ticks * period, ends), shots)


def _rows(tracks: list[Reference], times: np.ndarray) -> Reference:
    """The references at times [s], leading axes lane and time; each stands after its end."""

    def lane(track: Reference) -> Reference:
        index = np.clip(np.searchsorted(track.time, times, side="right") - 1, 0, len(track.time) - 2)
        low, high = (Reference(*(x[index + k] for x in track)) for k in (0, 1))
        rows = _between(low, high, times.astype(track.time.dtype))
        ended = (times >= track.time[-1])[:, None, None]
        return rows._replace(joint_vel=np.where(ended, 0.0, rows.joint_vel))

    return jax.tree.map(lambda *x: np.stack([np.asarray(y) for y in x]), *map(lane, tracks))


@jax.jit
def _between(low, high, times):
    return jax.vmap(between)(low, high, times)


def _at(rows: Reference, index: int) -> Reference:
    return jax.tree.map(lambda x: x[:, index], rows)


def _controller(robot: Robot, period: float):
    """The function from two rows a control period apart (the same row: hold it), q, held and actual feet, all by lane, to the
    control kp (corrected angles) + kd velocity + torque, as the actuators of `build_model` take it, and the held feet."""

    @jax.jit
    @jax.vmap
    def control(now: Reference, later: Reference, q, held, feet):
        """The motors' control at a tick, from all lanes' states."""
        dt = jnp.asarray(period, q.dtype)
        held = held_feet(held, feet, now.contact, dt)
        jacobian = jax.vmap(foot_jacobian)(all_leg_frames(robot, q[7:].reshape(4, 3)))
        posture = Posture(q[:3], q[3:7], held, matmul(rotation_from_quaternion(q[3:7]), jacobian))
        wanted = command(now, later, now.time, later.time - now.time, posture)
        velocity = jnp.where(later.time > now.time, wanted.velocity, 0.0)
        action = robot.stiffness * wanted.position + robot.velocity_gain * velocity + wanted.torque
        return action.reshape(-1), held

    return control


class _Meter:
    """Sums up what the lanes do, period by period."""

    def __init__(self, robot: Robot, stand: Stand, start: np.ndarray) -> None:
        lanes = len(start)
        self.robot, self.stand, self.sensors = robot, stand, None
        self.seen = Seen(Power(*np.zeros((3, lanes))), np.zeros(lanes), np.full(lanes, np.inf))
        self.fell, self.broken, self.ticks = np.zeros(lanes, bool), np.zeros(lanes, bool), np.zeros(lanes, int)
        self.trunk = start[:, 1:4]

    def add(self, before, states, sensors, control, counts) -> None:
        """One period of all lanes: states (lane, step, ...) after each of its steps, control as many."""
        self.broken |= broken(before[:, 0], states, sensors, control)
        self.fell |= self.broken | grounded(sensors) | (counts & down(self.stand, states, sensors))
        counts = counts & ~self.fell
        earlier = sensors[:, :1] if self.sensors is None else self.sensors
        chain, felt = (np.concatenate(x, axis=1) for x in ((before[:, None], states), (earlier, sensors)))
        self._count(measured(self.robot, chain, felt, control), counts)
        self.ticks += counts
        self.trunk = np.where(counts[:, None], states[:, -1, 1:4], self.trunk)
        self.sensors = sensors[:, -1:]

    def _count(self, more: Seen, counts) -> None:
        energy = Power(*(x + np.where(counts, y, 0.0) for x, y in zip(self.seen.energy, more.energy)))
        margin = np.where(counts, np.minimum(self.seen.margin, more.margin), self.seen.margin)
        self.seen = Seen(energy, self.seen.slip + np.where(counts, more.slip, 0.0), margin)

    def judged(self, time: np.ndarray, shots: np.ndarray) -> Judged:
        """The result; `time` of each lane [s]."""
        slip, margin = self.seen.slip, self.seen.margin
        rest = dict(time=time, slip=slip, margin=margin, fell=self.fell, trunk=self.trunk, shots=shots)
        return Judged(**self.seen.energy._asdict(), **rest)
