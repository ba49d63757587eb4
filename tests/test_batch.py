import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.batch import Picked, layout, over_lanes


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


@pytest.mark.parametrize(
    ("count", "most", "wanted"), [(0, 8, (1, 1)), (1, 8, (1, 1)), (3, 8, (2, 2)), (17, 8, (5, 2)), (200, 8, (8, 2))]
)
def test_layout_asks_for_hardly_more_lanes_than_there_are(count, most, wanted):
    assert layout(count, most) == wanted


def test_a_single_lane_is_worked_out_once():
    """Not on every device, nor a whole chunk of it: a large map would not fit."""
    seen = []
    lane = lambda x: jax.pure_callback(lambda y: seen.append(y.shape) or y, x, x, vmap_method="broadcast_all")  # noqa: E731
    over_lanes(lane, *layout(1, 8))(np.ones((1, 3)))
    assert seen == [(1, 3)]


@pytest.mark.parametrize("count", [0, 1, 7])
def test_lanes_that_are_looked_up_are_what_copies_are(count):
    rows, index = {"a": np.arange(6.0).reshape(3, 2)}, np.array([2, 0, 0, 1, 2, 1, 0])[:count]
    factor, lane = np.arange(1.0, 1.0 + count), lambda x, factor: factor * jnp.sum(x["a"])
    seen = over_lanes(lane, 2)(Picked(rows, index), factor)
    np.testing.assert_array_equal(seen, factor * rows["a"].sum(axis=1)[index])


def test_no_lanes_give_empty_results():
    lane = lambda x: {"sum": jnp.sum(x["a"]), "flag": x["a"] > 0.0}  # noqa: E731
    empty = over_lanes(lane, 8)({"a": np.ones((0, 3))})
    assert empty["sum"].shape == (0,)
    assert empty["flag"].shape == (0, 3)
    assert empty["flag"].dtype == bool
