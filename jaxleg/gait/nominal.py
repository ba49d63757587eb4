"""Where the feet stand nominally. Paper A, IV.A, Fig. 6a (A7)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.conventions import LEG_END, LEG_SIDE
from jaxleg.gait.params import GaitParams


def nominal_stances(params: GaitParams, first: int, count: int) -> Float[Array, "stance leg 2"]:
    """Nominal footholds (x, y) [m] of stances first, first+1, ... before the right legs swing; stance 0 is round x = 0.

    Paper A, Fig. 6a: a parallelogram of L_Stance x W_Stance, left feet ahead of right ones by L_Skew, moving on by L_Step a
    cycle. Before the left legs swing the offset is L_Skew - L_Step.
    """
    dtype = params.step_length.dtype
    end, side = jnp.asarray([LEG_END], dtype), jnp.asarray([LEG_SIDE], dtype)
    x = 0.5 * (end * params.stance_length + side * params.skew)
    y = 0.5 * side * params.stance_width
    advance = jnp.arange(first, first + count, dtype=dtype)[:, None] * params.step_length
    return jnp.stack([x + advance, jnp.broadcast_to(y, (count, y.shape[1]))], axis=-1)
