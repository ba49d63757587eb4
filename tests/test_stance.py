"""Gait constraints of paper A, (4)-(7), with the numbers the paper derives."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.stance import gait_constraints, half_step_skew, nominal_stances
from tests.planning.conftest import gait


def test_the_papers_limits(pegasus):
    slack = gait_constraints(pegasus, 0.5, jnp.asarray(0.2), jnp.asarray(0.3))
    assert slack.search_behind + 0.3 == pytest.approx(0.40)  # (5): L_Search < 0.4
    assert slack.step_reach + 0.2 == pytest.approx(0.33, abs=2e-3)  # (6): L_Step < 0.33
    assert slack.search_reach + 0.3 == pytest.approx(0.56, abs=4e-3)  # (7): L_Search < 0.56
    assert slack.knee_clear == pytest.approx(0.24)
    assert half_step_skew(0.2) == 0.1  # (4)


def test_stances_are_mirrored_parallelograms():
    stance = np.asarray(nominal_stances(gait(step=0.2, skew=0.1, length=0.6, width=0.4), 0, 2))
    left, right = stance[:, [0, 2]], stance[:, [1, 3]]
    np.testing.assert_allclose(left[0] - right[0], [[0.1, 0.4]] * 2)  # before the right legs swing
    np.testing.assert_allclose(left[0] - right[1], [[-0.1, 0.4]] * 2)  # before the left ones: mirrored
    np.testing.assert_allclose(stance[:, 0] - stance[:, 2], [[0.6, 0.0]] * 2)
    np.testing.assert_allclose(stance[1] - stance[0], [[0.2, 0.0]] * 4)
