"""The crawl where its numbers can be worked out by hand: the swing's apex over boxes, way-points on ramps, the lowering."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.gait.support import CogRule
from jaxleg.leg.kinematics import knee_bend
from jaxleg.posture.body import joint_angles
from jaxleg.posture.incentre import held_heights, lowering_needed, waypoint
from jaxleg.rotations import trunk_rotation
from jaxleg.terrain import Grid
from tests.crawls import crawl, gait, in_numpy, settings

GRID = Grid(112, 52, 0.02, (-0.9, -0.51))
X = GRID.origin[0] + GRID.resolution * np.arange(GRID.nx)
LIFT, CLEARANCE, RADIUS, DISC = 0.2, 0.02, 0.004, 0.02
NONE = np.zeros((2, 4, 2)), np.zeros((2, 4), np.int32)
heights, lowering = jax.jit(held_heights), jax.jit(lowering_needed)


@pytest.fixture(scope="module")
def walk(pegasus):
    """One cycle over a profile along x, with a low swing."""

    @jax.jit
    def plan(robot, elevation, swing):
        none = map(jnp.asarray, NONE)
        return crawl(robot, gait(0.46, swing=swing, lift=LIFT), settings(), GRID.map(elevation), *none)

    def over(profile, swing=0.03):
        return in_numpy(plan(pegasus, np.repeat(profile[:, None], GRID.ny, axis=1), swing))

    return over


def block(low, high, height):
    return np.where((low - 1e-9 <= X) & (high + 1e-9 >= X), height, 0.0)


def foot_at(share, start, end, apex):
    """Compound cycloid: across, and up from the nearer end to the apex over the higher one."""
    inner = np.clip((share - LIFT) / (1.0 - 2.0 * LIFT), 0.0, 1.0)
    across = start[0] + (end[0] - start[0]) * (inner - np.sin(2.0 * np.pi * inner) / (2.0 * np.pi))
    base = np.where(share < 0.5, start[2], end[2])
    top = max(start[2], end[2]) + apex
    return across, base + (top - base) * (1.0 - np.cos(2.0 * np.pi * share)) / 2.0


def least_room(profile, start, end, apex):
    """Least clearance of the sole over the columns of ground within the foot's radius, one a cell, less what is asked for: the
    clearance in mid-swing."""
    share = np.linspace(0.15, 0.85, 701)
    x, z = foot_at(share, start, end, apex)
    near = np.abs(x[:, None] - X) < DISC + 0.5 * GRID.resolution
    ground = np.max(np.where(near, profile, -np.inf), axis=1)
    return np.min(z - RADIUS - ground - CLEARANCE * (1.0 - np.cos(2.0 * np.pi * share)) / 2.0)


def swings(walk):
    """Start, end and apex of each swing."""
    phases = walk.phases
    for phase, leg in zip(*np.nonzero(phases.swings)):
        yield phases.feet_from[phase, leg], phases.feet_to[phase, leg], phases.flight.apex[phase]


def test_on_level_ground_nothing_is_raised(walk):
    for swing in (0.03, 0.08):
        planned = walk(np.zeros(GRID.nx), swing)
        assert len(list(swings(planned))) == 4
        assert all(apex == swing for _, _, apex in swings(planned))
        assert planned.phases.flight.apex.sum() == pytest.approx(4 * swing)


@pytest.mark.parametrize("height", [0.06, 0.12])
@pytest.mark.parametrize("place", [0.5, 0.35, 0.65])
def test_a_swing_over_a_box_is_raised_as_much_as_needed(walk, height, place):
    """The right front foot goes from 0.26 to 0.46 m over a box of 4 cm on its way."""
    level = list(swings(walk(np.zeros(GRID.nx))))
    start, end, _ = level[1]
    np.testing.assert_allclose([start[0], end[0]], [0.26, 0.46], atol=1e-9)
    middle = 0.02 * round((0.26 + 0.2 * place) / 0.02)
    profile = block(middle - 0.02, middle + 0.02, height)
    start, end, apex = list(swings(walk(profile)))[1]
    room = least_room(profile, start, end, apex)
    assert -1e-9 < room < 0.02  # between two looks the ground counts as the higher one's, the foot as the lower one's
    if place == 0.5:
        assert height + CLEARANCE < apex < 1.1 * height + CLEARANCE  # its sides count, too


@pytest.mark.parametrize("rise", [0.08, -0.08])
def test_a_swing_on_to_a_ledge_or_off_it_clears_its_edge_and_hardly_more(walk, rise):
    """The apex counts from the higher end, be it the start or the landing."""
    profile = np.where((0.315 if rise > 0.0 else 0.405) < X, rise, 0.0)
    start, end, apex = list(swings(walk(profile, 0.01)))[1]
    np.testing.assert_allclose(end[2] - start[2], rise, atol=1e-9)
    room = least_room(profile, start, end, apex)
    assert -1e-9 < room < 0.01


def test_a_higher_box_raises_as_much_more(walk):
    """Over the middle of the swing, where the lift is whole: 3 cm for 3 cm."""
    low, high = (list(swings(walk(block(0.34, 0.38, height))))[1][2] for height in (0.09, 0.12))
    np.testing.assert_allclose(high - low, 0.03, rtol=0.25)


FEET = np.array([[0.33, 0.18, 0.05], [0.27, -0.18, 0.07], [-0.27, 0.18, -0.01], [-0.33, -0.18, 0.01]])
LEFT, RIGHT = (0, 2), (1, 3)


@pytest.mark.parametrize(("standing", "swinging"), [(LEFT, RIGHT), (RIGHT, LEFT)])
def test_a_way_point_has_its_height_and_pitch_by_hand(pegasus, standing, swinging):
    """Front feet 6 cm higher than hind ones, 0.6 m apart: a nose up by atan 0.1; 0.45 m over the feet's mean of 3 cm."""
    params = gait(0.45, offset=-0.07)
    cog = CogRule(jnp.asarray(0.5))
    pose = np.asarray(jax.jit(waypoint)(pegasus, params, cog, FEET, FEET, jnp.asarray(swinging[1]), 0.0))
    np.testing.assert_allclose(pose[2], 0.03 + 0.45, atol=1e-12)
    np.testing.assert_allclose(pose[3:], [np.arctan(0.1), 0.0, 0.0], atol=1e-12)
    nose = np.asarray(jax.jit(trunk_rotation)(pose[3:]))[:, 0]
    np.testing.assert_allclose(nose[2] / nose[0], 0.1, atol=1e-12)
    assert (pose[1] > 0) == (standing == LEFT)  # over the standing side


def test_height_and_pitch_are_of_the_mean_of_the_feet_before_and_after(pegasus):
    after = FEET + np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.04], [0.0, 0.0, 0.0], [0.2, 0.0, 0.04]])
    cog = CogRule(jnp.asarray(0.5))
    pose = np.asarray(jax.jit(waypoint)(pegasus, gait(0.45), cog, FEET, after, jnp.asarray(RIGHT[1]), 0.0))
    np.testing.assert_allclose(pose[2], 0.03 + 0.01 + 0.45, atol=1e-12)
    np.testing.assert_allclose(pose[3], np.arctan(0.1), atol=1e-12)


def test_heights_are_held_until_they_differ_by_more_than_the_threshold():
    wanted = np.array([0.40, 0.409, 0.411, 0.402, 0.400, 0.431])
    np.testing.assert_array_equal(heights(wanted, 0.01), [0.40, 0.40, 0.411, 0.411, 0.400, 0.431])


@pytest.mark.parametrize(
    ("bend_deg", "ahead", "height", "lowered"),
    [
        (0.0, 0.20, 0.60, 0.60 - 0.565685425),  # sqrt(0.6^2 - 0.2^2)
        (60.0, 0.20, 0.60, 0.60 - 0.481248377),  # sqrt(0.2716 - 0.2^2), 0.2716 by the law of cosines
        (60.0, -0.10, 0.56, 0.56 - 0.511468474),
        (60.0, 0.10, 0.50, 0.0),
    ],
)
def test_the_lowering_is_the_quadratics_by_hand(pegasus, bend_deg, ahead, height, lowered):
    """Hips level, each foot so far ahead of its hip in the plane of its leg."""
    lateral = 0.08 * np.array([1.0, -1.0, 1.0, -1.0])
    feet = np.asarray(pegasus.hip_position) + np.column_stack([np.full(4, ahead), lateral, np.full(4, -height)])
    needed, left = lowering(pegasus, np.zeros(6), feet, np.deg2rad(bend_deg))
    np.testing.assert_allclose(needed, lowered, atol=1e-8)
    assert np.all(np.asarray(left) > 0.0)


def test_no_lowering_helps_a_foot_that_is_too_far_ahead(pegasus):
    feet = np.asarray(pegasus.hip_position) + np.array([0.61, 0.0, -0.5])
    _, left = lowering(pegasus, np.zeros(6), feet, np.deg2rad(0.0))
    assert np.all(np.asarray(left) < 0.0)


def test_lowered_a_turned_trunks_knees_have_the_bend_asked_for(pegasus):
    """Straight down in the world, however the trunk is turned; the hip link has a part along x, too."""
    links = np.array(pegasus.link_offset)
    links[:, 0, 0] = [0.03, 0.03, -0.03, -0.03]
    robot = dataclasses.replace(pegasus, link_offset=jnp.asarray(links))
    pose = np.array([0.02, -0.01, 0.62, 0.15, -0.1, 0.2])
    feet = np.array([[0.36, 0.2, 0.03], [0.28, -0.2, 0.0], [-0.28, 0.2, 0.01], [-0.36, -0.2, -0.02]])
    needed = np.asarray(lowering(robot, pose, feet, np.deg2rad(35.0))[0])
    assert np.all(needed > 0.0)
    bends = jax.jit(jax.vmap(knee_bend))
    for leg in range(4):
        angles, _ = jax.jit(joint_angles)(robot, pose - needed[leg] * np.eye(6)[2], feet)
        bend = bends(robot.joint_axis, robot.link_offset, angles)
        np.testing.assert_allclose(np.asarray(bend)[leg], np.deg2rad(35.0), atol=1e-9)
