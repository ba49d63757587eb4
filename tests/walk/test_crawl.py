"""Laws of the crawl: what the nominal stance, the way-points and the phases of paper A must satisfy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.gait.support import overlap_incentre
from jaxleg.posture.body import com_offset, joint_angles
from jaxleg.posture.incentre import held_heights
from jaxleg.terrain.heightmap import height
from jaxleg.walk.trajectory import foot_path, trunk_path
from tests.crawls import gait, settings, terrain_of, way_points


def test_a_foot_sweeps_exactly_one_step_round_the_foot_offset(walk_on, pegasus):
    walk = walk_on(gait(offset=-0.08, length=0.6))  # A7, mirrored skew, stance as long as the hip spacing
    phases = walk.phases
    hips = phases.trunk_from[:, None, :1] + np.asarray(pegasus.hip_position)[None, :, :1]
    ahead_before = (phases.feet_from[..., :1] - hips)[..., 0]
    ahead_after = (phases.feet_to[..., :1] - hips)[..., 0]
    swings = phases.swings.astype(bool)
    np.testing.assert_allclose(ahead_before[swings], -0.08 - 0.1, atol=1e-12)
    np.testing.assert_allclose(ahead_after[swings], -0.08 + 0.1, atol=1e-12)


def test_cycles_advance_by_the_step_at_the_speed(walk_on):
    walk = walk_on(gait(step=0.23, skew=0.05))
    np.testing.assert_allclose(np.diff(way_points(walk)[::2, 0]), 0.23, atol=1e-12)
    np.testing.assert_allclose(walk.phases.duration.reshape(2, 6).sum(axis=1), 0.23 / 0.05, rtol=1e-12)
    np.testing.assert_allclose(walk.way, 2 * 0.23, rtol=1e-12)


@pytest.mark.parametrize("kind", ["flat", "rough", "stairs"])
def test_phases_follow_one_another_without_a_jump(walk_on, kind):
    phases = walk_on(gait(), kind).phases
    np.testing.assert_allclose(phases.trunk_to[:-1], phases.trunk_from[1:], atol=1e-12)
    np.testing.assert_allclose(phases.feet_to[:-1], phases.feet_from[1:], atol=1e-12)
    np.testing.assert_allclose(np.diff(phases.start), phases.duration[:-1], rtol=1e-9)
    moved = np.any(phases.feet_from != phases.feet_to, axis=-1)
    assert not np.any(moved & ~phases.swings.astype(bool))
    order = [int(np.argmax(row)) if row.any() else -1 for row in phases.swings]
    assert order[:6] == [-1, 3, 1, -1, 2, 0]  # RH, RF, LH, LF (paper A, II.A)


def test_the_centre_of_mass_stands_over_the_overlap(walk_on, pegasus):
    walk = walk_on(gait())
    feet_before, feet_after = walk.phases.feet_from[1], walk.phases.feet_to[2]  # the right legs' swings
    centre = jax.jit(overlap_incentre)(feet_before[0, :2], feet_before[2, :2], feet_before[1, :2], feet_after[3, :2])
    com = way_points(walk)[1, :3] + jax.jit(com_offset)(pegasus, way_points(walk)[1], 0.5 * (feet_before + feet_after))
    assert abs(com[1] - centre[1]) < 1e-3
    np.testing.assert_allclose(way_points(walk)[1, 0] - 0.1, centre[0], atol=1e-12)  # feet 0.1 m behind the hips


def test_the_median_rule_moves_the_way_points_along_the_median(walk_on):
    """C (21) beside A's in-centre: nearer to the standing side as the ratio grows, the same stance and step."""
    sway = [way_points(walk_on(gait(), rule="median", ratio=ratio))[1, 1] for ratio in (0.2, 0.8)]
    assert 0.0 < sway[0] < sway[1]  # the left legs stand first
    np.testing.assert_allclose(np.diff(way_points(walk_on(gait(), rule="median"))[::2, 0]), 0.2, atol=1e-12)


@pytest.mark.parametrize("threshold", [0.0, 0.01, 0.05, 10.0])
def test_small_changes_of_height_are_suppressed(threshold):
    wanted = np.cumsum(np.random.default_rng(2).normal(0.0, 0.02, 50))
    held, last = [], wanted[0]
    for now in wanted:
        last = now if abs(now - last) > threshold else last
        held.append(last)
    np.testing.assert_array_equal(jax.jit(held_heights)(wanted, threshold), held)
    assert threshold != 10.0 or len(set(held)) == 1


def test_the_trunk_keeps_its_height_below_the_threshold(walk_on):
    free, held = (way_points(walk_on(gait(0.46), "rough", threshold=x))[:, 2] for x in (0.0, 1.0))
    assert np.ptp(free) > 0.002
    np.testing.assert_allclose(held, held[0], atol=1e-12)


@jax.jit
def least_bend(pegasus, walk):
    shares = jnp.linspace(0.0, 1.0, 41)

    def knee(phase, share):
        angles, _ = joint_angles(pegasus, trunk_path(phase, share), foot_path(phase, share, 0.1))
        return jnp.min(jnp.abs(angles[:, 2]))

    return jnp.min(jax.vmap(lambda s: jax.vmap(knee, in_axes=(0, None))(walk.phases, s))(shares))


@pytest.mark.parametrize(("height_m", "kind"), [(0.57, "flat"), (0.50, "stairs"), (0.56, "rough")])
def test_the_trunk_is_lowered_just_until_the_legs_fit(walk_on, pegasus, height_m, kind):
    walk = walk_on(gait(height_m), kind, bend=25.0)
    assert walk.lowering > 0.0
    np.testing.assert_allclose(least_bend(pegasus, walk), np.deg2rad(25.0), atol=2e-4)


def test_a_trunk_that_fits_is_not_lowered(walk_on):
    assert walk_on(gait(0.46)).lowering == 0.0


def test_on_stairs_the_trunk_pitches_with_them(walk_on):
    pitch = way_points(walk_on(gait(0.45, step=0.3, skew=0.15, length=0.6), "stairs"))[:, 3]
    np.testing.assert_allclose(pitch, np.arctan2(0.08, 0.30), atol=0.06)


@jax.jit
def height_over_ground(phases, terrain):
    feet = jax.vmap(lambda s: jax.vmap(lambda p: foot_path(p, s, 0.1))(phases))(jnp.linspace(0.3, 0.7, 41))
    ground = jax.vmap(height, in_axes=(None, 0))(terrain, feet[..., :2].reshape(-1, 2))
    return feet[..., 2] - ground.reshape(feet.shape[:-1])


@pytest.mark.parametrize("kind", ["rough", "stairs"])
def test_the_swing_clears_the_ground(walk_on, pegasus, kind):
    walk = walk_on(gait(lift=0.2, swing=0.03), kind)
    clear = height_over_ground(walk.phases, terrain_of(kind)) - float(pegasus.contact_radius)
    clear = np.where(walk.phases.swings.astype(bool), clear, np.inf)
    assert clear.min() > 0.012  # demanded: 0.02 at the top, less beside it
    assert settings().clearance == 0.02
