"""Nothing in a test session broadcasts ranks or mixes dtypes silently, but in `foreign` code."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.numerics import Code, dot, foreign, matmul, matvec

ROW, GRID, COUNT = jnp.ones(3), jnp.ones((2, 3)), jnp.ones(3, jnp.int32)


class Colour(Code):
    RED = 1


@pytest.mark.parametrize("run", [lambda f: f, jax.jit], ids=["eager", "jit"])
def test_ranks_and_dtypes_are_not_promoted_silently(run):
    add = run(lambda a, b: a + b)
    with pytest.raises(ValueError, match="numpy_rank_promotion"):
        add(ROW, GRID)
    for other in (ROW, ROW.astype(jnp.float32), COUNT > 0):
        with pytest.raises(ValueError, match="dtype"):
            add(COUNT, other)


def test_foreign_code_may_and_only_there():
    with foreign():
        assert (ROW + GRID).shape == (2, 3)
        assert (COUNT + ROW).dtype == ROW.dtype
    with pytest.raises(ValueError, match="numpy_rank_promotion"):
        ROW + GRID


def test_the_small_linear_algebra_lines_up_the_leading_axes():
    cases = ((dot, (3,), (2, 5, 3)), (matvec, (4, 3), (2, 5, 3)), (matmul, (5, 4, 3), (3, 2)), (matmul, (4, 3), (2, 5, 3, 2)))
    for product, *shapes in cases:
        a, b = (np.random.default_rng(i).normal(size=shape) for i, shape in enumerate(shapes))
        leading = {dot: "...k,...k->...", matvec: "...ik,...k->...i", matmul: "...ik,...kj->...ij"}[product]
        assert np.allclose(jax.jit(product)(a, b), np.einsum(leading, a, b))


@pytest.mark.parametrize("dtype", [jnp.int8, jnp.int32, jnp.int64])
def test_a_code_takes_the_width_of_the_array(dtype):
    codes = jnp.array([0, 1], dtype)
    assert jnp.where(codes == Colour.RED, Colour.RED, codes).dtype == dtype
    assert (codes == Colour.RED).tolist() == [False, True]
    assert jnp.select([codes > 0], [Colour.RED], codes).tolist() == [0, 1]
    assert Colour(int(codes[1])) is Colour.RED
