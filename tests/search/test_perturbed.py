"""Perturbed gradients against the slope of a staircase and the closed form of a polynomial."""

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from jaxleg.search.perturbed import perturbed, signed

STEPS = jnp.array([0.3, 0.1, 0.2])


def estimates(objective, count, **lanes):
    """Each lane's estimate at (0.2, -0.4, 0.1)."""
    at, moves = jnp.array([0.2, -0.4, 0.1]), signed(jax.random.key(0), count, STEPS)
    return np.asarray(jax.vmap(lambda move, lane: perturbed(lambda x: objective(x, **lane), at, move))(moves, lanes))


def test_moves_are_the_steps_to_either_side():
    moves = np.asarray(signed(jax.random.key(1), 4000, STEPS))
    assert_allclose(np.abs(moves), np.tile(STEPS, (4000, 1)), rtol=1e-15)
    assert np.abs(np.corrcoef(np.sign(moves).T) - np.eye(3)).max() < 0.06
    assert np.abs(np.mean(np.sign(moves), axis=0)).max() < 0.06


def test_a_staircase_has_the_slope_of_its_mean():
    """Each lane's stairs begin at a random place of their tread: no lane has a gradient, the mean has the ramp's."""
    slope, tread = np.array([2.0, -1.0, 0.5]), np.array([0.25, 0.15, 0.07])
    begin = jnp.asarray(np.random.default_rng(0).random((40_000, 3)))

    def stairs(x, begin):
        return jnp.sum(slope * tread * jnp.floor(x / tread + begin))

    seen = estimates(stairs, 40_000, begin=begin)
    error = seen.std(axis=0) / np.sqrt(len(seen))
    assert np.all(error < 0.08)
    assert np.all(np.abs(seen.mean(axis=0) - slope) < 3.0 * error)


def test_a_parabola_is_exact_in_the_mean():
    """Of x A x the estimate is the gradient's own element, and others' times the ratio of moves, which have no mean."""
    a = np.array([[1.0, 0.4, -0.2], [0.4, -2.0, 0.3], [-0.2, 0.3, 0.7]])
    gradient = 2.0 * a @ np.array([0.2, -0.4, 0.1])
    moves = np.asarray(signed(jax.random.key(0), 8, STEPS))
    assert_allclose(estimates(lambda x: x @ a @ x, 8), (moves @ gradient)[:, None] / moves, rtol=1e-12)
