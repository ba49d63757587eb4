"""Gradients where a choice moves: of a mean over many terrains, by moving all numbers at once, to random sides on each.

Which cell is a foothold is chosen, so a terrain's objective is a staircase in what the choice depends on, such as the bounds of
the workspace; it is the mean over terrains that has a slope. Spall's simultaneous perturbation (1992) takes two evaluations of
the exact choice a terrain, however many numbers move: with signs s of +-1 drawn anew for each,

    (f(x + s h) - f(x - s h)) / (2 s h)

has the mean over s of the central differences of step h, to terms of h^2 in which numbers act upon each other. The steps h are
what a soft choice's temperature is: long ones hide what is between them, short ones need more terrains.
"""

from collections.abc import Callable

import jax
from jaxtyping import Array, Float, Key


def signed(key: Key[Array, ""], count: int, steps: Float[Array, "parameter"]) -> Float[Array, "lane parameter"]:
    """Moves for so many lanes: `steps`, each to a random side."""
    return steps[None] * jax.random.rademacher(key, (count, steps.shape[0]), steps.dtype)


def perturbed(
    objective: Callable[[Float[Array, "parameter"]], Float[Array, ""]],
    vector: Float[Array, "parameter"],
    move: Float[Array, "parameter"],
) -> Float[Array, "parameter"]:
    """One lane's estimate of the gradient; the mean over lanes is what it is for. No element of `move` may be 0."""
    return 0.5 * (objective(vector + move) - objective(vector - move)) / move
