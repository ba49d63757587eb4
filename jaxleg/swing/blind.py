"""A blind swing: the machine driven segment by segment against a terrain profile that only the foot feels. Paper B, IV.A.

One swing; `vmap` it over terrains and machines. No reverse mode: the course of a swing is a `while_loop`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.swing.arc import first_touch, length_to, point_at, skin
from jaxleg.swing.machine import Machine, Mode, Sensed, Step, begin, segment, transition
from jaxleg.swing.profile import Profile

SEGMENTS = 2000  # of one swing; then it has stalled


class Swing(NamedTuple):
    """How a swing went."""

    exit: Int[Array, ""]  # Mode.SUPPORTED, RETURNED or STALLED
    point: Float[Array, "2"]  # where it ended
    length: Float[Array, ""]  # of its path, a return included
    adjustments: Int[Array, ""]  # carried out; the return is none
    collisions: Int[Array, ""]  # contacts that were no support
    segments: Int[Array, ""]
    lost: Bool[Array, ""]  # a contact search was given up
    struck: Bool[Array, ""]  # the return, which does not feel, went through terrain


def blind_swing(machine: Machine, step: Step, profile: Profile) -> Swing:
    """Swing from the start of a step until an exit is reached."""
    lifted = jnp.stack([step.start[0], step.start[1] + skin(step.start.dtype)])
    step = step._replace(start=lifted)
    zero, no = jnp.zeros((), jnp.int32), jnp.array(False)
    first = (begin(step), Swing(zero, lifted, jnp.zeros((), lifted.dtype), zero, zero, zero, no, no))

    def going(carry):
        return carry[0].mode < Mode.SUPPORTED

    def advance(carry):
        state, swing = carry
        arc = segment(machine, step, state)
        touch = first_touch(arc, profile)
        deaf = state.mode >= Mode.RETURN_UP
        share = jnp.where(deaf, arc.end, touch.share)
        point = point_at(arc, share) + jnp.stack([0.0 * share, jnp.where(touch.hit & ~deaf, skin(share.dtype), 0.0)])
        after = transition(machine, step, state, Sensed(point, touch.hit & ~deaf, touch.slope))
        gives_up = (touch.lost & ~deaf) | ((swing.segments + 1 >= SEGMENTS) & (after.mode < Mode.SUPPORTED))
        after = after._replace(mode=jnp.where(gives_up, Mode.STALLED, after.mode))
        return after, Swing(
            after.mode,
            point,
            swing.length + length_to(arc, share),
            after.adjustments,
            swing.collisions + (touch.hit & ~deaf & (after.mode != Mode.SUPPORTED)),
            swing.segments + 1,
            swing.lost | touch.lost,
            swing.struck | (deaf & touch.hit),
        )

    _, swing = jax.lax.while_loop(going, advance, first)
    return swing
