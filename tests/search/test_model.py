"""What a lane's model keeps: the cost's line, the lines of the rows that may come lowest, exact values; and that a real lane's
model is what the proxy says of it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

from jaxleg.search.model import FREE, linearised

ROWS = 32


class Parts(NamedTuple):
    score: object
    cost: object
    rows: object


def parts(x):
    """A cost and two constraints: many rows that turn about at their own rates, and a single one."""
    rate = jnp.linspace(-1.0, 1.0, 50)
    rows = jnp.where(jnp.arange(50) == 7, jnp.inf, 0.1 + rate * x[0] + 0.01 * x[1] ** 2)
    return Parts(x[0] * x[1], jnp.sum(x**2), (rows, x[:1] - 3.0))


def model(at, reach):
    return jax.jit(lambda x, r: linearised(parts, x, r, ROWS))(jnp.asarray(at), jnp.asarray(reach))


def test_cost_and_rows_are_straight_lines_at_the_vector():
    seen = model([0.2, -1.0], [0.1, 0.1])
    assert_allclose(seen.cost, 1.04)
    assert_allclose(seen.slope, [0.4, -2.0])
    assert_allclose(seen.score, -0.2)
    assert seen.rows.shape == (2, ROWS)
    assert seen.slopes.shape == (2, ROWS, 2)
    rate = np.delete(np.linspace(-1.0, 1.0, 50), 7)
    lowest = np.sort(0.1 + rate * 0.2 + 0.01 - 0.1 * np.abs(rate) - 0.1 * 0.02)[:ROWS]
    assert_allclose(np.sort(seen.rows[0] - np.abs(seen.slopes[0]) @ [0.1, 0.1]), lowest)


def test_what_may_come_lowest_depends_on_the_reach():
    """Near by the rows that are low now, far away those that fall fast whichever way they turn."""
    near, far = (np.asarray(model([0.2, 0.0], [reach, 0.0]).slopes[0, :, 0]) for reach in (1e-3, 100.0))
    assert np.all(near < 0.35)
    assert far.max() == 1.0


def test_the_lowest_row_is_kept_however_many_others_may_come_lower():
    """Sixty that fall fast, and one between them that is low and stays: without it a lane would cost less than it does."""

    def crowded(x):
        rows = jnp.ones(61) + jnp.where(jnp.arange(61) == 33, -3.0, 5.0 * x[0])
        return Parts(x[0], x[0], (rows,))

    seen = jax.jit(lambda x, r: linearised(crowded, x, r, ROWS))(jnp.zeros(1), jnp.array([10.0]))
    assert np.min(seen.rows) == -2.0


def test_rows_that_are_none_bind_nothing():
    """The row that is not used, and what fills up the constraint with a single row."""
    seen = model([0.2, -1.0], [100.0, 0.1])
    assert_allclose(seen.rows[1, 0], -2.8)
    assert np.all(np.asarray(seen.rows[1, 1:]) == FREE)
    assert np.all(np.asarray(seen.slopes[1, 1:]) == 0.0)
    assert np.isfinite(seen.rows).all()
    assert np.isfinite(seen.slopes).all()


def test_a_row_that_is_no_number_is_not_taken_for_one_that_binds_nothing():
    def broken(x):
        seen = parts(x)
        return seen._replace(rows=(seen.rows[0].at[20].set(jnp.nan), seen.rows[1]))

    seen = jax.jit(lambda x, r: linearised(broken, x, r, ROWS))(jnp.array([0.2, -1.0]), jnp.array([0.1, 0.1]))
    assert np.isnan(seen.rows[0]).sum() == 1
    assert not np.isnan(seen.rows[1]).any()
