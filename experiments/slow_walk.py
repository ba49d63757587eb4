"""What the experiments with Pegasus's own speed share: 0.012 m/s, "net" power, finer steps, and a gait of ours for it."""

import dataclasses
import functools
from typing import NamedTuple

import jax
import numpy as np

from experiments.searching import best_vector, judged_lanes
from jaxleg.batch import over_lanes
from jaxleg.leg.energy import Convention, electrical, motor_power
from jaxleg.robot import Robot
from jaxleg.search.config import Study
from jaxleg.search.lanes import Lab, Setting
from jaxleg.search.training import Lanes, spread
from jaxleg.sim.meters import Meters, Record
from jaxleg.sim.rollout import record
from jaxleg.walk.reference import reference
from jaxleg.walk.standing import stand_first

SPEED = 0.012  # [m/s]: what COT = P / (m g v) of the paper's 7.68 makes of its power (A14)
STEPS = 16  # a sample: the gait cycle takes 16.7 s, a step of the simulation at most 4 ms
STAND, STAND_SAMPLES = 35.0, 600  # waiting for the map on stairs (Fig. 10b) [s]
STAND_SHARE = 35.0 / 265.0  # of the run on stairs: 22516 samples (851110 / 37.8), at the flat run's 85 samples a second


class Trace(NamedTuple):
    """One recorded walk."""

    meters: Meters
    record: Record
    placed: jax.Array  # nominal footholds and offsets (stance, leg, 2) [m], where the feet were planned
    status: jax.Array  # (stance, leg)


def slow(study: Study, lab: Lab, terrains: int) -> tuple[Study, Lab]:
    """Study and lab at the paper's speed under "net" power, with so many training terrains over all kinds."""
    maps = dataclasses.replace(study.terrains, train=terrains)
    study = dataclasses.replace(study, speed=SPEED, power="net", terrains=maps)
    return study, dataclasses.replace(lab, convention="net", steps=STEPS)


def walks(lab: Lab, vectors: np.ndarray, lanes: Lanes, cycles: int = 2, stand: float = 0.0) -> Trace:
    """Record walks (leading axis) of so many cycles after a stand [s] in simulation."""
    lab.engine  # noqa: B018  built outside of any tracing
    lane = functools.partial(_walk, lab, cycles, stand)
    return over_lanes(lane, min(lab.chunk, -(-len(vectors) // jax.local_device_count())))(
        np.asarray(vectors, np.float32), lanes.site, lanes.setting
    )


def _walk(lab: Lab, cycles: int, stand: float, vector, site, setting: Setting) -> Trace:
    walk = lab.walk(vector, site, lab.choose(vector, site, setting, cycles), setting)
    track = reference(lab.robot, walk, lab.samples)
    track = stand_first(track, stand, STAND_SAMPLES) if stand else track
    meters, kept = record(lab.engine, lab.robot, lab.ground, site.terrain, track, lab.steps)
    return Trace(meters, kept, walk.footholds[..., :2], walk.found)


def power_over_time(robot: Robot, kept: Record, convention: Convention) -> np.ndarray:
    """Electrical power of all motors at each recorded step [W]; leading axes are kept."""
    return np.asarray(electrical(motor_power(robot, kept.torque, kept.speed), convention)).sum(axis=(-2, -1))


def currents(robot: Robot, kept: Record) -> np.ndarray:
    """Absolute motor currents (..., t, leg, joint) [A]."""
    return np.abs(np.asarray(kept.torque)) / float(robot.torque_constant * robot.gear_ratio)


def mean_over_time(values: np.ndarray, time: np.ndarray, begin: float = 0.0, end: float = np.inf) -> np.ndarray:
    """Mean over part of the time of values (..., t) held over each step."""
    dt = np.diff(time, prepend=0.0) * ((time > begin) & (time <= end))
    return np.sum(values * dt, axis=-1) / np.sum(dt)


def search_gait(study: Study, lab: Lab, kind: str, quick: bool) -> np.ndarray:
    """Our parameters for a kind of terrain: descents on the proxy within the study's bounds, margin at least traditional's."""
    lanes = judged_lanes(study, lab, kind)
    return best_vector(study, lab, kind, spread(lanes, 4) if quick else lanes)
