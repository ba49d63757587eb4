"""The compound cycloid of paper B, equation (2)."""

import jax
import numpy as np
import pytest

from jaxleg.swing.cycloid import cycloid_advance, cycloid_share, swing_foot

START, END = np.array([0.1, 0.2, 0.0]), np.array([0.4, 0.25, 0.0])
foot = jax.jit(swing_foot)
path = jax.jit(jax.vmap(swing_foot, in_axes=(None, None, None, 0, None)))
speed = jax.jit(jax.jacfwd(swing_foot, argnums=3))


def at(share, lift=0.0, end=END):
    return np.asarray(foot(START, end, 0.08, share, lift))


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.77, 1.0])
def test_level_swings_are_the_printed_cycloid(share):
    x = 0.1 + 0.3 * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
    z = 0.08 * (1 - np.cos(2 * np.pi * share)) / 2
    np.testing.assert_allclose(at(share)[[0, 2]], [x, z], atol=1e-12)


@pytest.mark.parametrize("lift", [0.0, 0.2])
@pytest.mark.parametrize("rise", [-0.08, 0.0, 0.08])
def test_swings_start_and_end_at_rest_and_top_out_above_the_higher_end(lift, rise):
    end = np.array([*END[:2], rise])
    np.testing.assert_allclose(at(0.0, lift, end), START, atol=1e-12)
    np.testing.assert_allclose(at(1.0, lift, end), end, atol=1e-12)
    for share in (1e-9, 1.0 - 1e-9):
        assert np.abs(np.asarray(speed(START, end, 0.08, share, lift))).max() < 1e-6
    feet = np.asarray(path(START, end, 0.08, np.linspace(0.0, 1.0, 201), lift))
    np.testing.assert_allclose(feet[:, 2].max(), max(0.0, rise) + 0.08, atol=1e-12)


def test_a_lift_share_goes_straight_up_first():
    np.testing.assert_allclose(at(0.15, 0.2)[:2], START[:2], atol=1e-12)
    assert at(0.15, 0.2)[2] > 0.01


def test_the_share_of_an_advance_is_its_inverse():
    share = np.linspace(0.0, 1.0, 41)
    advance = jax.jit(cycloid_advance)(share)
    inverse = jax.jit(cycloid_share)(advance)
    np.testing.assert_allclose(jax.jit(cycloid_advance)(inverse), advance, atol=1e-6)
    np.testing.assert_allclose(inverse[20], 0.5, atol=1e-6)
