"""The open loop: the joint controllers follow a reference that was interpolated between its samples before the walk."""

import jax
import jax.numpy as jnp

from jaxleg.control.contract import Controller, Reading, Tracking
from jaxleg.pytree import pytree
from jaxleg.walk.between import at_share
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
    """Controller inputs at `steps` equal steps in each interval of the reference; see `walk.between`."""
    low, high = (jax.tree.map(lambda x, part=part: x[part], reference) for part in (slice(-1), slice(1, None)))
    each = jax.vmap(jax.vmap(at_share, in_axes=(None, None, 0)), in_axes=(0, 0, None))
    step = jnp.arange(steps, dtype=reference.time.dtype)
    start, middle, end = (each(low, high, (step + later) / steps) for later in (0.0, 0.5, 1.0))
    rows = (x.reshape(-1, 4, 3) for x in (start.joint_pos, end.joint_vel, middle.joint_torque))
    return Tracking(*rows, dt=jnp.repeat((high.time - low.time) / steps, steps))
