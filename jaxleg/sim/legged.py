"""The engine written out for a trunk with four legs of three joints: the same terms as MJX's, in an eighth of the operations.

The mass matrix is that of composite bodies (Featherstone 2008, chapter 6): a column is the momentum that a unit speed of its
joint gives to the links it carries. The bias is what Newton-Euler needs without any acceleration. Everything is in the
trunk's frame B, about its origin; only the trunk's linear velocity is in W. The robot may be traced, so that energy in
simulation has gradients by its numbers, too.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.conventions import GRAVITY
from jaxleg.leg.dynamics import Motion, all_folds, all_leg_frames, centre_of_mass, newton_euler
from jaxleg.leg.kinematics import LegFrames, carried_sum, foot_jacobian
from jaxleg.leg.moving import Moving
from jaxleg.numerics import cross, cross_matrix, dot, matmul, matvec
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.engine import Engine, Terms
from jaxleg.vectors import vector


def legged_engine(robot: Robot) -> Engine:
    """The engine of a robot; its numbers may be tracers."""

    def terms(q: Float[Array, "19"], v: Float[Array, "18"]) -> Terms:
        """The terms at a configuration and velocity of one lane."""
        turn, angles = rotation_from_quaternion(q[3:7]), q[7:].reshape(4, 3)
        frames = all_leg_frames(robot, angles)
        leg = jax.vmap(_leg_momenta)(frames, robot.hip_position, robot.link_com, robot.link_mass, robot.link_inertia)
        folds = all_folds(robot, angles)
        torque, wrench = newton_euler(robot, folds, _at_rest_in_w(turn, v))
        feet, by_leg = robot.hip_position + frames.foot, jax.vmap(foot_jacobian)(frames)
        turns = jnp.broadcast_to(turn, (4, 3, 3))
        return Terms(
            trunk=_trunk_block(robot, turn, leg),
            coupling=jnp.concatenate([matmul(turns, leg.linear), leg.angular], axis=1),
            legs=leg.own + robot.rotor_inertia[:, :, None] * jnp.eye(3, dtype=q.dtype)[None],
            trunk_bias=jnp.concatenate([matvec(turn, wrench.force.array()), wrench.moment.array()]),
            leg_bias=torque,
            foot=q[None, :3] + matvec(turn, feet),
            foot_by_trunk=jnp.concatenate(
                [jnp.broadcast_to(jnp.eye(3, dtype=q.dtype), turns.shape), -matmul(turns, cross_matrix(feet))], axis=2
            ),
            foot_by_leg=matmul(turns, by_leg),
            com=q[:3] + matvec(turn, centre_of_mass(robot, folds).array()),
        )

    return terms


def _at_rest_in_w(turn: Float[Array, "3 3"], v: Float[Array, "18"]) -> Motion:
    """The motion without any acceleration but that against gravity."""
    trunk = Moving(vector(v[3:6]), vector(jnp.zeros(3, v.dtype)), vector(GRAVITY * turn[2]))
    return Motion(v[6:].reshape(4, 3), jnp.zeros((4, 3), v.dtype), trunk)


class _Leg(NamedTuple):
    """Momenta of one leg about B's origin by the unit speed of each joint (columns), and of all of it as one rigid body."""

    linear: Float[Array, "3 joint"]
    angular: Float[Array, "3 joint"]
    own: Float[Array, "joint joint"]  # the leg's block of the mass matrix
    mass: Float[Array, ""]
    first: Float[Array, "3"]  # mass times place of its centre
    inertia: Float[Array, "3 3"]  # about B's origin


def _leg_momenta(frames: LegFrames, hip, com, mass, inertia) -> _Leg:
    place = hip[None] + frames.origin + matvec(frames.rotation, com)
    moments = mass[:, None] * place
    turned = matmul(frames.rotation * inertia[:, None, :], jnp.swapaxes(frames.rotation, -1, -2))
    about = turned - mass[:, None, None] * _squared(place)
    carried, moments, about = carried_sum(mass), carried_sum(moments), carried_sum(about)
    moving = cross(hip[None] + frames.origin, frames.axis)  # what goes through B's origin with each joint's turn
    linear = carried[:, None] * moving + cross(frames.axis, moments)
    angular = matvec(about, frames.axis) + cross(moments, moving)
    lower = dot(frames.axis[None], angular[:, None]) + dot(moving[None], linear[:, None])  # row: joint that carries
    own = jnp.where(jnp.tri(3, dtype=bool), lower, lower.T)
    return _Leg(linear.T, angular.T, own, carried[0], moments[0], about[0])


def _squared(arm):
    """cross_matrix(arm) squared."""
    square = jnp.sum(arm * arm, axis=-1)[:, None, None] * jnp.eye(3, dtype=arm.dtype)[None]
    return arm[:, :, None] * arm[:, None, :] - square


def _trunk_block(robot: Robot, turn: Float[Array, "3 3"], leg: _Leg) -> Float[Array, "6 6"]:
    """Mass matrix of the whole robot as one rigid body, linear in W, angular in B."""
    arm = robot.trunk_com[None]
    own = jnp.diag(robot.trunk_inertia) - robot.trunk_mass * _squared(arm)[0]
    mass, inertia = robot.trunk_mass + jnp.sum(leg.mass), own + jnp.sum(leg.inertia, axis=0)
    across = matmul(cross_matrix(robot.trunk_mass * robot.trunk_com + jnp.sum(leg.first, axis=0)), turn.T)
    linear = mass * jnp.eye(3, dtype=turn.dtype)
    return jnp.concatenate([jnp.concatenate([linear, across.T], axis=1), jnp.concatenate([across, inertia], axis=1)])
