"""Times of phases: a walk at a speed has it however many of its phases are walked."""

import numpy as np
import pytest

from jaxleg.gait.phases import layout
from jaxleg.gait.timing import BySpeed
from tests.crawls import gait


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize(("steps", "walked"), [(8, 8), (40, 8), (8, 6)])
def test_the_way_takes_as_long_as_the_speed_says(shared, steps, walked):
    shape = layout(steps, shared, standing=True)
    used, walk = shape.step - (shape.leg < 0) < walked, gait(shift=0.4, hind=0.6)
    time = np.asarray(BySpeed(np.array(0.05)).durations(walk, 0.1, None, tuple(shape.leg.tolist()), used, 0.8))
    assert time[used].sum() == pytest.approx(0.8 / 0.05)
    front, hind = (time[np.isin(shape.leg, legs)] for legs in ((0, 1), (2, 3)))
    np.testing.assert_allclose(
        [*hind / hind[0], *front / front[0], hind[0] / front[0]], [*np.ones(len(hind) + len(front)), 1.5]
    )


def test_a_walk_of_no_step_has_finite_times():
    shape = layout(8, True, standing=True)
    none = np.zeros(len(shape.leg), bool)
    time = BySpeed(np.array(0.05)).durations(gait(), 0.1, None, tuple(shape.leg.tolist()), none, 0.0)
    np.testing.assert_array_equal(time, 0.0)
