"""Learning weights: the losses are their formulas, and a planted expert's order is found again."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.foothold.learned import differences, learn, leg_weights, listwise_loss, pairwise_accuracy, pairwise_loss
from jaxleg.settings import dump, load
from jaxleg.terrain.foothold_cost import LegWeights

HAND = np.array([0.3, 0.02, 0.25, 0.1, 0.03, 0.2, 0.0, 0.1])
SIGNED = np.array([0.3, -0.02, 0.25, -0.1, 0.03, 0.2, 0.0, -0.1])
pairs_of, accuracy = jax.jit(differences), jax.jit(pairwise_accuracy)
fit_pairs = jax.jit(lambda table: learn(pairwise_loss, differences(table)))
fit_rankings = jax.jit(lambda table, signed: learn(listwise_loss, table, signed=signed), static_argnums=1)


def expert(weight, seed, noise=0.0, sets=300, candidates=6):
    """Candidates ranked by a planted weight, best first; the noise is that of the model, in units of cost."""
    rng = np.random.default_rng(seed)
    features = rng.uniform(size=(sets, candidates, 8)) ** 2
    cost = features @ weight - noise * rng.gumbel(size=(sets, candidates))
    return np.take_along_axis(features, np.argsort(cost, axis=1)[:, :, None], axis=1)


def test_losses_are_their_formulas():
    table, slope = expert(HAND, 0, sets=5, candidates=4), 3.0 * HAND
    pairs = [(s, i, j) for s in range(5) for i, j in itertools.combinations(range(4), 2)]
    expected = np.mean([math.log1p(math.exp(-slope @ (table[s, j] - table[s, i]))) for s, i, j in pairs])
    np.testing.assert_allclose(jax.jit(pairwise_loss)(slope, pairs_of(table)), expected, rtol=1e-12)
    chances = [
        math.prod(math.exp(-slope @ row[k]) / sum(math.exp(-slope @ x) for x in row[k:]) for k in range(4)) for row in table
    ]
    np.testing.assert_allclose(jax.jit(listwise_loss)(slope, table), -np.mean(np.log(chances)), rtol=1e-12)


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("fit", [fit_pairs, lambda table: fit_rankings(table, False)], ids=["pairs", "rankings"])
def test_a_planted_expert_is_found_again(fit, noise):
    learned = jax.tree.map(np.asarray, fit(expert(HAND, 0, noise)))
    held_out = pairs_of(expert(HAND, 1))
    assert accuracy(learned.weight, held_out) >= 0.95
    assert accuracy(np.full(8, 0.125), held_out) < 0.9
    assert np.all(learned.weight >= 0.0)
    np.testing.assert_allclose(np.sum(learned.weight), 1.0, rtol=1e-12)
    assert learned.loss[-1] < learned.loss[0]


def test_the_sharpness_is_the_expert_s():
    learned = fit_rankings(expert(HAND, 2, noise=0.1), False)
    np.testing.assert_allclose(learned.sharpness, 10.0, rtol=0.1)
    np.testing.assert_allclose(learned.weight, HAND, atol=0.03)


def test_signed_weights():
    learned = fit_rankings(expert(SIGNED, 0), True)
    assert accuracy(learned.weight, pairs_of(expert(SIGNED, 1))) >= 0.95
    np.testing.assert_allclose(np.sign(learned.weight)[[0, 2, 3, 5, 7]], np.sign(SIGNED)[[0, 2, 3, 5, 7]])
    np.testing.assert_allclose(np.sum(np.abs(learned.weight)), 1.0, rtol=1e-12)


def test_ties_count_as_half():
    assert accuracy(np.array([1.0, 0.0]), np.array([[0.0, 1.0], [1.0, 0.0], [-1.0, 0.0], [2.0, 0.0]])) == 0.625


def test_weights_come_back_from_a_file(tmp_path):
    saved = leg_weights(jnp.asarray(HAND), jnp.asarray(np.full(8, 0.125)))
    dump(saved, tmp_path / "weights.toml")
    assert load(LegWeights, tmp_path / "weights.toml") == saved
    np.testing.assert_allclose(saved.table(), [HAND, HAND, np.full(8, 0.125), np.full(8, 0.125)], rtol=1e-12)
