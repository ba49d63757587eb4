"""Traces are the swings: as long, ending where they end, one segment where the other begins."""

import dataclasses

import jax
import numpy as np
import pytest

from jaxleg.swing.blind import blind_swing
from jaxleg.swing.informed import informed_swing
from jaxleg.swing.localmap import sampled
from jaxleg.swing.machine import Mode, Step, extended, printed
from jaxleg.swing.planner import cautious
from jaxleg.swing.profile import height, natural_spline
from jaxleg.swing.trace import blind_trace, informed_trace
from jaxleg.viz.swing import SwingPicture, draw_course, draw_front, draw_swings

STEP = Step(np.array([0.0, 3.0]), np.array([8.0, 3.0]))
KNOTS = np.random.default_rng(6).uniform(2.2, 4.6, 15)
KNOTS[0] = 3.0
LOWERED = np.where(np.isin(np.arange(15), (3, 6, 7)), KNOTS - 2.0, KNOTS)
spline = jax.jit(natural_spline)


@pytest.fixture(scope="module")
def profile():
    return spline(KNOTS)


@pytest.fixture(scope="module")
def machines():
    """Both of one shape: the printed machine probes no station."""
    return dataclasses.replace(printed(), stations=extended().stations), extended()


def length(trace):
    return sum(np.hypot(*np.diff(points, axis=0).T).sum() for points in trace.point)


def joined(trace):
    return max(np.abs(b[0] - a[-1]).max() for a, b in zip(trace.point, trace.point[1:], strict=False))


def test_a_blind_trace_is_the_swing(machines, profile):
    swing_of = jax.jit(blind_swing)
    for machine in machines:
        swing, trace = jax.device_get(swing_of(machine, STEP, profile)), blind_trace(machine, STEP, profile, 64)
        assert len(trace.mode) == swing.segments > 1
        np.testing.assert_allclose(length(trace), swing.length, rtol=1e-3)
        np.testing.assert_allclose(trace.point[-1, -1], swing.point, atol=1e-5)
        assert joined(trace) < 1e-5


@pytest.mark.slow  # long to compile
def test_an_informed_trace_is_the_swing(profile):
    wrong = jax.jit(sampled, static_argnums=3)(spline(LOWERED), -0.5, 9.5, 201)
    case = (printed(), cautious(clearance=0.1), STEP, profile, wrong)
    informed, trace = jax.jit(informed_swing)(*case), informed_trace(*case)
    assert len(trace.mode) == informed.swing.segments > 1
    assert trace.mode[0] == Mode.ROUTE
    assert trace.ground is not None
    np.testing.assert_allclose(length(trace), informed.swing.length, rtol=1e-2)
    assert joined(trace) < 1e-2
    assert np.all(trace.ground[-1] >= trace.ground[0])  # it only learns of obstacles


def test_the_pictures_are_drawn(machines, profile, tmp_path):
    x = np.linspace(0.0, 9.0, 50)
    ground = np.asarray(jax.jit(height)(profile, x))
    trace = blind_trace(machines[1], STEP, profile, 64)
    draw_swings([SwingPicture("one", trace, x, ground, (7.0, 9.0), (x, ground - 1.0))] * 3, tmp_path / "swings.png")
    draw_course(x, {"true": ground, "told": ground - 1.0}, {"blind": [trace], "informed": [trace]}, tmp_path / "course.png")
    values = np.array([[0.5, 10.0, 2.0], [0.7, 12.0, 3.0], [0.4, 12.0, 3.0]])
    draw_front(values, np.array([0, 1]), {"paper": (0.5, 10.0, 2.0), "tuned": (0.7, 12.0, 3.0)}, tmp_path / "front.png")
    for name in ("swings", "course", "front"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
