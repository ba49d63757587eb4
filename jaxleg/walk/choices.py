"""The discrete part of a plan: which footholds and which poses, and how far. No gradient; the walk has it with these held."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxleg.status import Status


class Choices(NamedTuple):
    """Offsets from the nominal footholds and adjustments of the poses: neither knows the world, so that a foothold moves with
    step, stance, skew and route. Padded to whole cycles; the first `count` steps are walked."""

    offset: Float[Array, "stance leg 2"]  # (ahead, left) of the station's heading [m]; stance 0 is where the walk begins
    found: Int[Array, "stance leg"]  # FootholdStatus
    adjust: Int[Array, "step 3"]  # steps away from the default height, pitch and roll
    count: Int[Array, ""]  # steps
    status: Int[Array, ""]  # Status


def no_choice(cycles: int, dtype: jnp.dtype) -> Choices:
    """Every foot at its nominal foothold, every pose the default."""
    steps, zero = 4 * cycles, jnp.zeros((), jnp.int32)
    offset, found = jnp.zeros((cycles + 1, 4, 2), dtype), jnp.zeros((cycles + 1, 4), jnp.int32)
    return Choices(offset, found, jnp.zeros((steps, 3), jnp.int32), zero + steps, zero + Status.OK)
