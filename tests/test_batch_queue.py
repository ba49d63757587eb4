"""A queue of loops gives what each loop alone gives, whatever the number of lanes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.batch import over_queue


@pytest.mark.parametrize("lanes", [1, 3, 7, 50])
def test_every_item_gets_its_own_result(lanes):
    """Collatz sequences: their lengths differ wildly, and 1 is done before it begins."""
    numbers = np.arange(1, 40)

    def collatz(n):
        count = 0
        while n != 1:
            n, count = (n // 2 if n % 2 == 0 else 3 * n + 1), count + 1
        return count

    def advance(item, state):
        n, count, start = state
        return jnp.where(n % 2 == 0, n // 2, 3 * n + 1), count + 1, start

    run = jax.jit(lambda x: over_queue(lambda n: (n, 0 * n, n), advance, lambda s: s[0] != 1, x, lanes))
    _, counts, starts = run(jnp.asarray(numbers))
    np.testing.assert_array_equal(counts, [collatz(int(n)) for n in numbers])
    np.testing.assert_array_equal(starts, numbers)
