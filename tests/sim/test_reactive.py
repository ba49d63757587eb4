"""Forces felt through the joints against the simulated contact; bounds of a swing; a walk whose map is wrong."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.control.reflex import reflex
from jaxleg.control.sensing import Smoothed, smoothed
from jaxleg.control.swing_leg import Feeling, feeling, reflexes
from jaxleg.gait.order import SHIFT, SWING_LEG
from jaxleg.gait.params import GaitParams
from jaxleg.leg.kinematics import Reach, leg_angles
from jaxleg.sim.contact import Ground
from jaxleg.sim.legged import legged_engine
from jaxleg.sim.reactive import walk_reactively
from jaxleg.sim.referee_feedback import PERIOD, lockstep
from jaxleg.swing.bounds import swing_bounds
from jaxleg.swing.machine import Machine, Mode
from jaxleg.terrain.generators import Grid, flat
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.choices import no_choice
from jaxleg.walk.data import Walk
from jaxleg.walk.reference import reference
from tests.crawls import crawl, settings, up_to

DT, TICKS = 0.0025, 4800
ERROR = np.array([0.03, -0.03])
PIT, HOLE = 2, np.array([0.46, 0.18])  # the lane with a hole where the left front foot is to land, and where that is [m]


class Walks(NamedTuple):
    """What is walked: the ground as it is, the plans, and how the legs react."""

    true: HeightMap
    walk: Walk
    machine: Machine
    feel: Feeling


@pytest.fixture(scope="module")
def planned(pegasus):
    """One cycle over level ground that the map has 3 cm too high, and too low, ahead of the first stance; and over a hole that
    it does not have."""
    numbers = (0.0, 0.0, 0.16, 0.6, 0.36, 0.06, 0.45, 0.5, 0.0)
    params = GaitParams(up_to(jnp.asarray(0.46)), *(jnp.asarray(x) for x in numbers))
    options = settings(bend=np.rad2deg(0.3), threshold=0.01)
    level = flat(Grid(160, 80, 0.02, (-1.2, -0.8)))
    x, y = (o + 0.02 * np.arange(n) for o, n in zip(np.asarray(level.origin), level.elevation.shape))
    hole = (np.abs(x - HOLE[0])[:, None] < 0.07) & (np.abs(y - HOLE[1])[None] < 0.07)

    @jax.jit
    @jax.vmap
    def lane(error, holes):
        true = dataclasses.replace(level, elevation=jnp.where(holes & hole, -0.3, level.elevation))
        believed = dataclasses.replace(level, elevation=level.elevation + jnp.where(x > 0.36, error, 0.0)[:, None])
        choice = no_choice(1, jnp.asarray(0.0).dtype)
        return true, crawl(pegasus, params, options, believed, choice.offset, choice.found)

    machine = dataclasses.replace(reflexes(pegasus), limit=jnp.asarray(1.0))
    feel = dataclasses.replace(feeling(pegasus), answers=jnp.array([[0.8, 1.0], [-0.8, 1.0]]))
    return Walks(*lane(np.append(ERROR, 0.0), np.arange(3) == PIT), machine, feel)


@pytest.fixture(scope="module")
def walked(planned, pegasus):
    """The walks in simulation."""
    engine, dt = legged_engine(pegasus), jnp.asarray(DT)

    def lane(true, walk):
        return walk_reactively(engine, pegasus, Ground(), true, walk, planned.machine, planned.feel, dt, TICKS)

    return jax.tree.map(np.asarray, jax.jit(jax.vmap(lane))(planned.true, planned.walk))


def test_a_walk_whose_map_is_wrong_ends_on_its_feet(walked, pegasus):
    assert np.all(walked.alive)
    assert np.all(walked.done[:, -1])
    heights = walked.foot[:, -1, :, 2]
    np.testing.assert_allclose(heights, float(pegasus.contact_radius), atol=3e-3)
    assert np.all(walked.normal_force[:PIT, -1] > 20.0)
    assert np.all(walked.normal_force[PIT, -1] > 10.0)  # its feet stand elsewhere than planned


def test_a_foot_that_finds_no_ground_goes_on_down_and_one_that_meets_it_early_stops(walked):
    """Of the front feet, which step to where the map is wrong."""
    swings = [phase for phase, leg in enumerate(SWING_LEG) if leg != SHIFT]
    assert np.all(walked.contact[:PIT].sum(axis=1) == len(swings))
    for phase in swings[1::2]:
        modes = [set(walked.mode[lane, walked.phase[lane] == phase]) for lane in range(len(ERROR))]
        assert [Mode.DOWN in seen for seen in modes] == [True, False]


def test_what_is_felt_is_the_contact(walked, pegasus):
    """The estimate against the true normal force on level ground through the same low pass: in every swing the leg in the air
    feels nothing to speak of, and from the contact on what is there. The trunk is not quite still, so not exactly."""
    delay, threshold = (float(x) for x in (feeling(pegasus).senses.delay, feeling(pegasus).threshold))
    zero = jnp.zeros((len(ERROR), 4))

    def tick(past, now):
        after = smoothed(past, now, jnp.asarray(delay), DT)
        return after, after.value

    _, true = jax.lax.scan(tick, Smoothed(zero, zero, zero), np.swapaxes(walked.normal_force[:PIT], 0, 1))
    error = walked.felt[:PIT, :, :, 2] - np.swapaxes(true, 0, 1)
    legs = np.array(SWING_LEG)
    for lane in range(len(ERROR)):
        for phase in np.flatnonzero(legs != SHIFT):
            flies = (walked.phase[lane] == phase) & (walked.mode[lane] >= 0)
            assert np.abs(error[lane, flies, legs[phase]]).max() < 0.5 * threshold


def test_a_swing_moves_only_its_own_foot(walked):
    legs = np.array(SWING_LEG)
    for lane in range(len(ERROR)):
        for phase in np.flatnonzero(legs != SHIFT):
            at = walked.phase[lane] == phase
            moved = np.ptp(walked.foot[lane, at], axis=0)
            others = [leg for leg in range(4) if leg != legs[phase]]
            assert moved[others].max() < 0.01
            assert moved[legs[phase], 0] > 0.05


def test_the_bounds_of_a_swing_are_the_shell_that_the_leg_reaches(pegasus):
    """Just within the bounds inverse kinematics has an answer with the knee bent as asked; just beyond it has not."""
    hip = np.array([0.1, 0.05, 0.5])
    place = hip[:2] + np.array([[0.0, 0.08], [0.2, 0.08], [-0.15, 0.12]])
    low, high = map(np.asarray, jax.jit(swing_bounds)(pegasus, hip, place, 0.0, 3.0))

    def leg(xy, z):
        return jax.jit(leg_angles)(*first, pegasus.knee_sign, np.array([*xy, z]) - hip)

    first = [np.asarray(x)[0] for x in (pegasus.joint_axis, pegasus.link_offset)]
    for xy, z in zip(place, low):
        assert leg(xy, z + 1e-3)[1] == Reach.OK
        assert leg(xy, z - 1e-3)[1] == Reach.TOO_FAR
    angles, _ = leg(place[0], high[0])
    np.testing.assert_allclose(np.abs(angles)[2], 3.0, atol=1e-6)


def test_a_foot_that_comes_back_steps_in_another_direction(walked):
    """B17: it finds nothing in the hole and its surroundings, returns, and stands to the left of it."""
    phase = next(p for p, leg in enumerate(SWING_LEG) if leg == 0)
    at = walked.phase[PIT] == phase
    modes = walked.mode[PIT, at]
    assert Mode.RETURN_UP in modes
    returned = np.flatnonzero(modes == Mode.RETURN_DOWN)[-1]
    assert Mode.INITIAL in modes[returned:]
    start, landed = walked.foot[PIT, np.flatnonzero(at)[0], 0], walked.foot[PIT, -1, 0]
    way = landed[:2] - start[:2]
    assert np.arctan2(way[1], way[0]) == pytest.approx(0.8, abs=0.15)
    assert np.linalg.norm(way) == pytest.approx(0.16, abs=0.03)


def test_the_trunk_follows_the_feet(walked):
    """Where the map has the ground too high the plan lifts the trunk; the feet, felt lower, take it down again."""
    swung = walked.phase[0] == 3  # the shift after the first front foot has landed 3 cm under its plan
    assert np.ptp(walked.trunk[0, swung, 2]) > 0.015
    assert walked.trunk[0, swung, 2][-1] < walked.trunk[0, swung, 2][0]


@pytest.mark.slow
def test_the_referee_agrees(planned, walked, pegasus):
    """C MuJoCo under the same controller: nobody falls, all come to the end, the trunk where it is in MJX."""
    dt = jnp.asarray(PERIOD)
    controllers = jax.jit(jax.vmap(lambda walk: reflex(pegasus, walk, planned.machine, planned.feel, dt)))(planned.walk)
    starts = jax.jit(jax.vmap(lambda walk: reference(pegasus, walk, (4, 4))))(planned.walk)
    lanes = [[jax.tree.map(lambda x, i=i: np.asarray(x)[i], tree) for i in range(PIT + 1)] for tree in (planned.true, starts)]
    judged = lockstep(pegasus, lanes[0], controllers, lanes[1], 0.8, TICKS)
    assert not judged.verdict.fell.any()
    assert judged.over.all()
    np.testing.assert_allclose(judged.trunk[:, :2], walked.trunk[:, -1, :2], atol=0.02)
    np.testing.assert_allclose(judged.trunk[:, 2], walked.trunk[:, -1, 2], atol=0.01)
