"""Steps that cannot be asked for: a status a lane, and one sentence at the edge."""

import dataclasses
import re

import jax
import numpy as np
import pytest

from jaxleg.swing.blind import blind_swings
from jaxleg.swing.informed import informed_swings
from jaxleg.swing.localmap import LocalMap
from jaxleg.swing.machine import Mode, Step, extended, printed
from jaxleg.swing.planner import shortest
from jaxleg.swing.profile import Profile, natural_spline
from jaxleg.swing.status import StepStatus, check_step, status_on_map, status_on_profile

STEP = Step(np.array([0.0, 3.0]), np.array([8.0, 3.0]))
LEVEL = Profile(np.tile([3.0, 0.0, 0.0, 0.0], (14, 1)), np.array(0.0), np.array(1.0))
MAP = LocalMap(np.full(201, 3.0), np.array(-0.5), np.array(0.05))
BAD = {
    StepStatus.START_IN_GROUND: (printed(), STEP._replace(start=np.array([0.0, 2.0])), "step.start = (0.0, 2.0)"),
    StepStatus.GOAL_OFF_MAP: (printed(), STEP._replace(target=np.array([18.0, 3.0])), "step.target = (18.0, 3.0)"),
    StepStatus.BOUNDS_CROSSED: (printed(low=8.0), STEP, "machine.low = 8.0 must be below machine.high = 7.5"),
    StepStatus.NO_INTERVAL: (
        dataclasses.replace(printed(), allowance=jax.numpy.asarray(0.0)),
        STEP,
        "machine.allowance = 0.0 must be positive",
    ),
}


@pytest.mark.parametrize("status", BAD)
def test_a_bad_step_has_a_status_and_is_refused_by_name(status):
    machine, step, sentence = BAD[status]
    for ground, of in ((LEVEL, status_on_profile), (MAP, status_on_map)):
        assert of(machine, step, ground) == status
        with pytest.raises(ValueError, match=re.escape(sentence)):
            check_step(machine, step, ground)


@pytest.mark.parametrize("change", [{"start": [np.nan, 3.0]}, {"start": [0.0, np.nan]}, {"target": [8.0, np.inf]}])
def test_a_step_that_is_not_finite_is_refused(change):
    step = STEP._replace(**{key: np.array(value) for key, value in change.items()})
    for ground, of in ((LEVEL, status_on_profile), (MAP, status_on_map)):
        assert of(printed(), step, ground) == StepStatus.NOT_FINITE
        with pytest.raises(ValueError, match="must be finite"):
            check_step(printed(), step, ground)


def test_a_good_step_passes():
    for ground in (LEVEL, MAP):
        check_step(printed(), STEP, ground)
        check_step(extended(), STEP, ground)


def test_unseen_ground_in_the_step_is_refused_and_elsewhere_is_not():
    for cell, status in ((100, StepStatus.UNSEEN), (0, StepStatus.OK), (200, StepStatus.OK)):
        ground = np.where(np.arange(201) == cell, np.nan, MAP.ground)
        assert status_on_map(printed(), STEP, MAP._replace(ground=ground)) == status
    between = STEP._replace(start=np.array([0.02, 3.0]), target=np.array([8.02, 3.0]))  # both ends lie between two points
    for cell in range(8, 194):
        ground = np.where(np.arange(201) == cell, np.nan, MAP.ground)
        seen = status_on_map(printed(), between, MAP._replace(ground=ground))
        assert seen == (StepStatus.UNSEEN if 10 <= cell <= 191 else StepStatus.OK)
    hole = LEVEL._replace(coefficients=np.where(np.arange(14)[:, None] == 4, np.nan, LEVEL.coefficients))
    assert status_on_profile(printed(), STEP, hole) == StepStatus.UNSEEN
    with pytest.raises(ValueError, match="unseen"):
        check_step(printed(), STEP, hole)


def test_a_bad_lane_stalls_at_once_and_leaves_the_others_alone():
    heights = np.full((3, 15), 3.0)
    heights[1, 0] = 5.0
    profiles = jax.jit(jax.vmap(natural_spline))(heights)
    blind = jax.jit(blind_swings)(printed(), STEP, profiles)
    np.testing.assert_array_equal(blind.exit, [Mode.SUPPORTED, Mode.STALLED, Mode.SUPPORTED])
    np.testing.assert_array_equal(blind.status, [StepStatus.OK, StepStatus.START_IN_GROUND, StepStatus.OK])


@pytest.mark.slow  # long to compile
def test_a_lane_without_ground_on_its_map_stalls_at_once_and_leaves_the_others_alone():
    ground = np.full((3, 201), 3.0)
    ground[2, 60] = np.nan
    maps = LocalMap(ground, np.full(3, -0.5), np.full(3, 0.05))
    profiles = Profile(np.stack([LEVEL.coefficients] * 3), np.zeros(3), np.ones(3))
    informed = jax.jit(informed_swings)(printed(), shortest(), STEP, profiles, maps)
    informed = jax.device_get(informed)
    np.testing.assert_array_equal(informed.swing.exit, [Mode.SUPPORTED, Mode.SUPPORTED, Mode.STALLED])
    assert informed.swing.status[2] == StepStatus.UNSEEN


@pytest.mark.parametrize(
    ("make", "name"),
    [(printed, "height_share"), (printed, "back"), (extended, "allowance"), (shortest, "attraction"), (shortest, "repulsion")],
)
def test_gains_that_are_not_positive_are_refused_by_name(make, name):
    for value in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match=f"{name} = {value} must be positive"):
            make(**{name: value})
