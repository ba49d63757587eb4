"""The open loop: the joint controllers follow a reference that was interpolated between its samples before the walk."""

import jax.numpy as jnp

from jaxleg.control.contract import Controller, Reading, Tracking
from jaxleg.pytree import pytree
from jaxleg.walk.data import Reference


@pytree
class OpenLoop(Controller[tuple[()], Tracking]):
    """Commands what its row says; remembers nothing and ends with its rows."""

    def start(self) -> tuple[()]:
        """No memory."""
        return ()

    def command(self, memory: tuple[()], sensed: Reading, row: Tracking) -> tuple[Tracking, tuple[()]]:
        """The row itself."""
        return row, memory


def interpolate(reference: Reference, steps: int) -> Tracking:
    """Controller inputs at `steps` equal steps in each interval of the reference.

    Positions follow by cubic Hermite interpolation, velocities and torques linearly.
    """
    dtype = reference.time.dtype
    step, interval = jnp.arange(steps, dtype=dtype), jnp.diff(reference.time)

    def between(values, share):
        share = share[None, :, None, None]
        return (values[:-1, None] * (1.0 - share) + values[1:, None] * share).reshape(-1, 4, 3)

    return Tracking(
        position=_hermite(reference, interval[:, None, None, None], step / steps),
        velocity=between(reference.joint_vel, (step + 1.0) / steps),
        torque=between(reference.joint_torque, (step + 0.5) / steps),
        dt=jnp.repeat(interval / steps, steps),
    )


def _hermite(reference, interval, share):
    s = share[None, :, None, None]
    start, end = reference.joint_pos[:-1, None], reference.joint_pos[1:, None]
    rise, fall = reference.joint_vel[:-1, None] * interval, reference.joint_vel[1:, None] * interval
    blend = s * s * (3.0 - 2.0 * s)
    position = start + (end - start) * blend + s * (1.0 - s) * ((1.0 - s) * rise - s * fall)
    return position.reshape(-1, 4, 3)
