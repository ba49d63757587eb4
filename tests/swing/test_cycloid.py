"""The compound cycloid of paper B, equation (2)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.swing.cycloid import cycloid_advance, cycloid_share, swing_foot

START, END = jnp.array([0.1, 0.2, 0.0]), jnp.array([0.4, 0.25, 0.0])


def at(share, lift=0.0, end=END):
    return swing_foot(START, end, 0.08, share, lift)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.77, 1.0])
def test_level_swings_are_the_printed_cycloid(share):
    x = 0.1 + 0.3 * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
    z = 0.08 * (1 - np.cos(2 * np.pi * share)) / 2
    np.testing.assert_allclose(at(share)[jnp.array([0, 2])], [x, z], atol=1e-12)


@pytest.mark.parametrize("lift", [0.0, 0.2])
@pytest.mark.parametrize("rise", [-0.08, 0.0, 0.08])
def test_swings_start_and_end_at_rest_and_top_out_above_the_higher_end(lift, rise):
    end = END.at[2].set(rise)
    np.testing.assert_allclose(at(0.0, lift, end), START, atol=1e-12)
    np.testing.assert_allclose(at(1.0, lift, end), end, atol=1e-12)
    for share in (1e-9, 1.0 - 1e-9):
        assert np.abs(jax.jacfwd(at)(share, lift, end)).max() < 1e-6
    path = jax.vmap(at, in_axes=(0, None, None))(jnp.linspace(0.0, 1.0, 201), lift, end)
    np.testing.assert_allclose(path[:, 2].max(), max(0.0, rise) + 0.08, atol=1e-12)


def test_a_lift_share_goes_straight_up_first():
    np.testing.assert_allclose(at(0.15, 0.2)[:2], START[:2], atol=1e-12)
    assert at(0.15, 0.2)[2] > 0.01


def test_the_share_of_an_advance_is_its_inverse():
    share = np.linspace(0.0, 1.0, 41)
    np.testing.assert_allclose(cycloid_advance(cycloid_share(cycloid_advance(share))), cycloid_advance(share), atol=1e-6)
    np.testing.assert_allclose(cycloid_share(0.5), 0.5, atol=1e-6)
