"""The referee's model: a robot with its joint controllers on a height field, for C MuJoCo.

Ground that nobody has seen is as high as the lowest that somebody has, so that no trunk meets it; a foot over it is a fall
(`over_unseen`), as in the batched simulation.
"""

import itertools
from typing import NamedTuple

import mujoco
import numpy as np

from jaxleg.conventions import LEGS
from jaxleg.gait.limits import leg_length
from jaxleg.robot import Robot
from jaxleg.robot.mjcf import FEET, LINKS, TRUNK, robot_mjcf
from jaxleg.terrain.heightmap import HeightMap, heights

STEP = 2e-3  # [s]
TRUNK_CONTACT = 19  # place of the trunk's contacts among the sensors: after feet (4 x 3), loads (4) and the centre of mass (3)


class Surface(NamedTuple):
    """The ground on a finer grid."""

    height: np.ndarray  # (x, y) [m]; NaN where nobody has seen it
    origin: np.ndarray  # x, y of its first point [m]
    spacing: float  # [m]


def build_model(robot: Robot, terrain: HeightMap, friction: float, finer: int = 2) -> mujoco.MjModel:
    """The robot with its actuators and sensors on a height field of the terrain, `finer` times its resolution. Beyond the map's
    border the ground goes on level for a leg's length: a height field ends there and a foot beyond it would fall."""
    spec = mujoco.MjSpec.from_string(robot_mjcf(robot, feet_contact=True))
    option = spec.option
    option.timestep, option.impratio = STEP, 20.0
    option.integrator, option.cone = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtCone.mjCONE_ELLIPTIC
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    relief = _add_ground(spec, surface_of(_continued(terrain, float(leg_length(robot))), finer), friction)
    for site in spec.sites:  # a touch sensor sees the contacts inside its site
        site.size[0] = 4.0 * float(robot.contact_radius)
    _add_actuators(spec, robot)
    _add_sensors(spec)
    model = spec.compile()
    model.hfield_data[:] = relief.reshape(-1)
    return model


def _continued(terrain: HeightMap, beyond: float) -> HeightMap:
    """The map with its outermost cells once more, so far beyond its border [m]."""
    cells = int(np.ceil(beyond / float(terrain.resolution)))
    origin = np.asarray(terrain.origin) - cells * np.asarray(terrain.resolution)
    return HeightMap(np.pad(np.asarray(terrain.elevation), cells, mode="edge"), origin, terrain.resolution)


def _add_ground(spec: mujoco.MjSpec, surface: Surface, friction: float) -> np.ndarray:
    """Add a surface's height field; returns its heights (y, x), still to be put in, from 0 to 1."""
    seen = np.isfinite(surface.height)
    low = float(surface.height[seen].min()) if seen.any() else 0.0
    elevation = np.where(seen, surface.height, low).T
    rise = max(elevation.max() - low, 1e-3)
    rows, columns = elevation.shape
    half = 0.5 * surface.spacing * np.array([columns - 1, rows - 1])
    blank = np.zeros(elevation.size)  # for the heights: compiled, they would be stretched from 0 to 1
    spec.add_hfield(name="ground", nrow=rows, ncol=columns, size=[*half, rise, 0.5], userdata=blank)
    contact = dict(friction=[friction, 0.005, 0.0001], solref=[0.004, 1.0], solimp=[0.95, 0.99, 0.001, 0.5, 2.0])
    bits = dict(contype=FEET | TRUNK, conaffinity=FEET, condim=3, priority=1)
    shape = dict(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="ground", pos=[*(surface.origin + half), low])
    spec.worldbody.add_geom(name="ground", **shape, **contact, **bits)
    return (elevation - low) / rise


def surface_of(terrain: HeightMap, finer: int = 2) -> Surface:
    """The surface on a grid `finer` times the map's."""
    origin, spacing = np.asarray(terrain.origin, float), float(terrain.resolution) / finer
    count = finer * (np.array(terrain.elevation.shape) - 1) + 1
    axes = [origin[i] + spacing * np.arange(count[i]) for i in (0, 1)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return Surface(np.asarray(heights(terrain, points), float), origin, spacing)


def over_unseen(surface: Surface, feet: np.ndarray) -> np.ndarray:
    """Whether feet (..., 3) in W [m] are over ground that nobody has seen; those that are nowhere are."""
    last = np.array(surface.height.shape) - 1
    place = np.nan_to_num((feet[..., :2] - surface.origin) / surface.spacing)
    cell = np.clip(np.round(place), 0, last).astype(int)
    return np.isnan(surface.height[cell[..., 0], cell[..., 1]])


def _add_actuators(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Joint controllers kp (q_ref - q) + kd (v_ref - v) + torque, their reference parts summed up in the control."""
    kind = dict(trntype=mujoco.mjtTrn.mjTRN_JOINT, biastype=mujoco.mjtBias.mjBIAS_AFFINE, forcelimited=True)
    numbers = (np.asarray(x, float).reshape(12) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit))
    for (name, link), kp, kd, limit in zip(itertools.product(LEGS, LINKS), *numbers):
        actuator = spec.add_actuator(target=f"{name}_{link}", forcerange=[-limit, limit], **kind)
        actuator.gainprm[0], actuator.biasprm[1:3] = 1.0, (-kp, -kd)


def _add_sensors(spec: mujoco.MjSpec) -> None:
    """Of the feet their places and the forces on them, the centre of mass, and whether the trunk meets the ground."""
    sensor, thing = mujoco.mjtSensor, mujoco.mjtObj
    for kind in (sensor.mjSENS_FRAMEPOS, sensor.mjSENS_TOUCH):
        for name in LEGS:
            spec.add_sensor(type=kind, objtype=thing.mjOBJ_SITE, objname=f"{name}_foot")
    spec.add_sensor(type=sensor.mjSENS_SUBTREECOM, objtype=thing.mjOBJ_BODY, objname="trunk")
    pair = dict(objtype=thing.mjOBJ_GEOM, objname="trunk", reftype=thing.mjOBJ_GEOM, refname="ground")
    spec.add_sensor(type=sensor.mjSENS_CONTACT, intprm=[1 << mujoco.mjtConDataField.mjCONDATA_FOUND.value, 0, 1], **pair)
