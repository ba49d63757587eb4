"""Inverse dynamics of a trunk with four legs: Newton-Euler in the plane of each leg, contact forces by weighted least norm.

All vectors are in the trunk's frame B, moments about B's origin, unless they say otherwise; P is a leg's plane (`plane`). For
one instant, or for many at once in axes of their own behind all others.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.leg.kinematics import LegFrames, leg_frames
from jaxleg.leg.moving import Body, Moving, Wrench, effort, pitching, rolling
from jaxleg.leg.plane import Fold, chain_of, fold_of, into_plane, out_of_plane, pitched, signed, unpitched
from jaxleg.numerics import apart
from jaxleg.robot import Robot
from jaxleg.vectors import Rows, Vector, parts, summed, vector, vectors

TANGENTIAL = 0.05  # how readily a plan uses force across the vertical, see `share_load`


class Motion(NamedTuple):
    """Motion of the whole robot."""

    velocity: Float[Array, "leg joint *n"]
    acceleration: Float[Array, "leg joint *n"]
    trunk: Moving


def all_leg_frames(robot: Robot, angles: Float[Array, "leg joint"]) -> LegFrames:
    """`leg_frames` of the four legs, with a leading leg axis; positions relative to each hip joint."""
    return jax.vmap(leg_frames)(robot.joint_axis, robot.link_offset, angles)


def all_folds(robot: Robot, angles: Float[Array, "leg joint *n"]) -> Fold:
    """`fold_of` of the four legs, with a leading leg axis."""
    return jax.vmap(fold_of)(robot.joint_axis, angles)


def feet_in_b(robot: Robot, folds: Fold) -> Vector:
    """The four feet [m], with a leading leg axis."""

    def foot(hip, offset, fold):
        return vector(hip) + out_of_plane(fold.roll, chain_of(offset, fold).foot)

    return jax.vmap(foot)(robot.hip_position, robot.link_offset, folds)


def centre_of_mass(robot: Robot, folds: Fold) -> Vector:
    """Centre of mass of the whole robot [m]."""

    def leg(hip, offset, fold, com, mass):
        chain = chain_of(offset, fold)
        first, second, third = vectors(com)
        second = chain.hip + pitched(fold.thigh, second)
        third = chain.hip + chain.thigh + pitched(fold.shank, third)
        return vector(hip) * jnp.sum(mass) + out_of_plane(fold.roll, first * mass[0] + second * mass[1] + third * mass[2])

    moments = jax.vmap(leg)(robot.hip_position, robot.link_offset, folds, robot.link_com, robot.link_mass)
    return (vector(robot.trunk_com * robot.trunk_mass) + summed(moments)) * (1.0 / robot.mass)


def inverse_dynamics(robot: Robot, folds: Fold, motion: Motion) -> tuple[Float[Array, "leg joint *n"], Wrench]:
    """Joint torques [N m] and trunk wrench that produce a motion without contact.

    The torques include the reflected rotor inertia and the joint's viscous loss; the wrench is what the ground must give.
    """
    torque, wrench = newton_euler(robot, folds, motion)

    def drive(torque, inertia, damping, velocity, acceleration):
        return torque + inertia * acceleration + damping * velocity

    each = jax.vmap(jax.vmap(drive))
    return each(torque, robot.rotor_inertia, robot.joint_damping, motion.velocity, motion.acceleration), wrench


def newton_euler(robot: Robot, folds: Fold, motion: Motion) -> tuple[Float[Array, "leg joint *n"], Wrench]:
    """Joint torques [N m] and trunk wrench of the bodies alone, without rotors and losses (recursive Newton-Euler)."""
    legs = jax.vmap(_leg_inverse_dynamics, in_axes=(0, 0, 0, 0, 0, 0, None))
    links = robot.link_com, robot.link_inertia, robot.link_mass
    rates = motion.velocity, motion.acceleration
    torque, by_leg = legs(robot.joint_axis, robot.link_offset, folds, robot.hip_position, links, rates, motion.trunk)
    trunk = Body(vector(robot.trunk_com), vector(robot.trunk_inertia), robot.trunk_mass)
    return torque, effort(trunk, motion.trunk) + Wrench(summed(by_leg.force), summed(by_leg.moment))


def _leg_inverse_dynamics(axis, offset, fold: Fold, hip, links, rates, trunk: Moving):
    """Joint torques of one leg without contact or losses, and the wrench the trunk gives to it."""
    chain, hip = chain_of(offset, fold), vector(hip)
    hip_link, thigh_link, shank_link = map(Body, *map(vectors, links[:2]), parts(links[2]))
    rate, rate_on = (signed(axis, x) for x in rates)
    plane = rolling(trunk, hip, fold.roll, rate[0], rate_on[0])
    thigh = pitching(plane, plane.at(chain.hip), rate[1], rate_on[1])
    shank = pitching(plane, thigh.at(chain.thigh), rate[2], rate_on[2])
    knee = _in_plane(shank_link, shank, fold.shank)  # what a joint carries, about that joint
    upper = _in_plane(thigh_link, thigh, fold.thigh) + knee.about(chain.thigh)
    whole = effort(hip_link, plane) + upper.about(chain.hip)
    given = Wrench(out_of_plane(fold.roll, whole.force), out_of_plane(fold.roll, whole.moment))
    return _on_joints(axis, whole.moment.x, upper.moment.y, knee.moment.y), given.about(hip)


def _in_plane(link: Body, moving: Moving, pitch) -> Wrench:
    """`effort` of a link that is pitched so, all in P."""
    spin, spin_rate, acceleration = (unpitched(pitch, v) for v in (moving.spin, moving.spin_rate, moving.acceleration))
    own = effort(link, Moving(spin, spin_rate, acceleration))
    return Wrench(pitched(pitch, own.force), pitched(pitch, own.moment))


def _on_joints(axis, hip, thigh, knee):
    """Torques about x and y of P as those of the joints."""
    return jnp.stack([axis[0, 0] * hip, axis[1, 1] * thigh, axis[2, 1] * knee])


def share_load(feet: Vector, weight: Float[Array, "leg *n"], wrench: Wrench, tangential: float = 1.0) -> Vector:
    """Contact forces that add up to a wrench, with the least sum of |f_i|^2 / weight_i; leading axis leg.

    All in one upright frame, `feet` [m] from the point the moment is about; weight 0 is a foot in the air, at least three feet
    must have a positive one. `tangential` < 1 makes force across the vertical that much dearer: feet at different heights then
    do not push against each other, as in paper A's f_x = 0. With A = diag(tangential, tangential, 1), r_i the feet from their
    weighted centroid and M the moment about it, f_i = weight_i (F / sum of weights + A (y x r_i)), sum_i weight_i r_i x A (y x
    r_i) = M.
    """
    share = 1.0 / jnp.sum(weight, axis=0)
    centre = summed(feet * weight) * share
    arm = jax.vmap(lambda foot: foot - centre)(feet)
    lean = _lean(arm, weight, tangential, wrench.moment - centre.cross(wrench.force))
    pressed = wrench.force * share

    def force(arm, weight):
        leans = lean.cross(arm)
        return (pressed + Vector(tangential * leans.x, tangential * leans.y, leans.z)) * weight

    return jax.vmap(force)(arm, weight)


def _lean(arm: Vector, weight, tangential: float, moment: Vector) -> Vector:
    """The y of `share_load`: a symmetric system of three, by cofactors."""
    x, y, z = arm.x, arm.y, arm.z
    xx, yy, zz = tangential * z * z + y * y, tangential * z * z + x * x, tangential * (x * x + y * y)
    entries = (xx, yy, zz, -x * y, -tangential * x * z, -tangential * y * z)
    xx, yy, zz, xy, xz, yz = (jnp.sum(weight * entry, axis=0) for entry in entries)
    first, second, third = Vector(xx, xy, xz), Vector(xy, yy, yz), Vector(xz, yz, zz)
    columns = second.cross(third), third.cross(first), first.cross(second)
    return (columns[0] * moment.x + columns[1] * moment.y + columns[2] * moment.z) * (1.0 / first.dot(columns[0]))


def torques_on_ground(
    robot: Robot, folds: Fold, motion: Motion, weight: Float[Array, "leg *n"], to_world: Rows
) -> tuple[Float[Array, "leg joint *n"], Vector]:
    """Joint torques [N m] of a motion on the ground, and the contact forces [N] in W, leading axis leg.

    Full inverse dynamics: links' weight and inertia, reflected rotors, joint loss, and tau = -J^T f (paper A III.B with the
    sign of the motors). `weight` shares the load among the feet, see `share_load`; `to_world` turns B into W.
    """
    torque, wrench = apart(inverse_dynamics)(robot, folds, motion)
    turned = jax.vmap(to_world.times)
    wrench = Wrench(to_world.times(wrench.force), to_world.times(wrench.moment))
    force = apart(lambda *on: share_load(*on, TANGENTIAL))(turned(feet_in_b(robot, folds)), weight, wrench)

    def loaded(axis, offset, fold, torque, force):
        chain, force = chain_of(offset, fold), into_plane(fold.roll, to_world.turned_round_times(force))
        hip, thigh = chain.foot.cross(force), (chain.thigh + chain.shank).cross(force)
        return torque - _on_joints(axis, hip.x, thigh.y, chain.shank.cross(force).y)

    return jax.vmap(apart(loaded))(robot.joint_axis, robot.link_offset, folds, torque, force), force
