"""The proxy's gradient is true, in forward and reverse mode, and finite where the legs do not reach."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.leg.energy import electrical
from jaxleg.search.leaves import leaf_names, read_leaves, with_leaves
from jaxleg.status import Status
from jaxleg.walk.proxy import evaluate
from tests.crawls import crawl, gait, settings, terrain_of

pytestmark = pytest.mark.slow  # the proxy's gradient is long to compile

NAMES = [name for name in leaf_names(gait()) if name not in ("workspace.behind", "workspace.ahead", "workspace.low")]


@pytest.fixture(scope="module")
def cost(pegasus):
    terrain = terrain_of("rough")

    def energy(vector):
        params = with_leaves(gait(), NAMES, vector)
        walk = crawl(pegasus, params, settings(), terrain, jnp.zeros((3, 4, 2)), jnp.zeros((3, 4), jnp.int32))
        seen = evaluate(pegasus, walk)
        total = jax.tree.map(jnp.sum, seen.energy)
        return electrical(total, "positive") / seen.distance, seen.checks

    functions = energy, jax.grad(energy, has_aux=True), jax.jacfwd(lambda v: energy(v)[0])
    return tuple(jax.jit(function) for function in functions)


def vector(**changes):
    return read_leaves(gait(0.47, skew=0.08, hind=0.47, **changes), NAMES)


def test_reverse_is_forward_is_difference(cost):
    energy, gradient, forward = cost
    at = vector()
    reverse = gradient(at)[0]
    np.testing.assert_allclose(reverse, forward(at), rtol=1e-9, atol=1e-9)
    for i in range(len(NAMES)):
        h = 1e-6
        difference = (energy(at.at[i].add(h))[0] - energy(at.at[i].add(-h))[0]) / (2 * h)
        np.testing.assert_allclose(reverse[i], difference, rtol=2e-5, atol=2e-3, err_msg=NAMES[i])


@pytest.mark.parametrize("changes", [{"step": 0.9}, {"width": 1.6}])
def test_out_of_reach_is_a_status_with_a_finite_gradient(cost, changes):
    gradient, checks = cost[1](vector(**changes))
    assert checks.status == Status.KINEMATICS
    assert np.isfinite(gradient).all()
