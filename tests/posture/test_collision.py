"""Clearances against the ground as columns, point by point in NumPy: no contact is missed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.leg.kinematics import foot_position
from jaxleg.posture.body import joint_angles
from jaxleg.posture.collision import SHANK, THIGH, Sizes, leg_clearance, leg_points, trunk_clearance
from jaxleg.rotations import trunk_rotation
from jaxleg.terrain import HeightMap
from jaxleg.terrain.obstacles import obstacles

rotation_of, feet_of = jax.jit(trunk_rotation), jax.jit(jax.vmap(foot_position))
SIZE, SHAPE = 0.04, (45, 40)
FEET = np.array([[0.33, 0.18, 0.0], [0.29, -0.17, 0.0], [-0.3, 0.18, 0.0], [-0.26, -0.2, 0.0]])


def ground(seed):
    rng = np.random.default_rng(seed)
    elevation = rng.uniform(-0.1, 0.25, SHAPE) * (rng.random(SHAPE) < 0.06)
    elevation[rng.random(SHAPE) < 0.05] = np.nan
    return elevation


def poses(seed, count=12):
    rng = np.random.default_rng(seed)
    low, high = [-0.05, -0.05, 0.25, -0.3, -0.3, -0.3], [0.05, 0.05, 0.5, 0.3, 0.3, 0.3]
    return rng.uniform(low, high, (count, 6)), FEET + rng.uniform(-0.04, 0.04, (count, 4, 3))


@pytest.fixture(scope="module")
def clearances(pegasus):
    spacing = Sizes.of(pegasus).trunk_spacing

    @jax.jit
    def run(elevation, poses, feet):
        terrain = HeightMap(elevation, jnp.array([-0.9, -0.8]), jnp.array(SIZE))
        seen = obstacles(terrain, SIZE, float(pegasus.leg_radius), spacing)

        def one(pose, feet):
            angles, _ = joint_angles(pegasus, pose, feet)
            legs = leg_clearance(pegasus, seen, pose, angles)
            return legs, trunk_clearance(pegasus, seen, pose), leg_points(pegasus, pose, angles), angles

        return jax.vmap(one)(poses, feet)

    return run


def columns(elevation):
    """Centres (n, 2) and tops of the seen cells."""
    i, j = np.nonzero(np.isfinite(elevation))
    return np.column_stack([-0.9 + SIZE * i, -0.8 + SIZE * j]), elevation[i, j]


def touches(point, radius, centres, tops):
    """Whether a sphere meets a square column that goes down for ever."""
    away = np.maximum(np.abs(point[:2] - centres) - SIZE / 2, 0.0)
    up = np.maximum(point[2] - tops, 0.0)
    return np.any((away**2).sum(axis=1) + up**2 < radius**2 * (1 - 1e-9))


@pytest.mark.parametrize("seed", range(3))
def test_no_contact_of_a_leg_is_missed(clearances, pegasus, seed):
    elevation, radius = ground(seed), float(pegasus.leg_radius)
    legs, _, points, _ = clearances(elevation, *poses(seed))
    centres, tops = columns(elevation)
    hit = np.array([[any(touches(p, radius, centres, tops) for p in leg) for leg in lane] for lane in np.asarray(points)])
    assert np.all(np.asarray(legs)[hit] < 0.0)
    assert 0.05 < hit.mean() < 0.95
    assert np.mean(np.asarray(legs)[~hit] < 0.0) < 0.6  # and not all is called one


@pytest.mark.parametrize("seed", range(3))
def test_no_contact_of_the_trunk_is_missed(clearances, pegasus, seed):
    elevation = ground(seed)
    place, feet = poses(seed)
    _, trunk, _, _ = clearances(elevation, place, feet)
    face = np.stack(np.meshgrid(*(np.linspace(-0.5, 0.5, 60),) * 2, [-0.5], indexing="ij"), axis=-1).reshape(-1, 3)
    for pose, clear in zip(place, np.asarray(trunk)):
        at = pose[:3] + face * np.asarray(pegasus.trunk_size) @ np.asarray(rotation_of(pose[3:])).T
        cell = np.round((at[:, :2] - [-0.9, -0.8]) / SIZE).astype(int)
        below = np.nan_to_num(elevation[tuple(np.clip(cell, 0, np.array(SHAPE) - 1).T)], nan=-np.inf)
        true = np.min(at[:, 2] - below)
        assert clear <= true + 1e-6


def test_unseen_ground_is_no_obstacle(clearances):
    """As good as a hole deeper than all others."""
    elevation = ground(0)
    hole = np.where(np.isfinite(elevation), elevation, -50.0)
    for seen, wanted in zip(clearances(elevation, *poses(0))[:2], clearances(hole, *poses(0))[:2]):
        np.testing.assert_array_equal(seen, wanted)


def test_points_lie_on_thighs_and_shanks(clearances, pegasus):
    _, _, points, angles = clearances(ground(0), *poses(5))
    assert points.shape[2] == len(THIGH) + len(SHANK)
    place, _ = poses(5)
    for pose, lane, q in zip(place, np.asarray(points), np.asarray(angles)):
        rotation = np.asarray(rotation_of(pose[3:]))
        feet = np.add(feet_of(pegasus.joint_axis, pegasus.link_offset, q), pegasus.hip_position)
        for leg in range(4):
            foot, knee = pose[:3] + rotation @ feet[leg], lane[leg, 1]
            np.testing.assert_allclose(np.linalg.norm(foot - knee), 0.34, atol=1e-9)
            for k, share in enumerate(SHANK):
                np.testing.assert_allclose(lane[leg, 2 + k], knee + share * (foot - knee), atol=1e-9)
