"""The proxy against the same walk sampled finely and worked out by MuJoCo, scipy and the trapezoid rule; and a lane without a
foothold among others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from jaxleg.foothold.contract import FootholdStatus
from jaxleg.status import Status
from jaxleg.walk.proxy import evaluate
from jaxleg.walk.reference import instants, to_reference
from tests.crawls import crawl, gait, in_numpy, settings, terrain_of
from tests.motions import Mujoco

FINE = (121, 301)  # samples a shift and a swing
TERRAIN = terrain_of("rough")
OFFSETS = 0.02 * np.random.default_rng(4).normal(size=(2, 4, 2))
CHOICE = np.zeros((2, 2, 4), np.int32)
CHOICE[0, 1, 2] = FootholdStatus.NONE  # the first lane's left hind leg finds no foothold
CHOICE[1] = FootholdStatus.NEAREST


@pytest.fixture(scope="module")
def lanes(pegasus):
    """Two lanes that differ in their status alone: walks, proxies, and references and instants of fine samples."""

    @jax.jit
    @jax.vmap
    def run(status):
        walk = crawl(pegasus, gait(0.47), settings(), TERRAIN, jnp.asarray(OFFSETS), status)
        time, at = instants(pegasus, walk, FINE)
        return walk, evaluate(pegasus, walk), to_reference(time, at), jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), at)

    walk, *rest = run(CHOICE)
    return in_numpy(walk), *jax.tree.map(np.asarray, rest)


@pytest.fixture(scope="module")
def sampled(lanes):
    """The good lane: its proxy, the reference and MuJoCo's configuration at each fine sample."""
    proxy, track, at = jax.tree.map(lambda x: x[1], lanes[1:])
    q = np.concatenate([track.trunk_pos, track.trunk_quat, track.joint_pos.reshape(-1, 12)], axis=1)
    return proxy, track, at, q


def test_energy_is_the_integral_of_torque_times_speed_and_of_heat(sampled):
    proxy, track, _, _ = sampled
    torque, time = track.joint_torque, track.time
    mechanical = torque * track.joint_vel
    watts = mechanical, np.maximum(mechanical, 0.0), (torque / (0.217 * 44.5)) ** 2 * 2.28
    for found, power in zip(proxy.energy, watts):
        np.testing.assert_allclose(found, np.trapezoid(power, time, axis=0), rtol=5e-3, atol=5e-3)
        np.testing.assert_allclose(np.sum(found), np.trapezoid(power.sum(axis=(1, 2)), time), rtol=1e-3)


def test_distance_and_time_are_those_of_the_walk(sampled):
    proxy, track, _, _ = sampled
    np.testing.assert_allclose(proxy.distance, track.trunk_pos[-1, 0] - track.trunk_pos[0, 0], atol=1e-12)
    np.testing.assert_allclose(proxy.time, track.time[-1], rtol=1e-12)
    np.testing.assert_allclose(proxy.distance / proxy.time, 0.05, rtol=1e-9)  # as the settings ask


def test_the_margin_is_the_least_of_the_centre_of_mass_in_the_hull_of_the_loaded_feet(sampled, pegasus):
    proxy, track, _, q = sampled
    mujocos, margins = Mujoco(pegasus), []
    for k in range(0, len(q), 5):
        body, loaded = mujocos(q[k]), track.contact[k] > 0.01
        sides = ConvexHull(body.feet[loaded, :2]).equations
        margins.append(np.min(-sides[:, :2] @ body.com[:2] - sides[:, 2]))
    np.testing.assert_allclose(proxy.checks.margin, min(margins), atol=1e-3)
    assert max(margins) > min(margins) + 0.03


def test_the_knees_bend_is_the_least_between_thigh_and_shank(sampled, pegasus):
    """Thigh and knee joints and feet by MuJoCo; the angle between the links, from 0 when stretched."""
    proxy, _, _, q = sampled
    mujocos, bends = Mujoco(pegasus), []
    for row in q[::5]:
        feet = mujocos(row).feet
        thigh, knee = mujocos.data.xpos[3::3], mujocos.data.xpos[4::3]
        upper, lower = knee - thigh, feet - knee
        bends.append(np.min(np.arccos(np.sum(upper * lower, axis=1) / (0.26 * 0.34))))
    np.testing.assert_allclose(proxy.checks.knee_bend, min(bends), atol=2e-3)


def test_torque_and_joint_room_are_the_worst_of_the_walk(sampled, pegasus):
    proxy, track, _, _ = sampled
    ratio = np.abs(track.joint_torque).max() / 60.0
    np.testing.assert_allclose(proxy.checks.torque_ratio, ratio, rtol=0.01)
    angles, spans = track.joint_pos, np.asarray(pegasus.joint_range)
    room = np.minimum(angles - spans[..., 0], spans[..., 1] - angles).min()
    np.testing.assert_allclose(proxy.checks.joint_room, room, atol=2e-3)


def test_the_load_is_the_least_of_a_standing_foot_over_a_quarter_of_the_weight(sampled):
    """`at.load` itself is held against inverse dynamics in test_reference_in_motion."""
    proxy, track, at, _ = sampled
    load = np.where(track.contact > 0.01, at.load, np.inf)
    np.testing.assert_allclose(proxy.checks.load, load.min() / (0.25 * 35.2 * 9.81), atol=0.01)
    assert proxy.checks.load < 0.5


def test_the_lowering_is_the_walks(lanes):
    np.testing.assert_array_equal(lanes[1].checks.lowering, lanes[0].lowering)


def test_a_leg_without_a_foothold_makes_its_lane_infeasible_and_no_other(lanes):
    walk, proxy, *_ = lanes
    assert proxy.checks.status.tolist() == [Status.NO_FOOTHOLD, Status.OK]
    for numbers in (walk.footholds, walk.poses, *proxy.energy, proxy.checks.margin):
        np.testing.assert_array_equal(numbers[0], numbers[1])
