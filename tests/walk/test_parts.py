"""Parts of one planner in others' company: any heading, way-points lowered by themselves, the cascade offered to a tree."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.foothold.cascade import Cascade
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.foothold.rectangle import SearchRectangle, extent_of, feasible_score
from jaxleg.gait.nominal import nominal_stances
from jaxleg.gait.support import CogRule
from jaxleg.leg.kinematics import knee_bend
from jaxleg.posture.body import joint_angles
from jaxleg.posture.collision import Sizes
from jaxleg.rotations import turned
from jaxleg.status import Status
from jaxleg.terrain import Grid, flat, stairs
from jaxleg.terrain.footing import FootingRule
from jaxleg.walk.build import build_walk
from jaxleg.walk.choose import choose
from jaxleg.walk.config import Navigation
from jaxleg.walk.presets import paper_a, paper_c
from jaxleg.walk.site import site_of
from jaxleg.walk.trajectory import foot_path, trunk_path
from tests.crawls import gait

GRID = Grid(81, 81, 0.04, (-1.6, -1.6))
BOX = (0.30, 0.08, 0.08, 0.5)
EXTENT = extent_of(0.38, 0.08, 0.2, GRID.resolution, heading=None)
BEND = np.deg2rad(20.0)


def crawler(heading=0.0, height=0.46):
    rectangle = SearchRectangle(*(jnp.asarray(x) for x in (*BOX, heading)))
    return paper_a(gait(height, width=0.4), rectangle, EXTENT, CogRule(jnp.asarray(0.5)), 0.05, BEND)


@pytest.fixture(scope="module")
def ground(pegasus):
    sizes = Sizes.of(pegasus)
    return jax.jit(lambda terrain: site_of(FootingRule(), sizes, GRID.resolution, terrain))


@pytest.fixture(scope="module")
def walked(pegasus):
    @jax.jit
    def plan(planner, site):
        stations = planner.route.stations(planner.gait, None, 4)
        choices, _ = choose(planner, pegasus, site, stations, 4)
        return choices, build_walk(planner, pegasus, site, stations, choices)

    return plan


@pytest.mark.parametrize("degrees", [30.0, 77.0, 180.0])
def test_a_walk_at_a_heading_is_the_walk_along_x_turned(walked, ground, degrees):
    site, angle = ground(flat(GRID)), np.deg2rad(degrees)
    (_, straight), (_, other) = walked(crawler(), site), walked(crawler(angle), site)
    spin = jax.jit(turned)
    np.testing.assert_allclose(other.footholds[..., :2], spin(straight.footholds[..., :2], angle), atol=1e-12)
    np.testing.assert_allclose(other.poses[:, :2], spin(straight.poses[:, :2], angle), atol=1e-12)
    np.testing.assert_allclose(other.poses[:, 2:5], straight.poses[:, 2:5], atol=1e-12)
    np.testing.assert_allclose(other.poses[:, 5], angle, atol=1e-12)
    np.testing.assert_allclose(other.phases.duration, straight.phases.duration, atol=1e-12)


def test_every_way_point_is_lowered_as_far_as_the_bend_demands_and_no_further(walked, ground, pegasus):
    """Each by itself; raised by 3 mm, a lowered one would have a leg too straight in a phase that it begins or ends."""
    site, planner = ground(stairs(GRID, 0.08, 0.30, 0.1)), crawler(height=0.57)
    tall = dataclasses.replace(planner, posture=dataclasses.replace(planner.posture, lowering="none"))
    (choices, walk), (_, high) = walked(planner, site), walked(tall, site)
    down = np.asarray(high.poses[:, 2] - walk.poses[:, 2])
    assert choices.status == Status.OK
    assert (high.lowering, walk.lowering) == (0.0, pytest.approx(down.max()))
    assert np.ptp(down) > 1e-3
    # the trunk goes on from where it has come to, and keeps still in a side's two swings
    np.testing.assert_allclose(walk.phases.trunk_from[1:], walk.phases.trunk_to[:-1], atol=1e-12)
    shares = np.linspace(0.0, 1.0, 5)
    bends, solve = jax.jit(jax.vmap(knee_bend)), jax.jit(joint_angles)
    path = jax.jit(lambda phase, share: (trunk_path(phase, share), foot_path(phase, share, 0.1)))

    def least(raised):
        """Least knee bend of each phase with the trunk so much higher at its start and its end."""
        found = []
        for p, _ in enumerate(walk.legs):
            phase = jax.tree.map(lambda x, p=p: x[p], walk.phases)
            there = [path(phase, s) for s in shares]
            poses = [np.asarray(pose) + raised * np.eye(6)[2] for pose, _ in there]
            angles = [solve(pegasus, pose, feet)[0] for pose, (_, feet) in zip(poses, there)]
            found.append(min(np.min(bends(pegasus.joint_axis, pegasus.link_offset, x)) for x in angles))
        return np.array(found)

    assert np.all(least(0.0) >= BEND - 1e-6)
    tight = least(0.003) < BEND
    down = down[np.r_[0, 1 : walk.steps : 2]]
    deepest = [k for k in range(len(down)) if down[k] > 1e-6 and down[k] >= down[max(k - 1, 0) : k + 2].max()]
    assert deepest  # no neighbour of such a one brings it further down than its own phases need
    for point in deepest:
        assert np.any(tight[max(3 * point - 3, 0) : 3 * point + 1])  # the shift to it, its side's two swings, the shift from it


@pytest.mark.parametrize("leg", [0, 3])
def test_the_cascade_offers_its_own_choice_first_then_cells_by_their_score(ground, pegasus, leg):
    planner, site = crawler(), ground(flat(GRID))
    site = site._replace(valid=jnp.asarray(np.random.default_rng(leg).random(site.valid.shape) < 0.5))
    cascade: Cascade = planner.foothold
    stations = planner.route.stations(planner.gait, None, 4)
    nominal = nominal_stances(planner.gait, stations, 1)[0][0]
    yaw = jnp.zeros(())
    own = jax.jit(cascade.stance)(pegasus, planner.gait, site, nominal, yaw)
    seen = jax.jit(cascade.propose)(pegasus, planner.gait, site, nominal, yaw, jnp.asarray(leg))
    assert own.status[leg] != FootholdStatus.NONE
    np.testing.assert_allclose(seen.xy[0], nominal[leg] + own.offset[leg], atol=1e-12)
    there = np.asarray(seen.xy)[np.asarray(seen.exists)]
    offset = there - np.asarray(nominal[leg])
    assert len(np.unique(offset.round(6), axis=0)) == len(offset) > 3
    box = cascade.rectangle
    scores = np.asarray(jax.jit(feasible_score)(offset[1:], box, box.longer))
    assert np.all(np.diff(scores) <= 1e-9)
    cells = np.round((np.asarray(seen.xy)[np.asarray(seen.exists)] - np.asarray(site.terrain.origin)) / GRID.resolution).astype(
        int
    )
    assert np.all(np.asarray(site.valid)[cells[:, 0], cells[:, 1]])


def test_what_does_not_fit_is_refused(pegasus, ground):
    with pytest.raises(TypeError, match="Greedy, but must be Tree"):
        _ = crawler().tree
    planner = paper_c(Navigation(), gait(0.46), 0.1, 0.03, GRID.resolution)
    with pytest.raises(ValueError, match="steps is 6, but must be a multiple of 4"):
        choose(planner, pegasus, ground(flat(GRID)), crawler().route.stations(planner.gait, None, 4), 6)
