"""A robot's TOML file, and the `Robot` that it describes.

Nothing here or elsewhere in the package knows the numbers of a particular robot; they live in `configs/robots/*.toml`.
Paper A's constants and our own assumptions are told apart by the comments of that file.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from jaxleg.conventions import LEG_END, LEG_SIDE
from jaxleg.robot.model import Robot
from jaxleg.settings import setting


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Lengths in metres. `hip_spacing` and `hip_width` are between hip joints (front to hind, left to right)."""

    hip_spacing: float = setting(min=0.01, max=10.0)
    hip_width: float = setting(min=0.01, max=10.0)
    hip_link: float = setting(min=0.0, max=10.0)
    thigh: float = setting(min=0.01, max=10.0)
    shank: float = setting(min=0.01, max=10.0)
    foot_radius: float = setting(min=1e-4, max=0.1)
    contact_radius: float = setting(min=1e-4, max=0.1)
    trunk_size: tuple[float, float, float] = setting(min=0.01, max=10.0)
    leg_radius: float = setting(0.02, min=1e-4, max=0.1)
    hip_range_deg: tuple[float, float] = setting((-180.0, 180.0), min=-180.0, max=180.0)
    thigh_range_deg: tuple[float, float] = setting((-180.0, 180.0), min=-180.0, max=180.0)
    knee_range_deg: tuple[float, float] = setting((-180.0, 180.0), min=-180.0, max=180.0)
    knees: str = setting("backward", choices=("backward", "forward"))


@dataclasses.dataclass(frozen=True)
class Masses:
    """Masses in kg, centres as fractions of the link's length, radii of gyration in metres."""

    total: float = setting(min=0.1, max=1e4)
    hip: float = setting(above=0.0)
    thigh: float = setting(above=0.0)
    shank: float = setting(above=0.0)
    thigh_com: float = setting(min=0.0, max=1.0)
    shank_com: float = setting(min=0.0, max=1.0)
    hip_com: float = setting(min=0.0, max=1.0)
    link_radius: float = setting(min=1e-4, max=1.0)
    com_offset: tuple[float, float, float] = setting((0.0, 0.0, 0.0))


@dataclasses.dataclass(frozen=True)
class Motor:
    """Motor, gear and joint controller, one set for all joints."""

    torque_constant: float = setting(min=1e-4, max=1e3)
    resistance: float = setting(min=1e-4, max=1e4)
    gear_ratio: float = setting(min=0.1, max=1e4)
    rotor_inertia: float = setting(min=0.0, max=1.0)
    damping: float = setting(min=0.0, max=1e4)
    torque_limit: float = setting(above=0.0, max=1e6)
    stiffness: float = setting(min=1e-3, max=1e7)
    velocity_gain: float = setting(min=0.0, max=1e6)


@dataclasses.dataclass(frozen=True)
class RobotFile:
    """What a robot's TOML file holds."""

    name: str = setting()
    geometry: Geometry = setting()
    masses: Masses = setting()
    motor: Motor = setting()


def build_robot(file: RobotFile) -> Robot:
    """Lay out a symmetric quadruped from a robot file: four equal legs, mirrored left to right.

    Differentiable: any number of the file may be a tracer. The numbers are taken as they are, see `check_robot`.
    """
    geometry, masses, motor = file.geometry, file.masses, file.motor
    links = (masses.hip, masses.thigh, masses.shank)
    fractions = (masses.hip_com, masses.thigh_com, masses.shank_com)
    offsets = [
        ((0.0, side * geometry.hip_link, 0.0), (0.0, 0.0, -geometry.thigh), (0.0, 0.0, -geometry.shank)) for side in LEG_SIDE
    ]
    trunk_mass = masses.total - 4.0 * (masses.hip + masses.thigh + masses.shank)
    ranges = (geometry.hip_range_deg, geometry.thigh_range_deg, geometry.knee_range_deg)
    degree = jnp.pi / 180.0
    fields = dict(
        hip_position=[(e * geometry.hip_spacing / 2, s * geometry.hip_width / 2, 0.0) for e, s in zip(LEG_END, LEG_SIDE)],
        # positive hip = abduction: outwards and up on either side; positive thigh and knee swing the foot forward
        joint_axis=[((side, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, -1.0, 0.0)) for side in LEG_SIDE],
        link_offset=offsets,
        trunk_mass=trunk_mass,
        trunk_com=masses.com_offset,
        trunk_inertia=_box_inertia(trunk_mass, geometry.trunk_size),
        link_mass=[links] * 4,
        link_com=[[[part * x for x in link] for part, link in zip(fractions, leg)] for leg in offsets],
        link_inertia=[[_rod_inertia(m, link, masses.link_radius) for m, link in zip(links, leg)] for leg in offsets],
        rotor_inertia=_all_joints(motor.rotor_inertia * motor.gear_ratio**2),
        joint_damping=_all_joints(motor.damping),
        torque_limit=_all_joints(motor.torque_limit),
        stiffness=_all_joints(motor.stiffness),
        velocity_gain=_all_joints(motor.velocity_gain),
        foot_radius=geometry.foot_radius,
        contact_radius=geometry.contact_radius,
        leg_radius=geometry.leg_radius,
        joint_range=[[[degree * angle for angle in span] for span in ranges]] * 4,
        trunk_size=geometry.trunk_size,
        torque_constant=motor.torque_constant,
        resistance=motor.resistance,
        gear_ratio=motor.gear_ratio,
        knee_sign=1.0 if geometry.knees == "backward" else -1.0,
    )
    return Robot(**{name: jnp.array(value, dtype=float) for name, value in fields.items()})


def _all_joints(number: Any) -> list[list[Any]]:
    return [[number] * 3] * 4


def _box_inertia(mass: Any, size: Sequence[Any]) -> list[Any]:
    square = [x**2 for x in size]
    return [mass / 12.0 * (sum(square) - x) for x in square]


def _rod_inertia(mass: Any, offset: Sequence[Any], radius: Any) -> list[Any]:
    """Uniform rods along `offset` of a round section whose radius of gyration about its axis is `radius`."""
    square = [x**2 for x in offset]
    return [mass * ((sum(square) - x) / 12.0 + radius**2) for x in square]
