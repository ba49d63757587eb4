"""Foothold weights learned from an expert's ranked choices. Paper C, (13), which cites learning from an expert.

With the cost w . x of a candidate of features x and a sharpness b > 0, the expert is modelled as

    pairs (Bradley-Terry)       P(better before worse) = sigmoid(b (w . x_worse - w . x_better))
    rankings (Plackett-Luce)    P(ranking) = prod_k exp(-b w . x_k) / sum_{l >= k} exp(-b w . x_l), best first

and w, b maximise the likelihood. Weights are not negative and sum to 1, as `FootWeights` has them, or are signed with absolute
values that sum to 1. Files of weights are `LegWeights`, by `settings.dump` and `settings.load`.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.conventions import LEG_END, LEGS
from jaxleg.numerics import foreign
from jaxleg.settings import build
from jaxleg.terrain.foothold_cost import LegWeights

Loss = Callable[[Float[Array, "feature"], Float[Array, "..."]], Float[Array, ""]]


class Learned(NamedTuple):
    """Weights that fit a table of choices."""

    weight: Float[Array, "feature"]
    sharpness: Float[Array, ""]  # b: how surely the expert chooses
    loss: Float[Array, "step"]  # on the way there


def differences(rankings: Float[Array, "set rank feature"]) -> Float[Array, "pair feature"]:
    """Features of the worse less those of the better candidate, of every pair of each ranking (best first)."""
    better, worse = np.triu_indices(rankings.shape[1], 1)
    return (rankings[:, worse] - rankings[:, better]).reshape(-1, rankings.shape[2])


def pairwise_loss(slope: Float[Array, "feature"], pairs: Float[Array, "pair feature"]) -> Float[Array, ""]:
    """Mean negative logarithm of the likelihood of pairs (see `differences`); `slope` is b w."""
    return jnp.mean(jax.nn.softplus(-jnp.sum(pairs * slope[None], axis=-1)))


def listwise_loss(slope: Float[Array, "feature"], rankings: Float[Array, "set rank feature"]) -> Float[Array, ""]:
    """Mean negative logarithm of the likelihood of rankings, best first; `slope` is b w."""
    taste = -jnp.sum(rankings * slope[None, None], axis=-1)
    left = jax.lax.cumlogsumexp(taste, axis=1, reverse=True)
    return jnp.mean(jnp.sum(left - taste, axis=1))


def learn(
    loss: Loss, table: Float[Array, "..."], steps: int = 400, rate: Float[ArrayLike, ""] = 0.1, signed: bool = False
) -> Learned:
    """Weights that make `loss` (pairwise or listwise) least on its table, by Adam from equal weights; jittable."""
    optimiser = optax.adam(optax.cosine_decay_schedule(rate, steps, alpha=0.01))
    features = table.shape[-1]
    start = (jnp.full(features, 1.0 / features, table.dtype), jnp.zeros((), table.dtype))

    def objective(free):
        return loss(jnp.exp(free[1]) * _weight(free[0], signed), table)

    def step(carry, _):
        free, moments = carry
        value, gradient = jax.value_and_grad(objective)(free)
        with foreign():
            update, moments = optimiser.update(gradient, moments)
            return (optax.apply_updates(free, update), moments), value

    (free, _), values = jax.lax.scan(step, (start, optimiser.init(start)), length=steps)
    return Learned(_weight(free[0], signed), jnp.exp(free[1]), values)


def _weight(free, signed: bool):
    return free / jnp.sum(jnp.abs(free)) if signed else jax.nn.softmax(free)


def pairwise_accuracy(weight: Float[Array, "feature"], pairs: Float[Array, "pair feature"]) -> Float[Array, ""]:
    """Share of pairs (see `differences`) that a weight puts in the expert's order; a tie counts as half."""
    margin = jnp.sum(pairs * weight[None], axis=-1)
    return jnp.mean(0.5 * (1.0 + jnp.sign(margin)))


def leg_weights(front: Float[Array, "8"], hind: Float[Array, "8"]) -> LegWeights:
    """Learned weights as a table of a TOML file, the same for left and right legs. Raises `InputError`
    for negative ones, or a sum that is not 1.
    """
    rows = {leg: np.asarray(front if end > 0 else hind).tolist() for leg, end in zip(LEGS, LEG_END)}
    return build(LegWeights, rows, "learned weights")
