"""Rigid-body terms of the equation of motion, by MJX. The one interface that stands between a physics engine and the step.

An engine is a function `(q, v) -> Terms` for one lane. `mjx_engine` builds it from MJX's kinematics, inertia and bias
functions on a model made from the `Robot`; no MuJoCo contact takes part. Another engine only has to return the same terms:
`legged.legged_engine` writes them out, the same numbers in an eighth of the operations.
"""

import contextlib
import io
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

from jaxleg.numerics import cross, foreign
from jaxleg.robot import Robot
from jaxleg.robot.mjcf import robot_mjcf

with contextlib.redirect_stdout(io.StringIO()):  # MJX prints that its optional Warp back end is not there
    from mujoco import mjx
    from mujoco.mjx._src import smooth


class Terms(NamedTuple):
    """Terms of M dv/dt + bias = forces in blocks: the trunk's six degrees of freedom (linear in W, angular in B), the legs'."""

    trunk: Float[Array, "6 6"]
    coupling: Float[Array, "leg 6 3"]
    legs: Float[Array, "leg 3 3"]
    trunk_bias: Float[Array, "6"]
    leg_bias: Float[Array, "leg 3"]
    foot: Float[Array, "leg 3"]  # foot centres in W [m]
    foot_by_trunk: Float[Array, "leg 3 6"]  # Jacobians of the feet
    foot_by_leg: Float[Array, "leg 3 3"]
    com: Float[Array, "3"]  # centre of mass in W [m]


Engine = Callable[[Float[Array, "19"], Float[Array, "18"]], Terms]


def mjx_engine(robot: Robot) -> Engine:
    """The engine of MJX for a concrete robot (its leaves must be numbers, not tracers)."""
    spec = mujoco.MjModel.from_xml_string(robot_mjcf(robot))
    spec.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    with foreign():
        model, data = mjx.put_model(spec), mjx.make_data(spec)
    feet = jnp.arange(4)

    def terms(q: Float[Array, "19"], v: Float[Array, "18"]) -> Terms:
        """The terms at a configuration and velocity of one lane."""
        d = data.replace(qpos=q, qvel=v)
        with foreign():
            for stage in (smooth.kinematics, smooth.com_pos, smooth.crb, smooth.com_vel, smooth.rne):
                d = stage(model, d)
            mass, com = mjx.full_m(model, d), d.subtree_com[1]
        foot = d.site_xpos[feet]
        spin, linear = d.cdof[:, :3], d.cdof[:, 3:]
        arm = foot - com[None]

        def jacobian(dofs):  # column of a dof: its velocity at the foot
            moved = linear[dofs] + cross(*jnp.broadcast_arrays(spin[dofs], arm[:, None]))
            return jnp.swapaxes(moved, -1, -2)

        legs = 6 + jnp.arange(12).reshape(4, 3)
        blocks = jnp.stack([mass[6 + 3 * i : 9 + 3 * i, 6 + 3 * i : 9 + 3 * i] for i in range(4)])
        coupling = jnp.swapaxes(mass[:6, 6:].reshape(6, 4, 3), 0, 1)
        bias = d.qfrc_bias
        return Terms(
            *(mass[:6, :6], coupling, blocks, bias[:6], bias[6:].reshape(4, 3)),
            *(foot, jacobian(jnp.arange(6)[None]), jacobian(legs), com),
        )

    return terms
