"""Forces felt through the joints against the simulated contact; bounds of a swing; a walk whose map is wrong."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.control.swing_leg import feeling
from jaxleg.gait.order import SHIFT, SWING_LEG
from jaxleg.gait.params import GaitParams
from jaxleg.leg.kinematics import Reach, leg_angles
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import mjx_engine
from jaxleg.sim.reactive import walk_reactively
from jaxleg.swing.bounds import swing_bounds
from jaxleg.swing.machine import Mode, extended
from jaxleg.terrain.generators import Grid, flat
from jaxleg.walk.choices import no_choice
from tests.crawls import crawl, settings

DT, TICKS = 0.0025, 2400
ERROR = np.array([0.03, -0.03])


@pytest.fixture(scope="module")
def walked(pegasus):
    """One cycle over level ground that the map has 3 cm too high, and too low, ahead of the first stance."""
    engine = mjx_engine(pegasus)
    numbers = (0.46, 0.0, 0.0, 0.16, 0.6, 0.36, 0.06, 0.45, 0.5, 0.0)
    params = GaitParams(*(jnp.asarray(x) for x in numbers))
    options = settings(bend=np.rad2deg(0.3), threshold=0.01)
    machine = extended(9, back=0.04, allowance=0.05, limit=8.0)
    true = flat(Grid(80, 40, 0.04, (-1.2, -0.8)))

    def lane(error):
        x = true.origin[0] + true.resolution * jnp.arange(80.0)
        believed = dataclasses.replace(true, elevation=true.elevation + jnp.where(x > 0.36, error, 0.0)[:, None])
        choice = no_choice(1, jnp.asarray(0.0).dtype)
        walk = crawl(pegasus, params, options, believed, choice.offset, choice.found)
        return walk_reactively(engine, pegasus, Ground(), true, walk, machine, feeling(), jnp.asarray(DT), TICKS)

    return jax.tree.map(np.asarray, jax.jit(jax.vmap(lane))(ERROR))


def test_a_walk_whose_map_is_wrong_ends_on_its_feet(walked, pegasus):
    assert np.all(walked.alive)
    assert np.all(walked.done[:, -1])
    heights = walked.foot[:, -1, :, 2]
    np.testing.assert_allclose(heights, float(pegasus.contact_radius), atol=3e-3)
    assert np.all(walked.normal_force[:, -1] > 20.0)


def test_a_foot_that_finds_no_ground_goes_on_down_and_one_that_meets_it_early_stops(walked):
    """Of the front feet, which step to where the map is wrong."""
    swings = [phase for phase, leg in enumerate(SWING_LEG) if leg != SHIFT]
    assert np.all(walked.contact.sum(axis=1) == len(swings))
    for phase in swings[1::2]:
        modes = [set(walked.mode[lane, walked.phase[lane] == phase]) for lane in range(len(ERROR))]
        assert [Mode.DOWN in seen for seen in modes] == [True, False]


def test_what_is_felt_is_the_contact(walked):
    """The estimate against the true normal force on level ground through the same low pass."""
    true, share = np.zeros_like(walked.normal_force), DT / (float(feeling().delay) + DT)
    for t in range(TICKS):
        before = true[:, t - 1] if t else 0.0
        true[:, t] = before + (walked.normal_force[:, t] - before) * share
    np.testing.assert_allclose(walked.felt[..., 2], true, atol=0.1)


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


def test_the_trunk_follows_the_feet(walked):
    """Where the map has the ground too high the plan lifts the trunk; the feet, felt lower, take it down again."""
    swung = walked.phase[0] == 3  # the shift after the first front foot has landed 3 cm under its plan
    assert np.ptp(walked.trunk[0, swung, 2]) > 0.015
    assert walked.trunk[0, swung, 2][-1] < walked.trunk[0, swung, 2][0]
