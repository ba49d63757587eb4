"""Candidate states: the order of paper C (28), adjustments from the default outwards, the pruning rules."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.series.candidates import Adjustments, Counts, adjustment_of, outwards, place_of, pruned, steps_away
from jaxleg.status import Status

COUNTS = Counts(footholds=3, rolls=3, pitches=5, heights=3)
place = jax.jit(place_of, static_argnums=1)
gone_by = jax.jit(pruned, static_argnums=2)
STEPS = Adjustments(*(jnp.array(x) for x in (0.03, 0.1, 0.2)))


def everything():
    return [
        (f, r, p, h)
        for f in range(COUNTS.footholds)
        for r in range(COUNTS.rolls)
        for p in range(COUNTS.pitches)
        for h in range(COUNTS.heights)
    ]


def test_height_is_adjusted_first_then_pitch_roll_and_the_foothold_last():
    places = np.stack(place(np.arange(COUNTS.candidates), COUNTS), axis=1)
    assert [tuple(map(int, row)) for row in places] == everything()
    assert len(everything()) == COUNTS.candidates


def test_adjustments_go_outwards_from_the_default():
    assert list(outwards(5)) == [0, 1, -1, 2, -2]
    assert list(outwards(1)) == [0]
    away = jax.jit(steps_away, static_argnums=1)(np.arange(COUNTS.candidates), COUNTS)
    values = np.asarray(jax.jit(adjustment_of)(away, STEPS))
    np.testing.assert_allclose(values[0], [0.0, 0.0, 0.0])
    np.testing.assert_allclose(values[:3, 0], [0.0, 0.03, -0.03])
    np.testing.assert_allclose(np.unique(values[:, 1].round(9)), [-0.2, -0.1, 0.0, 0.1, 0.2])
    np.testing.assert_allclose(np.unique(values[:, 2].round(9)), [-0.2, 0.0, 0.2])


@pytest.mark.parametrize("cause", list(Status))
def test_pruning_is_the_papers_rules(cause):
    """(i) kinematics: no greater height; (ii) hind leg: no nose further up; (iii) left leg: no smaller roll; all else equal."""
    for number in (0, 7, 22, 41, COUNTS.candidates - 1):
        f, r, p, h = everything()[number]
        rolls, pitches, heights = outwards(3), outwards(5), outwards(3)

        def gone(other, f=f, r=r, p=p, h=h, rolls=rolls, pitches=pitches, heights=heights):
            g, s, q, k = other
            return {
                Status.KINEMATICS: (g, s, q) == (f, r, p) and heights[k] > heights[h],
                Status.HIND_LEG: (g, s, k) == (f, r, h) and pitches[q] > pitches[p],
                Status.LEFT_LEG: (g, q, k) == (f, p, h) and rolls[s] < rolls[r],
                Status.NO_FOOTHOLD: g >= f,
            }.get(cause, False)

        expected = [gone(other) for other in everything()]
        np.testing.assert_array_equal(gone_by(number, int(cause), COUNTS), expected)
