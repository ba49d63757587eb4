"""The soft choice: it tends to the exact one, and its gradients are those of differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.foothold.cascade import Cascade
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.foothold.soft import Softness, soft_stance
from tests.crawls import gait
from tests.foothold.test_cascade import EXTENT, NOMINAL, rectangle, site

HARD = Softness(1e-5, 1e-7)


@pytest.fixture(scope="module")
def both(pegasus):
    """The soft choice and the exact one where the feet's mean may lie no further ahead than `bound` [m]."""

    @jax.jit
    def choose(weight, bound, softness, ground):
        cascade = Cascade(rectangle(w1=weight), jnp.asarray(0.0), EXTENT)
        stance = (pegasus, gait(), ground, jnp.asarray(NOMINAL), jnp.zeros(()), lambda feet: bound - jnp.mean(feet[:, 0]))
        return soft_stance(cascade, softness, *stance), cascade.stance(*stance)

    return choose


@pytest.mark.parametrize(("share", "bound"), [(0.8, np.inf), (0.8, -0.05), (0.5, -0.11), (0.8, -0.19), (0.3, -0.6)])
def test_it_tends_to_the_exact_choice(both, share, bound):
    """A common offset, one that the bound leaves, one of the lengthened rectangle, and each leg for itself."""
    for seed in range(4):
        ground = site(np.random.default_rng(seed).random((80, 50)) < share)
        soft, exact = both(0.45, bound - 1e-3, HARD, ground)  # between cells: nothing lies on the bound itself
        assert_allclose(soft.offset, exact.offset, atol=1e-6)
        assert (soft.status == FootholdStatus.NOMINAL).all() == (exact.status <= FootholdStatus.WIDENED).all()
        assert np.all(exact.offset[:, 0] + NOMINAL[:, 0].mean() <= bound) or np.all(exact.status == FootholdStatus.NEAREST)


def test_gradients_are_those_of_differences(both):
    ground, softness = site(np.random.default_rng(5).random((80, 50)) < 0.8), Softness(0.1, 0.01)
    ahead = jax.jit(lambda x: both(x[0], x[1], softness, ground)[0].offset[0])
    at, step = jnp.array([0.45, -0.05]), 1e-5
    difference = [(ahead(at + step * unit) - ahead(at - step * unit)) / (2.0 * step) for unit in np.eye(2)]
    assert np.all(np.abs(np.stack(difference)[:, 0]) > 1e-3)
    assert_allclose(jax.jit(jax.jacfwd(ahead))(at).T, difference, rtol=1e-5, atol=1e-9)
    assert_allclose(jax.jit(jax.jacrev(ahead))(at).T, difference, rtol=1e-5, atol=1e-9)


def test_two_feet_without_ground_have_no_nan_gradient(pegasus):
    """Where the front legs find no foothold their reach is not known: no common offset has any weight, nor a slope."""
    where = np.ones((80, 50), bool)
    where[40:] = False

    def total(high, ground):
        cascade, stance = Cascade(rectangle(w1=0.45), jnp.asarray(0.0), EXTENT), (jnp.asarray(NOMINAL), jnp.zeros(()))
        return jnp.sum(soft_stance(cascade, Softness(0.1, 0.01), pegasus, gait(height=high), ground, *stance).offset)

    ground = jax.tree.map(jnp.asarray, site(where))
    forward = jax.jit(lambda h: jax.jvp(lambda x: total(x, ground), (h,), (1.0,))[1])(0.48)
    reverse = jax.grad(total)(0.48, ground)  # not compiled: XLA would leave the NaN out
    assert np.isfinite(reverse)
    assert_allclose(reverse, forward, atol=1e-12)


def test_nothing_to_stand_on_is_no_nan(both):
    """Neither in the choice nor in its gradient."""
    ground = site(np.zeros((80, 50), bool))
    found, slope = jax.jit(jax.value_and_grad(lambda b: jnp.sum(both(0.45, b, Softness(0.1, 0.01), ground)[0].offset)))(0.1)
    assert found == slope == 0.0
    assert np.all(both(0.45, 0.1, HARD, ground)[0].status == FootholdStatus.NONE)
