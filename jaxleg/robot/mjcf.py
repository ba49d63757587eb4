"""MJCF of a `Robot`: the model that MJX and C MuJoCo simulate, and that travels with a plan."""

from types import SimpleNamespace
from xml.etree import ElementTree as xml

import numpy as np

from jaxleg.conventions import GRAVITY, LEGS
from jaxleg.robot.model import Robot

LINKS = ("hip", "thigh", "shank")
FEET, TRUNK = 1, 2  # collision bits: the ground has both


def robot_mjcf(robot: Robot, feet_contact: bool = False) -> str:
    """MJCF text of a concrete robot: a free trunk and, leg by leg, three hinges; SI units, joint order of `conventions`.

    qpos: position in W, quaternion w x y z, joints; qvel: linear in W, angular in B, joints. Only the foot spheres and the
    trunk's box collide, the box with the ground alone, and only with `feet_contact` (MuJoCo's own contacts, for the referee).
    """
    plain = _concrete(robot)
    root = xml.Element("mujoco", model="quadruped")
    xml.SubElement(root, "compiler", angle="radian")
    xml.SubElement(root, "option", gravity=_text([0, 0, -GRAVITY]))
    world = xml.SubElement(root, "worldbody")
    trunk = xml.SubElement(world, "body", name="trunk")
    xml.SubElement(trunk, "freejoint", name="root")
    _inertial(trunk, plain.trunk_mass, plain.trunk_com, plain.trunk_inertia)
    collide = {"contype": "0", "conaffinity": str(TRUNK)} if feet_contact else {}
    _geom(trunk, name="trunk", type="box", size=_text(plain.trunk_size / 2), **collide)
    for leg, name in enumerate(LEGS):
        _leg(trunk, plain, leg, name, feet_contact)
    return xml.tostring(root, encoding="unicode")


def _leg(body, robot, leg, name, feet_contact):
    for j, link in enumerate(LINKS):
        place = robot.hip_position[leg] if j == 0 else robot.link_offset[leg, j - 1]
        body = xml.SubElement(body, "body", name=f"{name}_{link}", pos=_text(place))
        joint = {"armature": robot.rotor_inertia[leg, j], "damping": robot.joint_damping[leg, j]}
        joint = {key: _text(value) for key, value in joint.items()}
        xml.SubElement(body, "joint", name=f"{name}_{link}", axis=_text(robot.joint_axis[leg, j]), **joint)
        _inertial(body, robot.link_mass[leg, j], robot.link_com[leg, j], robot.link_inertia[leg, j])
        _geom(body, **_link(robot.link_offset[leg, j], robot.leg_radius))
    end = _text(robot.link_offset[leg, 2])
    xml.SubElement(body, "site", name=f"{name}_foot", pos=end)
    collide = {"contype": str(FEET), "conaffinity": str(FEET)} if feet_contact else {}
    _geom(body, name=f"{name}_foot", type="sphere", size=_text(robot.contact_radius), pos=end, **collide)


def _link(offset, radius) -> dict[str, str]:
    """The capsule of a link; MuJoCo knows none of length 0 (`hip_link = 0`)."""
    if np.linalg.norm(offset) < 1e-6:
        return {"type": "sphere", "size": _text(radius)}
    return {"type": "capsule", "size": _text(radius), "fromto": _text([0, 0, 0, *offset])}


def _inertial(body, mass, place, moments):
    xml.SubElement(body, "inertial", mass=_text(mass), pos=_text(place), diaginertia=_text(moments))


def _geom(body, **attributes):
    xml.SubElement(body, "geom", **({"contype": "0", "conaffinity": "0", "group": "1"} | attributes))


def _text(values) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _concrete(robot: Robot) -> SimpleNamespace:
    return SimpleNamespace(**{name: np.asarray(value, np.float64) for name, value in vars(robot).items()})
