"""Robot: geometry, masses, motors and limits of a quadruped as one pytree, read from a TOML file.

Nothing here or elsewhere in the package knows the numbers of a particular robot; they live in `configs/robots/*.toml`.
Paper A's constants and our own assumptions are told apart by the comments of that file.
"""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.conventions import LEG_END, LEG_SIDE
from jaxleg.settings import load, setting


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Robot:
    """A quadruped: a trunk and four legs of three revolute joints (hip roll, thigh pitch, knee pitch).

    Every field is a leaf, so any of them may be differentiated or batched. Link j of a leg (hip, thigh, shank) has its
    frame at joint j, aligned with the trunk when all joint angles are zero.
    """

    hip_position: Float[Array, "*batch leg xyz"]  # hip joint in B [m]
    joint_axis: Float[Array, "*batch leg joint xyz"]  # unit axis of joint j in the frame of its link
    link_offset: Float[Array, "*batch leg joint xyz"]  # end of link j (next joint, or the foot) in its frame [m]
    trunk_mass: Float[Array, "*batch"]  # [kg]
    trunk_com: Float[Array, "*batch xyz"]  # in B [m]
    trunk_inertia: Float[Array, "*batch xyz"]  # principal moments about the COM, axes of B [kg m^2]
    link_mass: Float[Array, "*batch leg joint"]  # [kg]
    link_com: Float[Array, "*batch leg joint xyz"]  # in the link's frame [m]
    link_inertia: Float[Array, "*batch leg joint xyz"]  # principal moments about the COM, axes of the link [kg m^2]
    rotor_inertia: Float[Array, "*batch leg joint"]  # reflected to the joint (gear^2 times the rotor's) [kg m^2]
    joint_damping: Float[Array, "*batch leg joint"]  # viscous loss of joint and gear [N m s]
    torque_limit: Float[Array, "*batch leg joint"]  # [N m]
    stiffness: Float[Array, "*batch leg joint"]  # position gain kp of the joint controller [N m/rad]
    velocity_gain: Float[Array, "*batch leg joint"]  # kd [N m s/rad]
    foot_radius: Float[Array, "*batch"]  # disc that the foot needs on the ground [m]
    contact_radius: Float[Array, "*batch"]  # the foot touches as a sphere of this radius about the end of the shank [m]
    leg_radius: Float[Array, "*batch"]  # of the capsules round thigh and shank that must not touch the ground [m]
    joint_range: Float[Array, "*batch leg joint 2"]  # least and greatest joint angle [rad]
    trunk_size: Float[Array, "*batch xyz"]  # length, width, height of the trunk's box about B's origin [m]
    torque_constant: Float[Array, "*batch"]  # K_t of the motor [N m/A]
    resistance: Float[Array, "*batch"]  # R of a winding [Ohm]
    gear_ratio: Float[Array, "*batch"]  # joint torque = K_t * current * gear ratio
    knee_sign: Float[Array, "*batch"]  # +1: knees point backward (knee angle > 0), -1: forward

    @property
    def mass(self) -> Float[Array, ""]:
        """Total mass [kg]."""
        return self.trunk_mass + jnp.sum(self.link_mass)


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Lengths in metres. `hip_spacing` and `hip_width` are between hip joints (front to hind, left to right)."""

    hip_spacing: float = setting(above=0.0)
    hip_width: float = setting(above=0.0)
    hip_link: float = setting(min=0.0)
    thigh: float = setting(above=0.0)
    shank: float = setting(above=0.0)
    foot_radius: float = setting(above=0.0, max=0.1)
    contact_radius: float = setting(above=0.0, max=0.1)
    trunk_size: tuple[float, float, float] = setting()
    leg_radius: float = setting(0.02, above=0.0, max=0.1)
    hip_range_deg: tuple[float, float] = setting((-180.0, 180.0), min=-180.0, max=180.0)
    thigh_range_deg: tuple[float, float] = setting((-180.0, 180.0), min=-180.0, max=180.0)
    knee_range_deg: tuple[float, float] = setting((-180.0, 180.0), min=-180.0, max=180.0)
    knees: str = setting("backward", choices=("backward", "forward"))

    def __post_init__(self) -> None:
        for key in ("hip_range_deg", "thigh_range_deg", "knee_range_deg"):
            low, high = getattr(self, key)
            if low >= high:
                raise ValueError(f"{key} must go from the least angle to the greatest, not from {low:g} to {high:g}")


@dataclasses.dataclass(frozen=True)
class Masses:
    """Masses in kg, centres as fractions of the link's length, radii of gyration in metres."""

    total: float = setting(above=0.0)
    hip: float = setting(above=0.0)
    thigh: float = setting(above=0.0)
    shank: float = setting(above=0.0)
    thigh_com: float = setting(min=0.0, max=1.0)
    shank_com: float = setting(min=0.0, max=1.0)
    hip_com: float = setting(min=0.0, max=1.0)
    link_radius: float = setting(above=0.0)
    com_offset: tuple[float, float, float] = setting((0.0, 0.0, 0.0))


@dataclasses.dataclass(frozen=True)
class Motor:
    """Motor, gear and joint controller, one set for all joints."""

    torque_constant: float = setting(above=0.0)
    resistance: float = setting(above=0.0)
    gear_ratio: float = setting(above=0.0)
    rotor_inertia: float = setting(min=0.0)
    damping: float = setting(min=0.0)
    torque_limit: float = setting(above=0.0)
    stiffness: float = setting(above=0.0)
    velocity_gain: float = setting(min=0.0)


@dataclasses.dataclass(frozen=True)
class RobotFile:
    """What a robot's TOML file holds."""

    name: str = setting()
    geometry: Geometry = setting()
    masses: Masses = setting()
    motor: Motor = setting()


def load_robot(path: str | Path) -> Robot:
    """Read a robot's TOML file. Raises `InputError` naming the file, the key and what is allowed."""
    return build_robot(load(RobotFile, path))


def build_robot(file: RobotFile) -> Robot:
    """Lay out a symmetric quadruped from a robot file: four equal legs, mirrored left to right."""
    geometry, masses, motor = file.geometry, file.masses, file.motor
    side, end = np.array(LEG_SIDE), np.array(LEG_END)
    zero = np.zeros(4)
    hips = np.stack([end * geometry.hip_spacing / 2, side * geometry.hip_width / 2, zero], axis=-1)
    axes = np.zeros((4, 3, 3))
    axes[:, 0, 0] = side  # positive hip = abduction: outwards and up on either side
    axes[:, 1:, 1] = -1.0  # positive thigh and knee swing the foot forward
    offsets = np.zeros((4, 3, 3))
    offsets[:, 0, 1] = side * geometry.hip_link
    offsets[:, 1, 2] = -geometry.thigh
    offsets[:, 2, 2] = -geometry.shank
    fractions = np.array([masses.hip_com, masses.thigh_com, masses.shank_com])
    link_mass = np.broadcast_to([masses.hip, masses.thigh, masses.shank], (4, 3))
    trunk_mass = masses.total - link_mass.sum()
    joints = np.ones((4, 3))
    ranges = np.deg2rad([geometry.hip_range_deg, geometry.thigh_range_deg, geometry.knee_range_deg])
    fields = dict(
        hip_position=hips,
        joint_axis=axes,
        link_offset=offsets,
        trunk_mass=trunk_mass,
        trunk_com=masses.com_offset,
        trunk_inertia=_box_inertia(trunk_mass, np.array(geometry.trunk_size)),
        link_mass=link_mass,
        link_com=offsets * fractions[:, None],
        link_inertia=_rod_inertia(link_mass, offsets, masses.link_radius),
        rotor_inertia=joints * motor.rotor_inertia * motor.gear_ratio**2,
        joint_damping=joints * motor.damping,
        torque_limit=joints * motor.torque_limit,
        stiffness=joints * motor.stiffness,
        velocity_gain=joints * motor.velocity_gain,
        foot_radius=geometry.foot_radius,
        contact_radius=geometry.contact_radius,
        leg_radius=geometry.leg_radius,
        joint_range=np.broadcast_to(ranges, (4, 3, 2)),
        trunk_size=geometry.trunk_size,
        torque_constant=motor.torque_constant,
        resistance=motor.resistance,
        gear_ratio=motor.gear_ratio,
        knee_sign=1.0 if geometry.knees == "backward" else -1.0,
    )
    return Robot(**{name: jnp.asarray(value, dtype=float) for name, value in fields.items()})


def _box_inertia(mass: float, size: np.ndarray) -> np.ndarray:
    square = size**2
    return mass / 12.0 * (square.sum() - square)


def _rod_inertia(mass: np.ndarray, offset: np.ndarray, radius: float) -> np.ndarray:
    """Uniform rods along `offset` of a round section whose radius of gyration about its axis is `radius`."""
    square = offset**2
    return mass[..., None] * ((square.sum(-1, keepdims=True) - square) / 12.0 + radius**2)
