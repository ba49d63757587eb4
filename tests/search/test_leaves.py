"""A planner's numbers by name: read, replaced, differentiated, and refused with the nearest name."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.search.leaves import leaf_names, read_leaves, with_leaves
from jaxleg.walk.config import Navigation
from jaxleg.walk.presets import paper_c
from tests.crawls import gait

NAMES = ("gait.workspace.high", "posture.cog.ratio", "series.adjustments.height", "route.turn")


@pytest.fixture(scope="module")
def planner():
    return paper_c(Navigation(), gait(0.46), 0.1, 0.03, 0.04)


def test_every_real_number_has_a_name(planner):
    names = leaf_names(planner)
    assert set(NAMES) <= set(names)
    assert len(names) == len(set(names))
    assert "series.budget" not in names  # an integer
    assert len(names) == sum(jnp.issubdtype(x.dtype, jnp.floating) for x in jax.tree.leaves(planner))


def test_what_is_put_in_is_read_and_nothing_else_changes(planner):
    values = jnp.asarray([0.5, 0.25, 0.02, 0.3])
    moved = with_leaves(planner, NAMES, values)
    np.testing.assert_array_equal(read_leaves(moved, NAMES), values)
    others = [name for name in leaf_names(planner) if name not in NAMES]
    np.testing.assert_array_equal(read_leaves(moved, others), read_leaves(planner, others))


def test_it_is_differentiable(planner):
    slope = jax.grad(lambda v: jnp.sum(read_leaves(with_leaves(planner, NAMES, v), NAMES) ** 2))(jnp.arange(4.0))
    np.testing.assert_allclose(slope, 2.0 * np.arange(4.0))


def test_an_unknown_name_is_refused_with_the_nearest(planner):
    with pytest.raises(InputError, match=r"gait\.workspace\.hihg.*did you mean gait\.workspace\.high\?"):
        read_leaves(planner, ["gait.workspace.hihg"])
    with pytest.raises(InputError, match="there are: "):
        read_leaves(planner, ["wings"])
