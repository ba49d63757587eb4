"""Where the body may go: each limit just kept and just passed, and costs worked out by hand."""

import jax
import numpy as np
import pytest

from jaxleg.terrain import body_cost as module
from jaxleg.terrain.body_cost import BodyFeatures, BodyWeights

body_cost, traversable = jax.jit(module.body_cost, static_argnums=2), jax.jit(module.traversable)
WEIGHTS = BodyWeights(np.array([2.0, 2.0, 1.0]) / 3.0, np.array([0.6, 0.16, 0.2]), 0.12, 0.5)


def one_cell(slope=0.3, roughness=0.04, step=0.1, seen=1.0):
    return BodyFeatures(*(np.full((1, 1), x) for x in (slope, roughness, step, seen)))


def cost_of(combine="norm", weights=WEIGHTS, **changes):
    """Of one cell; whether it can be gone is the same question."""
    features = one_cell(**changes)
    cost = np.asarray(body_cost(features, weights, combine)).item()
    assert np.asarray(traversable(features, weights)).item() == np.isfinite(cost)
    return cost


def test_costs_by_hand():
    """Shares 1/2, 1/4, 1/2 of the greatest values, weights 2/3, 2/3, 1/3."""
    assert cost_of() == pytest.approx(np.sqrt(1 / 9 + 1 / 36 + 1 / 36))
    assert cost_of("linear") == pytest.approx(2 / 9 + 1 / 9 + 1 / 18)
    assert cost_of(slope=0.9, roughness=0.0, step=0.0) == pytest.approx(2 / 3)  # clipped
    assert cost_of(slope=0.0, roughness=0.16, step=0.0) == pytest.approx(2 / 3)
    assert cost_of(slope=0.0, roughness=0.0, step=0.1) == pytest.approx(1 / 6)


@pytest.mark.parametrize("combine", ["norm", "linear"])
def test_a_step_just_above_the_threshold_cannot_be_gone_and_one_at_it_can(combine):
    assert np.isfinite(cost_of(combine, step=0.12))
    assert np.isinf(cost_of(combine, step=0.12 + 1e-9))
    assert np.isinf(cost_of(combine, step=0.3))


def test_enough_of_the_disc_must_be_seen():
    assert np.isfinite(cost_of(seen=0.5))
    assert np.isinf(cost_of(seen=0.5 - 1e-9))


@pytest.mark.parametrize("name", ["slope", "roughness", "step"])
def test_what_is_not_known_cannot_be_gone(name):
    assert np.isinf(cost_of(**{name: np.nan}))


@pytest.mark.parametrize("name", ["slope", "roughness"])
def test_slope_and_roughness_are_dear_but_never_forbid(name):
    assert cost_of(**{name: 1.5}) == cost_of(**{name: WEIGHTS.limit[0]}) < 1.0
