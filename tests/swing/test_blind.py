"""The machine against a plain Python one written from the paper's words, and the repairs of the extended machine."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.plain_swing import plain_swing
from jaxleg.swing import blind, contact
from jaxleg.swing.arc import point_at
from jaxleg.swing.blind import blind_swing, blind_swings
from jaxleg.swing.machine import Mode, Step, begin, extended, printed, segment
from jaxleg.swing.profile import natural_spline

STEP = Step(np.array([0.0, 3.0]), np.array([8.0, 3.0]))
LEVEL = np.full((1, 15), 3.0)
COUNT, STATIONS = 300, 257
EXITS = {"supported": Mode.SUPPORTED, "returned": Mode.RETURNED}

queue = jax.jit(lambda machine, step, heights: blind_swings(machine, step, jax.vmap(natural_spline)(heights)))


def swings(machine, heights):
    """Over at most `COUNT` terrains, by one program for all: the queue is as long, and no station is where there is none."""
    stations = np.pad(machine.stations, (0, STATIONS - machine.stations.size), constant_values=np.inf)
    machine = dataclasses.replace(machine, stations=jnp.asarray(stations))
    seen = queue(machine, STEP, np.resize(heights, (COUNT, 15)))
    return jax.tree.map(lambda x: np.asarray(x)[: len(heights)], seen)


def alone(step, heights):
    """Each swing of the extended machine by itself, with what a test has patched."""
    swing = jax.vmap(lambda knots: blind_swing(extended(), step, natural_spline(knots)))
    return jax.device_get(jax.jit(swing)(heights))


def terrains(count, above, below, amplitude, seed=0):
    heights = np.random.default_rng(seed).uniform(3 - amplitude * below, 3 + amplitude * above, (count, 15))
    heights[:, 0] = 3.0
    return heights


@pytest.mark.parametrize(("above", "below"), [(2, 0), (4, 0), (4, 2)])
def test_the_printed_machine_is_the_papers_words(above, below):
    """Exit, end, path and adjustments of swings over terrains of Table II, in the calibrated reading."""
    heights = terrains(60, above, below, 0.4)
    ours = swings(printed(), heights)
    for k, ground in enumerate(heights):
        how, x, length, adjustments = plain_swing(ground)
        assert ours.exit[k] == EXITS[how]
        assert ours.adjustments[k] == adjustments
        np.testing.assert_allclose([ours.point[k, 0], ours.length[k]], [x, length], atol=2e-4)
    assert not np.any(ours.lost)


def test_level_ground_is_one_cycloid_and_no_adjustment():
    ours = swings(printed(), LEVEL)
    assert ours.exit[0] == Mode.SUPPORTED
    assert ours.adjustments[0] == 0
    np.testing.assert_allclose(ours.point[0], [8.0, 3.0], atol=1e-5)


def test_the_extended_machine_finds_a_support_where_the_printed_one_jams():
    heights = terrains(COUNT, 4, 2, 0.4, seed=1)
    before, after = swings(printed(), heights), swings(extended(), heights)
    assert np.mean(before.exit == Mode.SUPPORTED) < 0.9
    assert np.all(after.exit == Mode.SUPPORTED)


def test_probing_from_coarse_to_fine_takes_fewer_tries():
    heights = terrains(COUNT, 4, 2, 0.4, seed=2)
    coarse, left = (swings(extended(33, coarse_to_fine=kind), heights) for kind in (True, False))
    difference = left.adjustments - coarse.adjustments
    assert difference.mean() > 2.0 * difference.std() / np.sqrt(len(difference))


def test_a_swing_that_runs_out_of_segments_or_loses_its_search_has_stalled(monkeypatch):
    """Neither may come back as a support."""
    heights = terrains(20, 4, 2, 0.4, seed=3)
    whole = swings(extended(), heights)
    for module, name, cap in ((blind, "SEGMENTS", 3), (contact, "STEPS", 10)):
        with monkeypatch.context() as patch:
            patch.setattr(module, name, cap)
            short = alone(STEP, heights)
        stalled = short.exit == Mode.STALLED
        assert stalled.sum() > 10
        assert np.all(stalled | (short.exit == whole.exit))
        assert np.all(stalled | ~short.lost)


@jax.jit
def segment_end(machine, step, state):
    arc = segment(machine, step, state)
    return point_at(arc, arc.end)


@pytest.mark.parametrize("machine", [printed(), extended()])
def test_case_4_goes_forward_by_as_far_as_it_went_back(machine):
    """Paper B, (7) and (8): back from the wall at P_c, then up and forward to over P_c; also where the map ends behind it."""
    wall = 0.3
    state = begin(STEP)._replace(stop=np.array(wall))
    behind = np.asarray(segment_end(machine, STEP, state._replace(point=np.array([wall, 3.5]), mode=int(Mode.BACK))))
    over = segment_end(machine, STEP, state._replace(point=behind, mode=int(Mode.UP)))
    np.testing.assert_allclose(behind[0], wall - 0.5 if not machine.probing else 0.0, atol=1e-12)
    np.testing.assert_allclose(over, [wall, 3.5 + 0.3 * (7.5 - 3.5)], atol=1e-12)


@pytest.mark.parametrize(("slope", "side"), [(0.7, -1.0), (-0.7, 1.0)])
def test_the_corner_is_the_end_of_the_interval_that_the_slope_falls_to(slope, side):
    """Paper B, (5): F_x < 0 on a rising slope."""
    state = begin(STEP)._replace(point=np.array([7.0, 5.0]), slope=np.array(slope), mode=int(Mode.CORNER))
    end = segment_end(printed(allowance=0.4), STEP, state)
    np.testing.assert_allclose(end, [STEP.target[0] + side * 0.4, 0.0], atol=1e-12)


def test_a_lost_search_ends_the_swing_at_once(monkeypatch):
    monkeypatch.setattr(contact, "STEPS", 1)
    near = STEP._replace(start=np.array([7.5, 3.0]))  # it is lost within the end interval, where the machine would probe on
    swing = alone(near, LEVEL)
    assert swing.lost
    assert swing.exit == Mode.STALLED
    assert swing.segments == 1


@pytest.mark.slow
def test_a_queue_of_swings_gives_what_each_one_alone_gives():
    heights = terrains(150, 4, 2, 1.0, seed=4)
    for a, b in zip(alone(STEP, heights), swings(extended(), heights), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_half_cycloids_join_without_a_jump_at_one_peak_speed():
    """Case 4 ends its rise at the peak speed with which the forward half sets out; only turns are jumps."""
    level = swings(printed(), LEVEL)
    np.testing.assert_allclose([level.jump[0], level.time[0]], [0.0, 16.0], atol=1e-6)  # 2 S at a peak speed of 1
