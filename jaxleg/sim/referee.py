"""The referee: C MuJoCo replays the same reference on its own height field with its own contacts and integrator.

Nothing of the batched simulation takes part: contacts are MuJoCo's (elliptic cones, Newton solver), the ground a height field
of twice the map's resolution, the step a uniform 2 ms with `implicitfast`. Only the robot's numbers and the joint reference
are shared.
"""

from typing import NamedTuple
from xml.etree import ElementTree as xml

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import rollout

from jaxleg.conventions import LEGS
from jaxleg.gait import stability_margin
from jaxleg.plan import Reference
from jaxleg.robot import Robot
from jaxleg.robot.mjcf import LINKS, robot_mjcf
from jaxleg.terrain.heightmap import HeightMap, height

STEP = 2e-3  # [s]
SETTLE = 0.3  # the first pose is held this long before the walk [s]
LOADED = 5.0  # a foot slips only while it carries more than this [N]


class Verdict(NamedTuple):
    """What the referee measured over the metered part of one walk; numbers in SI units."""

    mechanical: float  # [J]
    mechanical_positive: float
    joule: float
    distance: float
    time: float
    slip: float  # mean of the feet [m]
    margin: float  # least stability margin [m]
    fell: bool


def replay(
    robot: Robot, terrains: list[HeightMap], references: list[Reference], friction: float, metered_from: int = 0
) -> list[Verdict]:
    """Replay walks, each on its own terrain, on two threads. `metered_from` is the first metered sample of the references.

    A lane falls if it ends up tilted by more than 45 degrees, its trunk sinks below half its height, or it is not finite. Where
    a reference is not finite, the control is 0: the robot sinks down.
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
    states, sensors = rollout.rollout(models, workers, start, control, skip_checks=False)
    return [
        _verdict(robot, reference, states[i, : len(track)], sensors[i, : len(track)], track, metered_from)
        for i, (reference, track) in enumerate(zip(references, tracks))
    ]


def build_model(robot: Robot, terrain: HeightMap, friction: float, finer: int = 2) -> mujoco.MjModel:
    """The robot with its actuators and sensors on a height field of the terrain, `finer` times its resolution."""
    root = xml.fromstring(robot_mjcf(robot, feet_contact=True))
    option = next(root.iter("option"))
    option.attrib |= {"timestep": repr(STEP), "integrator": "implicitfast", "cone": "elliptic", "impratio": "20"}
    elevation, place, half = _surface(terrain, finer)
    low, high = elevation.min(), max(elevation.max(), elevation.min() + 1e-3)
    rows, columns = elevation.T.shape
    asset = xml.SubElement(root, "asset")
    size = f"{half[0]} {half[1]} {high - low} 0.5"
    xml.SubElement(asset, "hfield", name="ground", nrow=str(rows), ncol=str(columns), size=size)
    contact = {"friction": f"{friction} 0.005 0.0001", "solref": "0.004 1", "solimp": "0.95 0.99 0.001", "condim": "3"}
    ground = {"type": "hfield", "hfield": "ground", "pos": f"{place[0]} {place[1]} {low}", "contype": "1", "conaffinity": "1"}
    xml.SubElement(next(root.iter("worldbody")), "geom", **(ground | contact), priority="1")
    for site in root.iter("site"):  # a touch sensor sees the contacts inside its site
        site.set("size", repr(4.0 * float(robot.contact_radius)))
    _actuators(root, robot)
    model = mujoco.MjModel.from_xml_string(xml.tostring(root, encoding="unicode"))
    model.hfield_data[:] = ((elevation.T - low) / (high - low)).reshape(-1)
    return model


def _surface(terrain: HeightMap, finer: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights (x, y) of the surface on a finer grid, its centre and half extent [m]."""
    origin, resolution = np.asarray(terrain.origin, float), float(terrain.resolution)
    count = finer * (np.array(terrain.elevation.shape) - 1) + 1
    axes = [origin[i] + resolution / finer * np.arange(count[i]) for i in (0, 1)]
    points = jnp.asarray(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), terrain.elevation.dtype)
    half = 0.5 * resolution / finer * (count - 1)
    return np.asarray(_heights(terrain, points), float), origin + half, half


@jax.jit
def _heights(terrain, points):
    return jax.vmap(jax.vmap(height, in_axes=(None, 0)), in_axes=(None, 0))(terrain, points)


def _actuators(root, robot: Robot) -> None:
    """Joint controllers kp (q_ref - q) + kd (v_ref - v) + torque, their reference parts summed up in the control."""
    actuator, sensor = xml.SubElement(root, "actuator"), xml.SubElement(root, "sensor")
    for leg, name in enumerate(LEGS):
        for j, link in enumerate(LINKS):
            kp, kd, limit = (float(x[leg, j]) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit))
            gains = {"biastype": "affine", "gainprm": "1 0 0", "biasprm": f"0 {-kp} {-kd}"}
            force = {"forcelimited": "true", "forcerange": f"{-limit} {limit}"}
            xml.SubElement(actuator, "general", joint=f"{name}_{link}", **gains, **force)
    for name in LEGS:
        xml.SubElement(sensor, "framepos", objtype="site", objname=f"{name}_foot")
    for name in LEGS:
        xml.SubElement(sensor, "touch", site=f"{name}_foot")
    xml.SubElement(sensor, "subtreecom", body="trunk")


def controls(robot: Robot, reference: Reference) -> np.ndarray:
    """Control of every step (step, 12): the reference held for `SETTLE`, then followed on a uniform time grid."""
    time = np.asarray(reference.time, float)
    at = np.clip(np.arange(int(np.ceil((SETTLE + time[-1]) / STEP))) * STEP - SETTLE, 0.0, None)
    flat = [
        np.asarray(x, float).reshape(len(time), 12) for x in (reference.joint_pos, reference.joint_vel, reference.joint_torque)
    ]
    position, velocity, torque = (np.stack([np.interp(at, time, x[:, j]) for j in range(12)], axis=1) for x in flat)
    velocity = velocity * (at > 0.0)[:, None]
    kp, kd = (np.asarray(x, float).reshape(12) for x in (robot.stiffness, robot.velocity_gain))
    return kp * position + kd * velocity + torque


def start_state(model: mujoco.MjModel, reference: Reference) -> np.ndarray:
    """MuJoCo's full physics state of the reference's first pose at rest."""
    data = mujoco.MjData(model)
    data.qpos[:] = np.concatenate(
        [np.asarray(x[0], float).reshape(-1) for x in (reference.trunk_pos, reference.trunk_quat, reference.joint_pos)]
    )
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def _verdict(robot, reference, states, sensors, control, metered_from) -> Verdict:
    """Meters from the trajectory: torques as the implicit step applied them, mid-step speeds."""
    q, v = states[:, 1:20], states[:, 20:38]  # after each step
    kp, kd, limit = (np.asarray(x, float).reshape(12) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit))
    first = round((SETTLE + float(reference.time[metered_from])) / STEP)
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
        distance=float(q[-1, 0] - q[first - 1, 0]),
        time=float(len(power) * STEP),
        slip=float((moved * held).sum(axis=0).mean()),
        margin=float(np.min(margin)),
        fell=_fell(q, feet),
    )


@jax.jit
def _margins(com, feet, loaded):
    return jax.vmap(stability_margin)(com, feet, loaded)


def _fell(q: np.ndarray, feet: np.ndarray) -> bool:
    if not np.isfinite(q).all():
        return True
    upright = 1.0 - 2.0 * (q[:, 4] ** 2 + q[:, 5] ** 2)
    stand = q[:, 2] - feet[..., 2].mean(axis=1)
    return bool((upright < np.sqrt(0.5)).any() or (stand < 0.5 * stand[0]).any())
