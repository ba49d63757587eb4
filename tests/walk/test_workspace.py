"""Feet under their hips: their places against MuJoCo's, the cascade against a plain search of whole walks, both readings."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxleg.foothold.cascade import reachable_heights
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.foothold.rectangle import SearchRectangle, extent_of
from jaxleg.gait.support import CogRule
from jaxleg.leg.workspace import Workspace
from jaxleg.posture.body import joint_angles
from jaxleg.posture.collision import Sizes
from jaxleg.posture.workspace import nominal_rooms, stood
from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.status import Status
from jaxleg.terrain import Grid, flat, rough
from jaxleg.terrain.footing import FootingRule
from jaxleg.walk.build import build_walk
from jaxleg.walk.choose import choose
from jaxleg.walk.feasible import check_steps
from jaxleg.walk.inside import stood_in
from jaxleg.walk.presets import paper_a
from jaxleg.walk.site import site_of
from tests.crawls import gait

GRID = Grid(101, 101, 0.02, (-1.0, -1.0))
BOX = (0.30, 0.08, 0.08, 0.5)
STEP, HIGH, RADIUS = 0.2, 0.48, 0.02  # the foot's disc, which only has to reach into the workspace
LEFT, RIGHT = (0, 2), (1, 3)


def crawler(space, heading=0.0, support="stance", centre=-0.1, high=HIGH, low=0.3):
    """Paper A's planner with a workspace such that L_F2H of a foot's centre may be from and to [m]."""
    space = (space[0] + RADIUS, space[1] - RADIUS)
    rectangle = SearchRectangle(*(jnp.asarray(x) for x in (*BOX, heading)))
    own = dataclasses.replace(gait(high, centre, step=STEP, length=0.6), support=support)
    own = dataclasses.replace(own, workspace=Workspace(*(jnp.asarray(x) for x in (*space, low, high))))
    extent = extent_of(0.38, 0.08, STEP, GRID.resolution, heading=None)
    return paper_a(own, rectangle, extent, CogRule(jnp.asarray(0.5)), 0.05, np.deg2rad(15.0))


@pytest.fixture(scope="module")
def ground(pegasus):
    make = jax.jit(lambda terrain: site_of(FootingRule(), Sizes.of(pegasus), GRID.resolution, terrain))

    def of(terrain, share=1.0, seed=0):
        """The site of a terrain where a foot may stand on a share of the cells, drawn at random."""
        site, lucky = make(terrain), np.random.default_rng(seed).random((GRID.nx, GRID.ny)) < share
        return site._replace(valid=jnp.asarray(lucky))

    return of


@pytest.fixture(scope="module")
def walked(pegasus):
    @jax.jit
    def plan(planner, site):
        stations = planner.route.stations(planner.gait, None, 6)
        choices, _ = choose(planner, pegasus, site, stations, 8)
        walk = build_walk(planner, pegasus, site, stations, choices)
        return choices, walk, check_steps(planner, pegasus, site.obstacles, walk), stood_in(pegasus, walk)

    return plan


@pytest.fixture(scope="module")
def moved(pegasus):
    """Poses and feet of walks whose second stance is moved by each of many offsets (ahead, left)."""

    @jax.jit
    def plan(planner, site, choices, offsets):
        stations = planner.route.stations(planner.gait, None, 6)

        def lane(offset):
            walk = build_walk(planner, pegasus, site, stations, choices._replace(offset=choices.offset.at[1].set(offset[None])))
            return walk.poses, walk.feet

        return jax.vmap(lane)(offsets)

    return plan


def ahead(robot, pose, feet):
    """L_F2H in NumPy and SciPy's turns."""
    turn = Rotation.from_euler("ZYX", [pose[5], -pose[3], pose[4]]).as_matrix()
    joint = pose[:3] + (robot.hip_position + np.array([1.0, 0.0, 0.0]) * robot.link_offset[:, 0]) @ turn.T
    return (feet - joint)[:, :2] @ np.array([np.cos(pose[5]), np.sin(pose[5])])


def places(robot, poses, feet, support):
    """L_F2H of all that a reading asks about the second stance: right legs swing in pose 1, left ones in pose 3."""
    found = [ahead(robot, poses[1], feet[2]), ahead(robot, poses[3], feet[4])]
    if support == "sweep":
        found += [ahead(robot, poses[1], feet[0])[[*RIGHT]], ahead(robot, poses[3], feet[2])[[*LEFT]]]
    return np.concatenate(found)


def test_places_are_those_of_mujocos_thigh_joints(pegasus):
    rng = np.random.default_rng(3)
    model = mujoco.MjModel.from_xml_string(robot_mjcf(pegasus))
    data, thigh = mujoco.MjData(model), 6 + 3 * np.arange(4) + 1
    seen = jax.jit(lambda pose, feet: stood(pegasus, gait(), pose, feet + 0.01, feet, 3))
    solve = jax.jit(lambda *x: joint_angles(pegasus, *x)[0])
    stance = np.array([[0.3, 0.18], [0.3, -0.18], [-0.3, 0.18], [-0.3, -0.18]])
    for _ in range(8):
        pose = np.array([*rng.uniform(-0.05, 0.05, 2), 0.48, *rng.uniform(-0.15, 0.15, 2), rng.uniform(-3, 3)])
        spin = Rotation.from_euler("Z", pose[5]).as_matrix()[:2, :2]
        feet = np.concatenate([pose[:2] + (stance + rng.uniform(-0.05, 0.05, (4, 2))) @ spin.T, np.zeros((4, 1))], axis=1)
        angles, at = solve(pose, feet), seen(pose, feet)
        turn = Rotation.from_euler("ZYX", [pose[5], -pose[3], pose[4]])
        data.qpos[:] = [*pose[:3], *turn.as_quat(scalar_first=True), *np.ravel(angles)]
        mujoco.mj_kinematics(model, data)
        joint = data.xanchor[[model.dof_jntid[dof] for dof in thigh]]
        apart, forward = feet - joint, np.array([np.cos(pose[5]), np.sin(pose[5]), 0.0])
        link = apart - (feet - data.xanchor[[model.dof_jntid[dof] for dof in thigh - 1]])  # minus the hip's link
        np.testing.assert_allclose((apart - link) @ forward, at.ahead[1], atol=1e-9)
        assert np.max(np.abs(link @ forward)) < 0.015  # which is what leaving the roll out costs
        np.testing.assert_allclose(at.ahead[0] - at.ahead[1], 0.01 * (forward[0] + forward[1]), atol=1e-9)
        hips = data.xanchor[[model.dof_jntid[dof] for dof in thigh - 1]]
        np.testing.assert_allclose(at.above, np.mean(hips[:, 2]) - 0.005, atol=1e-9)  # half way from the feet before to after


@pytest.mark.parametrize("support", ["stance", "sweep"])
def test_the_papers_gait_on_level_ground_by_hand(walked, ground, support):
    """It lands a foot half a step ahead of its centre, has it there half a cycle on, and half a step behind as it lifts."""
    site, least = ground(flat(GRID)), {"stance": -0.1, "sweep": -0.2}[support]
    _, walk, steps, (used, share) = walked(crawler((least, 0.0), support=support), site)
    np.testing.assert_allclose([used.behind, used.ahead], [least, 0.0], atol=1e-6)
    np.testing.assert_allclose([used.low, used.high], HIGH - walk.lowering, atol=1e-6)
    assert share == 1.0
    assert np.all(steps == Status.OK)


@pytest.mark.parametrize("support", ["stance", "sweep"])
def test_the_nominal_room_is_the_nearer_end_by_hand(pegasus, support):
    """Of the paper's gait: 0.1 m behind its centre to 0.1 m ahead under `sweep`, from the centre on under `stance`."""
    rooms = jax.jit(lambda planner: nominal_rooms(pegasus, planner.gait, planner.posture))
    least = {"stance": -0.1, "sweep": -0.2}[support]
    for behind, ahead in ((-0.25, 0.03), (-0.21, 0.05), (-0.2, -0.01)):
        seen = np.asarray(rooms(crawler((behind, ahead), support=support)))
        np.testing.assert_allclose(np.min(seen), min(least - behind, ahead), atol=1e-9)
    np.testing.assert_allclose(np.min(rooms(crawler((-9.0, 9.0), low=0.47))), HIGH - 0.47, atol=1e-9)  # what binds is height


@pytest.mark.parametrize(("cut", "share"), [((-0.099, 0.0), 1 / 3), ((-0.1, -0.001), 2 / 3)])
def test_a_millimetre_less_than_the_paper_needs_is_outside(walked, ground, cut, share):
    """At each step one foot lands, at the front end, and two stand half way: so many of three are then inside."""
    choices, _, steps, (_, inside) = walked(crawler(cut), ground(flat(GRID)))
    assert np.all(choices.found == FootholdStatus.NEAREST)
    assert np.all(choices.offset == 0.0)
    assert np.all(steps == Status.WORKSPACE)
    np.testing.assert_allclose(inside, share)


@pytest.mark.parametrize(("heading", "support"), [(0.0, "stance"), (0.6, "stance"), (0.6, "sweep")])
def test_the_cascade_is_a_plain_search_of_whole_walks(pegasus, walked, moved, ground, heading, support):
    """Of all common offsets that stand on valid cells, the one with the best score whose walk keeps its feet inside."""
    space = {"stance": (-0.14, 0.03), "sweep": (-0.23, 0.02)}[support]
    planner, statuses = crawler(space, heading, support), []
    cells = np.stack(np.meshgrid(*[np.arange(-12, 13)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    c, s = np.cos(heading), np.sin(heading)
    along = GRID.resolution * np.stack([cells @ [c, s], cells @ [-s, c]], axis=1)
    around = (abs(along[:, 0]) <= 0.19 + 2e-5) & (abs(along[:, 1]) <= 0.04 + 2e-5)
    cells, along = cells[around], along[around]
    for seed in range(6):
        site = ground(jax.jit(lambda seed: rough(GRID, jax.random.key(seed), 0.02, 0.3))(seed), 0.6, seed)
        choices, walk, steps, _ = walked(planner, site)
        poses, feet = moved(planner, site, choices, along)
        robot = jax.tree.map(np.asarray, pegasus)
        stood = np.stack([places(robot, *x, support) for x in zip(np.asarray(poses), np.asarray(feet))])
        inside = np.all((stood >= space[0] - 1e-4) & (stood <= space[1] + 1e-4), axis=1)
        close = np.any(np.abs(np.minimum(stood - space[0], space[1] - stood) + 1e-4) < 2e-4, axis=1)  # rounding's to decide
        valid = np.asarray(site.valid)
        start = np.asarray(walk.footholds[1, :, :2]) - turned(np.asarray(choices.offset[1]), c, s)
        at = np.round((start - np.asarray(GRID.origin)) / GRID.resolution).astype(int)
        footing = np.all([valid[tuple((at[leg] + cells).T)] for leg in range(4)], axis=0)
        best, status = plain(along, footing & inside & ~close)
        chosen = np.asarray(choices.offset[1])
        statuses.append(int(choices.found[1, 0]))
        if status is not None and not np.any(footing & close):
            assert statuses[-1] == status
            np.testing.assert_allclose(chosen, np.tile(best, (4, 1)), atol=1e-9)
        if statuses[-1] <= FootholdStatus.WIDENED:
            assert np.all(np.asarray(steps[:4]) != Status.WORKSPACE)
    assert FootholdStatus.NOMINAL in statuses


def turned(xy, c, s):
    return np.stack([c * xy[:, 0] - s * xy[:, 1], s * xy[:, 0] + c * xy[:, 1]], axis=1)


def plain(along, allowed):
    """The allowed offset of the best score, ties forward, to the middle, left; in the rectangle, or else the longer one."""
    for length, status in ((0.30, FootholdStatus.NOMINAL), (0.38, FootholdStatus.WIDENED)):
        pool = along[allowed & (abs(along[:, 0]) <= length / 2 + 2e-5)]
        if len(pool):
            ahead, left = np.abs(pool).T
            score = 1 - 0.5 * (ahead + left) / ((length + 0.08) / 2) - 0.5 * left / 0.04
            rank = np.stack(
                [np.round(score * 1e5), np.round(pool[:, 0] * 1e6), -np.round(left * 1e6), np.round(pool[:, 1] * 1e6)]
            )
            return pool[np.lexsort(rank[::-1])[-1]], status
    return None, None


def test_a_sweep_as_long_as_the_step_leaves_no_longer_one(walked, ground):
    """On level ground with holes a stance that is inside follows another by one step at most; where the feet may go anywhere,
    some follow by more."""
    longer = []
    for space in ((-0.2, 0.0), (-np.inf, np.inf)):
        stances = [walked(crawler(space, support="sweep"), ground(flat(GRID), 0.7, seed))[0] for seed in range(4)]
        found, ahead = (
            np.stack([np.asarray(x) for x in y]) for y in zip(*((c.found[:, 0], c.offset[:, 0, 0]) for c in stances))
        )
        both = (found[:, 1:] <= FootholdStatus.WIDENED) & (found[:, :-1] <= FootholdStatus.WIDENED)
        assert np.any(both)
        longer.append(np.max(np.diff(ahead, axis=1)[both]))
    assert longer[0] < 2e-4
    assert longer[1] > 0.01


def test_nothing_binds_where_no_bound_is_given(walked, ground):
    site = ground(jax.jit(lambda: rough(GRID, jax.random.key(5), 0.03, 0.3))(), 0.5)
    free, wide = (walked(crawler(space, centre=0.0), site) for space in ((-np.inf, np.inf), (-1.0, 1.0)))
    np.testing.assert_array_equal(free[0].offset, wide[0].offset)
    assert free[3][1] == wide[3][1] == 1.0
    narrow = walked(crawler((-0.03, 0.12), centre=0.0), site)
    assert np.any(narrow[0].offset != free[0].offset)


def test_the_lowest_foothold_is_within_reach_of_the_lowest_hips(pegasus):
    """A foot a tenth and half a step from its hip: the workspace's lower bound raises the lowest of footholds by as much."""
    heights = jax.jit(lambda low: reachable_heights(pegasus, crawler((-1.0, 1.0), low=low).gait, 0.0).lowest)
    np.testing.assert_allclose(heights(0.45), 0.45 - np.sqrt(0.6**2 - 0.2**2), atol=1e-9)
    np.testing.assert_allclose(heights(0.1), 0.26 - np.sqrt(0.6**2 - 0.2**2), atol=1e-9)  # the thigh's length at least
    np.testing.assert_allclose(heights(0.9), HIGH - np.sqrt(0.6**2 - 0.2**2), atol=1e-9)  # no more than the upper bound
