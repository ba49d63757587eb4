"""Motion within a phase: where trunk and feet are at a share of it, and who carries load. Paper A, IV.C; B, eq. (2)."""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.gait.phases import Moves, Phases
from jaxleg.numerics import smoothstep
from jaxleg.swing.flight import fly


def trunk_path(phase: Moves | Phases, share: Float[ArrayLike, "*n"]) -> Float[Array, "6 *n"]:
    """Trunk pose (x, y, z, pitch, roll, yaw) at a share of one phase: rest to rest with minimum jerk.

    As all of this module also for many instants at once, which the phase's numbers then have in a last axis.
    """
    return phase.trunk_from + (phase.trunk_to - phase.trunk_from) * smoothstep(share)[None]


def foot_path(
    phase: Moves | Phases, share: Float[ArrayLike, "*n"], load_share: Float[ArrayLike, ""]
) -> Float[Array, "leg 3 *n"]:
    """Foot centres in W [m] at a share of one phase; the foot moves once its load has been taken over by the others."""
    inner = jnp.clip((jnp.asarray(share) - load_share) / (1.0 - 2.0 * load_share), 0.0, 1.0)
    swings = phase.swings[:, None]
    start, end = (jnp.sum(swings * feet, axis=0) for feet in (phase.feet_from, phase.feet_to))
    return jnp.where(swings > 0.0, fly(start, end, phase.flight, inner)[None], phase.feet_to)


def load_weight(
    phase: Moves | Phases, share: Float[ArrayLike, "*n"], load_share: Float[ArrayLike, ""]
) -> Float[Array, "leg *n"]:
    """Weight of each foot in `share_load`: 1 standing, 0 in the air, a smooth transfer at either end of a swing."""
    share = jnp.asarray(share)
    outer = jnp.minimum(share, 1.0 - share) / load_share
    return 1.0 - phase.swings * smoothstep(outer)[None]
