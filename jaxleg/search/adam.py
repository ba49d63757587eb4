"""Descents on the proxy for many numbers: Adam from several starts of several searches, smooth bounds, minibatches of terrains.

For the gait's ten numbers `gauss_newton` is the better way by far. On the 47 of a mirrored free form it stops within a percent
of where it began, at 0.49 of the baseline, where this reaches 0.36: its models do not hold there, for reasons not yet found.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

from jaxleg.numerics import foreign
from jaxleg.search.lanes import Lab
from jaxleg.search.training import Lanes


class Adam(NamedTuple):
    """State of all descents of a kind of terrain; a pytree of arrays, saved at every checkpoint."""

    free: Float[Array, "run parameter"]  # unbounded coordinates
    moments: optax.OptState
    step: Int[Array, ""]


@jax.jit
def bounded(free: Float[Array, "*n parameter"], bounds: Float[Array, "*n parameter 2"]) -> Float[Array, "*n parameter"]:
    """Parameters strictly inside their bounds from unbounded coordinates: a logistic on each."""
    low, high = bounds[..., 0], bounds[..., 1]
    return low + (high - low) * jax.nn.sigmoid(free)


@functools.partial(jax.jit, static_argnames="least")
def unbounded(
    vector: Float[Array, "*n parameter"], bounds: Float[Array, "*n parameter 2"], least: float = 0.05
) -> Float[Array, "*n parameter"]:
    """Inverse of `bounded`; a parameter nearer than `least` (a share of the range) to a bound is moved off it."""
    low, high = bounds[..., 0], bounds[..., 1]
    width = jnp.where(high > low, high - low, 1.0)
    share = jnp.clip((vector - low) / width, least, 1.0 - least)
    return jnp.where(high > low, jnp.log(share) - jnp.log1p(-share), 0.0)


@jax.jit
def free_gradient(free: Float[Array, "*n parameter"], bounds, gradient) -> Float[Array, "*n parameter"]:
    """Gradient in the unbounded coordinates from that in the parameters."""
    share = jax.nn.sigmoid(free)
    return gradient * (bounds[..., 1] - bounds[..., 0]) * share * (1.0 - share)


@functools.cache  # equal ones are one, so that what they are static arguments of compiles once
def make_optimiser(rate: float, steps: int) -> optax.GradientTransformation:
    """Adam whose rate falls to a tenth along a cosine: the last steps settle between the penalties' walls."""
    return optax.adam(optax.cosine_decay_schedule(rate, steps, alpha=0.1))


@functools.partial(jax.jit, static_argnums=(3, 4))
def start(
    key: Array,
    known: Float[Array, "known parameter"],
    bounds: Float[Array, "run parameter 2"],
    starts: int,
    optimiser: optax.GradientTransformation,
) -> Adam:
    """First state: each search begins at the known parameter sets (as far as its bounds and `starts` allow), then at random."""
    runs = bounds.shape[0]
    free = jax.random.normal(key, (runs, bounds.shape[1]), bounds.dtype) * 1.2
    for i in range(min(starts, known.shape[0])):
        span = bounds[i::starts]
        free = free.at[i::starts].set(unbounded(jnp.broadcast_to(known[i], span.shape[:-1]), span))
    with foreign():
        return Adam(free, optimiser.init(free), jnp.zeros((), jnp.int32))


def descend(
    lab: Lab,
    lanes: Lanes,
    bounds: Float[Array, "run parameter 2"],
    state: Adam,
    per_step: int,
    optimiser: optax.GradientTransformation,
) -> tuple[Adam, np.ndarray]:
    """One optimiser step of all runs on the next `per_step` terrains, or all where there are fewer; returns the state and each
    run's mean objective.

    A lane whose gradient is not finite takes no part in the step; it is counted by the final ranking over all terrains.
    """
    runs, per_step = state.free.shape[0], min(per_step, lanes.number)
    index = (int(state.step) * per_step + np.arange(per_step)) % lanes.number
    some = lanes.take(np.tile(index, runs))
    vectors = np.repeat(np.asarray(bounded(state.free, bounds)), per_step, axis=0)
    score, gradient = lab.proxy_gradients(vectors, some.site, some.setting)
    usable = np.isfinite(gradient).all(axis=1) & np.isfinite(score.objective)
    gradient = np.where(usable[:, None], gradient, 0.0).reshape(runs, per_step, -1).mean(axis=1)
    objective = np.where(usable, score.objective, np.inf).reshape(runs, per_step).mean(axis=1)
    return _advance(optimiser, state, bounds, gradient), objective


@functools.partial(jax.jit, static_argnums=0)
def _advance(optimiser, state, bounds, gradient):
    gradient = free_gradient(state.free, bounds, gradient)
    with foreign():
        update, moments = optimiser.update(gradient, state.moments)
        return Adam(optax.apply_updates(state.free, update), moments, state.step + 1)
