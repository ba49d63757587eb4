"""The referee of walks with feedback: C MuJoCo's contacts, integrator and height field under any controller of `control`.

As in `referee` nothing of the batched simulation takes part but the robot's numbers and the controller. All lanes go on in
lockstep: a tick is one compiled call of the batched controller and two of MuJoCo's steps.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import rollout

from jaxleg.control.contract import Controller, Reading, State
from jaxleg.control.course import course
from jaxleg.leg.dynamics import all_leg_frames
from jaxleg.leg.energy import Power
from jaxleg.leg.kinematics import foot_jacobian
from jaxleg.numerics import matmul, select
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.model import STEP, build_model
from jaxleg.sim.referee import SETTLE, no_log, replay, start_state
from jaxleg.sim.verdict import Seen, Stand, Verdict, applied, broken, down, grounded, measured, stand_of
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference

STEPS = 2  # simulation steps a tick
PERIOD = STEPS * STEP  # of a tick [s]: what a controller's `dt` must be


class Watched(NamedTuple):
    """The verdict on walks with feedback, and how they went; leading axis lane."""

    verdict: Verdict
    over: np.ndarray  # the controller came to its end
    trunk: np.ndarray  # position at the end (lane, 3) [m]
    shots: np.ndarray  # configuration at the start of every frame (lane, frame, 19)


def follow_all(
    robot: Robot, terrains: list[HeightMap], references: list[Reference], friction: float, frame: float = 1.0
) -> Watched:
    """`lockstep` of plans under `control.course`, each followed to its last sample."""
    if not references:
        return Watched(replay(robot, [], [], friction), np.zeros(0, bool), np.zeros((0, 3)), np.zeros((0, 0, 19)))
    references = [_thinned(track) for track in references]
    last = np.array([len(track.time) - 1 for track in references], np.int32)
    whole = [jax.tree.map(lambda x: _held(np.asarray(x), int(last.max()) + 1), track) for track in references]
    tracks = jax.tree.map(lambda *x: np.stack(x), *whole)
    controllers = jax.vmap(course, in_axes=(0, 0, None))(tracks, last, jnp.asarray(PERIOD, tracks.time.dtype))
    ends = np.array([float(track.time[-1]) for track in references])
    seen = lockstep(robot, terrains, controllers, references, friction, int(np.ceil(ends.max() / PERIOD)) + 2, frame)
    verdict = seen.verdict._replace(time=np.minimum(seen.verdict.time, ends))  # its last tick goes on beyond it
    return seen._replace(verdict=verdict)


def _thinned(track: Reference) -> Reference:
    """A plan without the samples that ticks would have to skip: a course goes on by one sample a tick at most."""
    time, kept = np.asarray(track.time), [0]
    for sample in range(1, len(time) - 1):
        if time[sample] - time[kept[-1]] > 0.999 * PERIOD:
            kept.append(sample)
    return jax.tree.map(lambda x: np.asarray(x)[[*kept, len(time) - 1]], track)


def _held(rows: np.ndarray, count: int) -> np.ndarray:
    """So many rows, the last one again and again."""
    return np.concatenate([rows, np.repeat(rows[-1:], count - len(rows), axis=0)])


def lockstep(
    robot: Robot,
    terrains: list[HeightMap],
    controllers: Controller[Any, None],
    starts: list[Reference],
    friction: float,
    ticks: int,
    frame: float = 1.0,
) -> Watched:
    """Walk with controllers (leading axis lane; their `dt` is `PERIOD`), each on its own terrain from its reference's first
    sample, until all are over or have fallen, for at most so many ticks; on two threads.

    Fall: as `referee`; a fallen lane is measured no further. A frame every `frame` [s]. Raises ValueError for another `dt`.
    """
    models = [build_model(robot, terrain, friction) for terrain in terrains]
    start = np.nan_to_num(np.stack([start_state(model, track) for model, track in zip(models, starts)]))
    meter = _Meter(robot, stand_of(terrains, starts), start)
    memory = first = jax.vmap(lambda controller: controller.start())(controllers)
    state, feet = start, np.stack([np.asarray(track.foot_pos)[0] for track in starts])
    torque, over = np.zeros((len(start), 4, 3)), np.zeros(len(start), bool)
    shots, every, settle = [], max(round(frame / PERIOD), 1), round(SETTLE / PERIOD)
    with no_log(), np.errstate(over="ignore", invalid="ignore"), rollout.Rollout(nthread=2) as runner:
        workers = [mujoco.MjData(models[0]) for _ in range(2)]
        for tick in range(-settle, ticks):
            if tick >= 0 and tick % every == 0:
                shots.append(state[:, 1:20].copy())
            walks = tick >= 0
            seen = state[:, 1:20], state[:, 20:38], feet, torque
            wanted, memory, over, dt = _think(robot, controllers, memory, seen, tick > 0, walks)
            if tick == -settle and not np.allclose(dt, PERIOD, rtol=1e-5):
                raise ValueError(f"controllers.dt is {np.ravel(dt)[0]:g} s, but must be PERIOD = {PERIOD:g} s")
            wanted, over = np.repeat(np.asarray(wanted)[:, None], STEPS, axis=1), np.asarray(over)
            if walks and (over | meter.fell).all():
                break
            states, sensors = runner.rollout(models, workers, state, np.nan_to_num(wanted))
            meter.add(state, states, sensors, wanted, walks & ~over)
            torque = np.mean(applied(robot, wanted, np.concatenate([state[:, None], states], axis=1)), axis=1)
            torque, state, feet = torque.reshape(-1, 4, 3), states[:, -1], sensors[:, -1, :12].reshape(-1, 4, 3)
            if meter.broken.any():  # such a lane stands where it began, unmeasured
                state, feet, torque = (_put(meter.broken, *x) for x in ((state, start), (feet, 0.0), (torque, 0.0)))
                memory = jax.tree.map(functools.partial(_put, meter.broken), memory, first)
    shots = np.stack(shots, axis=1) if shots else start[:, None, 1:20]
    return meter.watched(over, shots)


def _put(lanes: np.ndarray, values: Any, others: Any) -> np.ndarray:
    """The values, in some lanes the others."""
    values = np.asarray(values)
    return np.where(lanes.reshape(-1, *[1] * (values.ndim - 1)), others, values)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0, 0, 0, None, None))
def _think(robot: Robot, controller: Controller[Any, None], memory: Any, seen, walked, walks):
    """One lane's motor control kp angles + kd velocity + torque, as the actuators of `build_model` take it, the memory that
    goes with it, whether the walk is over, and the tick [s]. While it does not walk it holds its first pose."""
    q, v, feet, torque = (x.astype(robot.torque_constant.dtype) for x in seen)
    memory = select(walked, controller.felt(memory, torque, State(q, v)), memory)
    jacobian = jax.vmap(foot_jacobian)(all_leg_frames(robot, q[7:].reshape(4, 3)))
    sensed = Reading(State(q, v), feet, matmul(rotation_from_quaternion(q[3:7]), jacobian))
    over = controller.over(memory)
    now, after = controller.command(memory, sensed, None)
    velocity = jnp.where(walks, now.velocity, 0.0)
    action = robot.stiffness * now.position + robot.velocity_gain * velocity + now.torque
    return action.reshape(-1), select(walks, after, memory), over, now.dt


class _Meter:
    """Sums up what the lanes do, period by period."""

    def __init__(self, robot: Robot, stand: Stand, start: np.ndarray) -> None:
        lanes = len(start)
        self.robot, self.stand, self.sensors = robot, stand, None
        self.seen = Seen(Power(*np.zeros((3, lanes))), np.zeros(lanes), np.full(lanes, np.inf))
        self.fell, self.broken, self.ticks = np.zeros(lanes, bool), np.zeros(lanes, bool), np.zeros(lanes, int)
        self.trunk = self.began = start[:, 1:4]

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

    def watched(self, over: np.ndarray, shots: np.ndarray) -> Watched:
        """The result of lanes, those that came to their end marked."""
        seen, moved = self.seen, self.trunk - self.began
        verdict = Verdict(seen.energy, moved, PERIOD * self.ticks, seen.slip, seen.margin, self.fell)
        return Watched(verdict, over & ~self.fell, self.trunk, shots)
