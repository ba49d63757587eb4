"""Clearances and shift times worked out by hand: level ground, slanted links, a box that just is or is not in the way."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxleg.gait.phases import Phases, no_flights
from jaxleg.gait.timing import shift_time
from jaxleg.posture.collision import Sizes, leg_clearance, trunk_clearance
from jaxleg.rotations import trunk_quaternion
from jaxleg.terrain import HeightMap
from jaxleg.terrain.obstacles import obstacles
from jaxleg.walk.trajectory import trunk_path
from tests.motions import Mujoco

SIZE, SHAPE, ORIGIN = 0.04, (60, 50), np.array([-1.2, -1.0])
POSES = np.array([[0.0, 0.0, 0.46, 0.0, 0.0, 0.0], [0.05, -0.04, 0.5, 0.2, -0.15, 0.4], [-0.03, 0.02, 0.4, -0.1, 0.25, -0.7]])
ANGLES = np.array([[0.1, -0.7, 1.3], [-0.2, -0.5, 1.1], [0.15, -0.9, 1.4], [0.0, -0.6, 1.5]])


@pytest.fixture(scope="module")
def slanted(pegasus):
    """Thighs and shanks with a part ahead and aside."""
    links = np.asarray(pegasus.link_offset).copy()
    links[:, 1] += np.array([0.06, 0.0, 0.0])
    links[:, 2] += np.array([-0.05, 0.0, 0.0])
    links[:, 1, 1] += 0.02 * np.array([1.0, -1.0, 1.0, -1.0])
    return dataclasses.replace(pegasus, link_offset=jnp.asarray(links))


@pytest.fixture(scope="module")
def clear(pegasus):
    """Clearances of the legs and of the trunk."""
    spacing = Sizes.of(pegasus).trunk_spacing

    @jax.jit
    def run(robot, elevation, pose, angles):
        terrain = HeightMap(elevation, jnp.asarray(ORIGIN), jnp.array(SIZE))
        ground = obstacles(terrain, SIZE, float(pegasus.leg_radius), spacing)
        return leg_clearance(robot, ground, pose, angles), trunk_clearance(robot, ground, pose)

    return lambda robot, elevation, pose: run(robot, elevation, pose, ANGLES)


def axes_of(robot, pose):
    """Points on the axes of thighs and shanks but for the shank's lower quarter, by MuJoCo's kinematics: (leg, point, 3)."""
    mujocos = Mujoco(robot)
    feet = mujocos(np.concatenate([pose[:3], jax.jit(trunk_quaternion)(pose[3:]), ANGLES.ravel()])).feet
    thigh, knee = mujocos.data.xpos[3::3].copy(), mujocos.data.xpos[4::3].copy()
    upper, lower = np.linspace(0.5, 1.0, 11)[:, None, None], np.linspace(0.2, 0.75, 12)[:, None, None]
    return np.concatenate([thigh + upper * (knee - thigh), knee + lower * (feet - knee)]).swapaxes(0, 1)


@pytest.mark.parametrize("pose", POSES)
def test_over_level_ground_it_is_the_height_of_the_lowest_point_less_the_radius(clear, pegasus, slanted, pose):
    for robot in (pegasus, slanted):
        legs, _ = clear(robot, np.full(SHAPE, -0.1), pose)
        np.testing.assert_allclose(legs, axes_of(robot, pose)[..., 2].min(axis=1) + 0.1 - 0.02, atol=1e-9)


@pytest.mark.parametrize("pose", POSES)
def test_over_level_ground_the_trunk_clears_by_its_lowest_corner(clear, pegasus, pose):
    """Corners of a box of 0.80 x 0.24 x 0.15 m, turned by yaw, nose-up pitch and roll."""
    turn = Rotation.from_euler("ZYX", [pose[5], -pose[3], pose[4]])
    corners = turn.apply([[0.4 * x, 0.12 * y, -0.075] for x in (1, -1) for y in (1, -1)])
    _, trunk = clear(pegasus, np.full(SHAPE, 0.05), pose)
    np.testing.assert_allclose(trunk, pose[2] + corners[:, 2].min() - 0.05, atol=1e-9)


def columns(elevation):
    """Sides (n, 2, 2) and tops of the cells that stand out."""
    i, j = np.nonzero(elevation > 0.0)
    centre = ORIGIN + SIZE * np.column_stack([i, j])
    return np.stack([centre - SIZE / 2, centre + SIZE / 2], axis=1), elevation[i, j]


def gap(points, elevation):
    """Least height of points over the columns within 2 cm of them along x and y, or over level ground: (leg,)."""
    sides, tops = columns(elevation)
    near = np.all((points[..., None, :2] > sides[:, 0] - 0.02) & (points[..., None, :2] < sides[:, 1] + 0.02), axis=-1)
    under = np.max(np.where(near, tops, 0.0), axis=-1)
    return np.min(points[..., 2] - 0.02 - under, axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_a_column_counts_where_a_leg_is_within_its_radius_and_not_further_off(clear, slanted, seed):
    """One lower and one upper bound: the columns near the axes, and those near the points tested along them."""
    rng = np.random.default_rng(seed)
    elevation = np.where(rng.random(SHAPE) < 0.05, rng.uniform(0.05, 0.3, SHAPE), 0.0)
    for pose in POSES:
        legs, _ = clear(slanted, elevation, pose)
        dense = axes_of(slanted, pose)
        tested = dense[:, [0, 10, 11, 15, 19, 22]]  # half the thigh, the knee, and 0.2, 0.4 of the shank, about 0.6 and 0.75
        assert np.all(np.asarray(legs) >= gap(dense, elevation) - 0.01)
        assert np.all(np.asarray(legs) <= gap(tested[:, [0, 1, 2]], elevation) + 1e-9)


def test_a_box_beside_the_trunk_is_none_under_it(clear, pegasus):
    """Level at 0.46 m: the lower face is at 0.385 m, its side 0.12 m off."""
    across = np.abs(ORIGIN[1] + SIZE * np.arange(SHAPE[1]))[None] * np.ones((SHAPE[0], 1))
    far, near = (np.where(across > edge, 0.5, 0.0) for edge in (0.34, 0.13))
    assert clear(pegasus, far, POSES[0])[1] == pytest.approx(0.385)
    assert clear(pegasus, near, POSES[0])[1] == pytest.approx(0.385 - 0.5)


way_of = jax.jit(jax.vmap(trunk_path, in_axes=(None, 0)))


def moves(start, end, seconds):
    """Greatest acceleration of the trunk's centre, and 0.4 m times that of its turn, in a shift of so many seconds."""
    none = np.zeros((4, 3))
    still = jax.tree.map(lambda x: x[0], no_flights(1, start.dtype))
    phase = Phases(np.array(0.0), np.array(seconds), start, end, none, none, still, np.zeros(4))
    path = np.asarray(way_of(phase, np.linspace(0.0, 1.0, 2001)))
    rate = np.diff(path, 2, axis=0) / (seconds / 2000) ** 2
    return np.linalg.norm(rate[:, :3], axis=1).max(), 0.4 * np.linalg.norm(rate[:, 3:], axis=1).max()


@pytest.mark.parametrize(
    ("way", "turn", "acceleration", "seconds"),
    [
        ((0.1, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 0.759836),  # sqrt(10 / sqrt 3 x 0.1 / 1)
        ((0.03, 0.0, 0.04), (0.0, 0.0, 0.0), 2.0, 0.379918),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.25), 1.0, 0.759836),  # 0.4 m x 0.25 rad
        ((0.06, 0.08, 0.0), (0.15, 0.2, 0.0), 1.0, 1.074570),  # both: their sum
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 0.0),
    ],
)
def test_a_shift_takes_as_long_as_its_acceleration_allows(way, turn, acceleration, seconds):
    start = np.array([0.1, 0.2, 0.4, 0.1, -0.1, 0.3])
    end = start + np.array([*way, *turn])
    took = jax.jit(shift_time)(start, end, acceleration)
    np.testing.assert_allclose(took, seconds, atol=2e-6)
    if seconds:
        centre, edge = moves(start, end, float(took))
        np.testing.assert_allclose(centre + edge, acceleration, rtol=1e-3)
