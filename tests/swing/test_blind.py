"""The machine against a plain Python one written from the paper's words, and the repairs of the extended machine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.plain_swing import plain_swing
from jaxleg.swing.blind import blind_swing
from jaxleg.swing.machine import Mode, Step, extended, printed
from jaxleg.swing.profile import natural_spline

STEP = Step(jnp.array([0.0, 3.0]), jnp.array([8.0, 3.0]))
EXITS = {"supported": Mode.SUPPORTED, "returned": Mode.RETURNED}

swings = jax.jit(jax.vmap(lambda machine, heights: blind_swing(machine, STEP, natural_spline(heights)), in_axes=(None, 0)))


def terrains(count, above, below, amplitude, seed=0):
    heights = np.random.default_rng(seed).uniform(3 - amplitude * below, 3 + amplitude * above, (count, 15))
    heights[:, 0] = 3.0
    return heights


@pytest.mark.parametrize(("above", "below"), [(2, 0), (4, 0), (4, 2)])
def test_the_printed_machine_is_the_papers_words(above, below):
    """Exit, end, path and adjustments of swings over terrains of Table II, in the calibrated reading."""
    heights = terrains(60, above, below, 0.4)
    ours = swings(printed(), jnp.asarray(heights))
    for k, ground in enumerate(heights):
        how, x, length, adjustments = plain_swing(ground)
        assert ours.exit[k] == EXITS[how]
        assert ours.adjustments[k] == adjustments
        np.testing.assert_allclose([ours.point[k, 0], ours.length[k]], [x, length], atol=2e-4)
    assert not np.any(ours.lost)


def test_level_ground_is_one_cycloid_and_no_adjustment():
    ours = swings(printed(), jnp.full((1, 15), 3.0))
    assert ours.exit[0] == Mode.SUPPORTED
    assert ours.adjustments[0] == 0
    np.testing.assert_allclose(ours.point[0], [8.0, 3.0], atol=1e-6)


def test_the_extended_machine_finds_a_support_where_the_printed_one_jams():
    heights = jnp.asarray(terrains(300, 4, 2, 0.4, seed=1))
    before, after = swings(printed(), heights), swings(extended(), heights)
    assert np.mean(before.exit == Mode.SUPPORTED) < 0.9
    assert np.all(after.exit == Mode.SUPPORTED)


def test_probing_from_coarse_to_fine_takes_fewer_tries():
    heights = jnp.asarray(terrains(300, 4, 2, 0.4, seed=2))
    coarse, left = (swings(extended(33, coarse_to_fine=kind), heights) for kind in (True, False))
    difference = np.asarray(left.adjustments) - np.asarray(coarse.adjustments)
    assert difference.mean() > 2.0 * difference.std() / np.sqrt(len(difference))
