"""A small motion, a plane of ground, and MuJoCo's own numbers: what the tests of the simulation share."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxleg.control.contract import Tracking
from jaxleg.gait.order import SHIFT
from jaxleg.gait.phases import Phases, no_flights
from jaxleg.robot import Robot
from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.terrain import HeightMap
from jaxleg.terrain.ground import on_ground
from jaxleg.walk.data import Reference
from jaxleg.walk.reference import phase_instants, to_reference

FEET = np.array([[0.32, 0.18], [0.30, -0.18], [-0.30, 0.18], [-0.28, -0.18]])
HEIGHT = 0.46  # of the trunk over the feet [m]
SWINGS = 3  # RH
SHIFTED = np.array([0.09, 0.06, -0.03, 0.05, -0.04, 0.06])  # the trunk's way to where RH can swing
MOVED_ON = np.array([0.02, 0.01, 0.02, -0.04, 0.02, 0.05])  # ... and on, while it swings
STRIDE, APEX, LOAD_SHARE, LIFT_SHARE = 0.05, 0.04, 0.1, 0.1


def sloping(ahead: float, aside: float, shape: tuple[int, int] = (30, 24), resolution: float = 0.1) -> HeightMap:
    """The plane z = ahead x + aside y, round the origin."""
    origin = -0.5 * resolution * (np.array(shape) - 1)
    x, y = (origin[i] + resolution * np.arange(shape[i]) for i in (0, 1))
    return HeightMap(jnp.asarray(ahead * x[:, None] + aside * y), jnp.asarray(origin), jnp.asarray(resolution))


def shift_and_step(robot: Robot, terrain: HeightMap, seconds: tuple[float, float], samples: tuple[int, int]) -> Reference:
    """The trunk moves and turns over four feet; then it moves on while RH swings; each for so many seconds and samples."""
    return step_instants(robot, terrain, seconds, samples)[2]


def step_instants(robot: Robot, terrain: HeightMap, seconds: tuple[float, float], samples: tuple[int, int]):
    """Times, instants and reference of `shift_and_step`."""

    return _planned(robot, terrain, seconds, samples)


@functools.partial(jax.jit, static_argnums=(2, 3))
def _planned(robot, terrain, seconds, samples):
    feet = on_ground(robot, terrain, jnp.asarray(FEET))
    landed = feet.at[SWINGS].set(on_ground(robot, terrain, jnp.asarray(FEET[SWINGS] + [STRIDE, 0.0])[None])[0])
    first = jnp.zeros(6).at[2].set(jnp.mean(feet[:, 2]) + HEIGHT)
    poses = first[None] + jnp.cumsum(jnp.asarray(np.stack([np.zeros(6), SHIFTED, MOVED_ON])), axis=0)
    swings, duration = jnp.asarray(np.eye(4)[SWINGS] * [[0.0], [1.0]]), jnp.asarray(seconds)
    feet_from, feet_to = jnp.stack([feet, feet]), jnp.stack([feet, landed])
    moves = jnp.sum(swings, axis=1)
    flight = no_flights(2, duration.dtype)._replace(apex=APEX * moves, lift=LIFT_SHARE * moves)
    phases = Phases(jnp.cumsum(duration) - duration, duration, poses[:2], poses[1:], feet_from, feet_to, flight, swings)
    time, at = phase_instants(robot, phases, (SHIFT, SWINGS), jnp.asarray(LOAD_SHARE), samples)
    return time, jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), at), to_reference(time, at)


class Body(NamedTuple):
    """MuJoCo's terms of a state."""

    mass: np.ndarray  # (18, 18)
    bias: np.ndarray  # (18,)
    jacobian: np.ndarray  # of the feet (leg, 3, 18)
    feet: np.ndarray  # (leg, 3)
    com: np.ndarray
    energy: float  # kinetic and potential [J]


class Mujoco:
    """C MuJoCo's numbers for a robot that nothing touches."""

    def __init__(self, robot: Robot) -> None:
        self.model = mujoco.MjModel.from_xml_string(robot_mjcf(robot))
        self.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        self.data = mujoco.MjData(self.model)

    def __call__(self, q, v=None) -> Body:
        data, model = self.data, self.model
        data.qpos[:], data.qvel[:] = q, 0.0 if v is None else v
        mujoco.mj_forward(model, data)
        mass, jacobian = np.zeros((18, 18)), np.zeros((4, 3, 18))
        mujoco.mj_fullM(model, data, mass)
        for leg in range(4):
            mujoco.mj_jacSite(model, data, jacobian[leg], None, leg)
        return Body(
            mass, data.qfrc_bias.copy(), jacobian, data.site_xpos.copy(), data.subtree_com[1].copy(), float(sum(data.energy))
        )


def applied_torque(robot: Robot, now: Tracking, q, v, after) -> np.ndarray:
    """Torque (12,) [N m] of joint controllers whose velocity part is the step's end's, but where they are at their limit."""
    kp, kd, limit = (np.asarray(x).reshape(12) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit))
    position, velocity, torque = (np.asarray(x).reshape(12) for x in now[:3])
    wanted = kp * (position - q[7:]) + kd * (velocity - v[6:]) + torque
    free = np.abs(wanted) < limit
    return np.where(free, wanted - kd * (after[6:] - v[6:]), np.sign(wanted) * limit)


def contact_force(ground, radius, plane, foot, velocity, later, dt) -> np.ndarray:
    """Force [N] of a plane (dz/dx, dz/dy) on a foot at a place, by its velocity before and after the step."""
    normal = np.array([-plane[0], -plane[1], 1.0]) / np.sqrt(1.0 + plane[0] ** 2 + plane[1] ** 2)
    depth = radius - (foot[2] - plane[0] * foot[0] - plane[1] * foot[1]) * normal[2]
    pressed = ground.stiffness * ground.softness * np.logaddexp(0.0, depth / ground.softness)
    damping = (ground.damping + dt * ground.stiffness) / (1.0 + np.exp(-depth / ground.softness))
    slides, will_slide = (w - normal * (normal @ w) for w in (velocity, later))
    friction = ground.friction * pressed / np.sqrt(slides @ slides + ground.creep**2)
    return (pressed - damping * (normal @ later)) * normal - friction * will_slide
