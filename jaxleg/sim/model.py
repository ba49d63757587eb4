"""The referee's model: a robot with its joint controllers on a height field, for C MuJoCo.

Ground that nobody has seen is as high as the lowest that somebody has, so that no trunk meets it; a foot over it is a fall
(`over_unseen`), as in the batched simulation.
"""

from typing import NamedTuple
from xml.etree import ElementTree as xml

import mujoco
import numpy as np

from jaxleg.conventions import LEGS
from jaxleg.robot import Robot
from jaxleg.robot.mjcf import FEET, LINKS, TRUNK, robot_mjcf
from jaxleg.terrain.heightmap import HeightMap, heights

STEP = 2e-3  # [s]
TRUNK_CONTACT = 19  # place of the trunk's contacts among the sensors: after feet (4 x 3), loads (4) and the centre of mass (3)


def build_model(robot: Robot, terrain: HeightMap, friction: float, finer: int = 2) -> mujoco.MjModel:
    """The robot with its actuators and sensors on a height field of the terrain, `finer` times its resolution."""
    root = xml.fromstring(robot_mjcf(robot, feet_contact=True))
    option = next(root.iter("option"))
    option.attrib |= {"timestep": repr(STEP), "integrator": "implicitfast", "cone": "elliptic", "impratio": "20"}
    xml.SubElement(option, "flag", autoreset="disable")
    surface = surface_of(terrain, finer)
    low = np.min(surface.height, where=np.isfinite(surface.height), initial=np.inf)
    low = float(low) if np.isfinite(low) else 0.0
    elevation = np.where(np.isfinite(surface.height), surface.height, low)
    high = max(elevation.max(), low + 1e-3)
    half = 0.5 * surface.spacing * (np.array(elevation.shape) - 1)
    place = surface.origin + half
    rows, columns = elevation.T.shape
    asset = xml.SubElement(root, "asset")
    size = f"{half[0]} {half[1]} {high - low} 0.5"
    xml.SubElement(asset, "hfield", name="ground", nrow=str(rows), ncol=str(columns), size=size)
    contact = {"friction": f"{friction} 0.005 0.0001", "solref": "0.004 1", "solimp": "0.95 0.99 0.001", "condim": "3"}
    ground = {"name": "ground", "type": "hfield", "hfield": "ground", "pos": f"{place[0]} {place[1]} {low}"}
    bits = {"contype": str(FEET | TRUNK), "conaffinity": str(FEET)}
    xml.SubElement(next(root.iter("worldbody")), "geom", **(ground | contact | bits), priority="1")
    for site in root.iter("site"):  # a touch sensor sees the contacts inside its site
        site.set("size", repr(4.0 * float(robot.contact_radius)))
    _actuators(root, robot)
    model = mujoco.MjModel.from_xml_string(xml.tostring(root, encoding="unicode"))
    model.hfield_data[:] = ((elevation.T - low) / (high - low)).reshape(-1)
    return model


class Surface(NamedTuple):
    """The ground on a finer grid."""

    height: np.ndarray  # (x, y) [m]; NaN where nobody has seen it
    origin: np.ndarray  # x, y of its first point [m]
    spacing: float  # [m]


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


def _actuators(root, robot: Robot) -> None:
    """Joint controllers kp (q_ref - q) + kd (v_ref - v) + torque, their reference parts summed up in the control."""
    actuator, sensor = xml.SubElement(root, "actuator"), xml.SubElement(root, "sensor")
    numbers = [np.asarray(x) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit)]
    for leg, name in enumerate(LEGS):
        for j, link in enumerate(LINKS):
            kp, kd, limit = (float(x[leg, j]) for x in numbers)
            gains = {"biastype": "affine", "gainprm": "1 0 0", "biasprm": f"0 {-kp} {-kd}"}
            force = {"forcelimited": "true", "forcerange": f"{-limit} {limit}"}
            xml.SubElement(actuator, "general", joint=f"{name}_{link}", **gains, **force)
    for name in LEGS:
        xml.SubElement(sensor, "framepos", objtype="site", objname=f"{name}_foot")
    for name in LEGS:
        xml.SubElement(sensor, "touch", site=f"{name}_foot")
    xml.SubElement(sensor, "subtreecom", body="trunk")
    xml.SubElement(sensor, "contact", geom1="trunk", geom2="ground", data="found")
