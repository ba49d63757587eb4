"""A reference between two of its samples: linear, joint angles by cubic Hermite with their velocities as slopes."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.walk.data import Reference


def at_share(low: Reference, high: Reference, share: Float[Array | np.ndarray, "*n"]) -> Reference:
    """The reference at a share (0 to 1) of the interval between two samples, or of many: leading axes as `share`."""

    def over(x):
        return share.reshape(*share.shape, *[1] * (x.ndim - share.ndim))

    row = jax.tree.map(lambda a, b: a + over(a) * (b - a), low, high)
    s, interval = over(low.joint_pos), (high.time - low.time).reshape(over(low.joint_pos).shape)
    bow = s * (1.0 - s) * interval * ((1.0 - s) * low.joint_vel - s * high.joint_vel)
    blend = s * s * (3.0 - 2.0 * s)
    return row._replace(joint_pos=low.joint_pos + blend * (high.joint_pos - low.joint_pos) + bow)


def at_time(low: Reference, high: Reference, time: Float[Array, ""]) -> Reference:
    """The reference at a time [s] between two samples; outside, the nearer one."""
    interval = jnp.maximum(high.time - low.time, 1e-6)
    return at_share(low, high, jnp.clip((time - low.time) / interval, 0.0, 1.0))
