import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.search.batches import over_lanes


def test_lanes_are_shared_out_over_all_devices():
    assert jax.local_device_count() > 1  # conftest.py asks for two: the path that the command line takes


@pytest.mark.parametrize("chunk", [1, 3, 8])
@pytest.mark.parametrize("count", [1, 5, 16, 17])
def test_the_cut_changes_no_lane(chunk, count):
    x = {"a": np.arange(count, dtype=float), "b": np.arange(2 * count, dtype=float).reshape(count, 2)}
    lane = lambda x: (jnp.sin(x["a"]) + x["b"], x["a"] > 2.0)  # noqa: E731
    numbers, flags = over_lanes(lane, chunk)(x)
    np.testing.assert_array_equal(flags, x["a"] > 2.0)
    np.testing.assert_allclose(numbers, np.sin(x["a"])[:, None] + x["b"], rtol=1e-15)


def test_gradients_pass_through():
    x = np.linspace(0.1, 1.0, 7)
    np.testing.assert_allclose(over_lanes(jax.grad(jnp.log), 2)(x), 1.0 / x, rtol=1e-15)
