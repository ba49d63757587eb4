"""Rigid bodies that move: Newton's and Euler's equations, for bodies that turn about an axis of another."""

from jaxtyping import Array, Float

from jaxleg.leg.plane import Angle, into_plane
from jaxleg.pytree import pytree
from jaxleg.vectors import Vector


@pytree
class Body:
    """A rigid body, its vectors in its own frame."""

    com: Vector  # [m]
    inertia: Vector  # principal moments about the centre of mass, along the frame's axes [kg m^2]
    mass: Float[Array, "*n"]  # [kg]


@pytree
class Moving:
    """How a body moves in W, in the axes of some frame."""

    spin: Vector  # angular velocity [rad/s]
    spin_rate: Vector  # [rad/s^2]
    acceleration: Vector  # of its origin, less that of gravity: at rest it is upwards [m/s^2]

    def at(self, arm: Vector) -> Vector:
        """Acceleration [m/s^2] of the body's point at `arm` [m] from the origin."""
        return self.acceleration + self.spin_rate.cross(arm) + self.spin.cross(self.spin.cross(arm))


@pytree
class Wrench:
    """Force [N] and moment [N m] about a point."""

    force: Vector
    moment: Vector

    def __add__(self, other: "Wrench") -> "Wrench":
        return Wrench(self.force + other.force, self.moment + other.moment)

    def about(self, arm: Vector) -> "Wrench":
        """About another point, from which this one is at `arm` [m]."""
        return Wrench(self.force, self.moment + arm.cross(self.force))


def effort(body: Body, moving: Moving) -> Wrench:
    """What moves a body so, about its origin, all in its frame: Newton's and Euler's equations."""
    force, spin, inertia = moving.at(body.com) * body.mass, moving.spin, body.inertia
    momentum, moment = (Vector(inertia.x * v.x, inertia.y * v.y, inertia.z * v.z) for v in (spin, moving.spin_rate))
    return Wrench(force, moment + spin.cross(momentum) + body.com.cross(force))


def rolling(trunk: Moving, hip: Vector, roll: Angle, rate: Float[Array, "*n"], rate_on: Float[Array, "*n"]) -> Moving:
    """A leg's plane at the hip joint, in P, that rolls by rates [rad/s, rad/s^2] on a trunk that moves."""
    spin, spin_rate = into_plane(roll, trunk.spin), into_plane(roll, trunk.spin_rate)
    gained = Vector(spin_rate.x + rate_on, spin_rate.y + spin.z * rate, spin_rate.z - spin.y * rate)
    return Moving(Vector(spin.x + rate, spin.y, spin.z), gained, into_plane(roll, trunk.at(hip)))


def pitching(plane: Moving, joint: Vector, rate: Float[Array, "*n"], rate_on: Float[Array, "*n"]) -> Moving:
    """A link, in P, that pitches by rates [rad/s, rad/s^2] in a plane that moves; its joint accelerates by `joint` [m/s^2]."""
    spin, spin_rate = plane.spin, plane.spin_rate
    gained = Vector(spin_rate.x - spin.z * rate, spin_rate.y + rate_on, spin_rate.z + spin.x * rate)
    return Moving(Vector(spin.x, spin.y + rate, spin.z), gained, joint)
