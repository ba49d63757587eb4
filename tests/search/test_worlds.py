"""Randomised lanes: what is drawn, that planners do not see it, and that the simulation and the referee do."""

import dataclasses
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import median_filter

from jaxleg.conventions import GRAVITY
from jaxleg.search import referees
from jaxleg.search.config import Kind, Randomise, Study, Terrains
from jaxleg.search.lanes import CONSTRAINTS, Lab, LanePlan, Setting
from jaxleg.search.sites import make_sites
from jaxleg.search.training import Lanes
from jaxleg.search.verify import everyone
from jaxleg.search.worlds import make_worlds, set_down, worlds
from jaxleg.sim.contact import Ground
from jaxleg.sim.verdict import Verdict
from jaxleg.status import Status
from jaxleg.terrain import HeightMap
from jaxleg.terrain.site import Site
from jaxleg.walk.data import PlanChecks, Reference
from tests.motions import Mujoco, sloping
from tests.stand_ins import StandInLab

MASSES = ("trunk_mass", "trunk_inertia", "link_mass", "link_inertia")
NOTHING = Randomise(mass=0.0, com=0.0, friction=(0.8, 0.8), gains=0.0, map_noise=0.0)
STUDY = Study(
    kinds={"flat": Kind(), "rough": Kind("rough")},
    terrains=Terrains(train=8, held_out=10, cells=(24, 12), resolution=0.04),
    randomise=Randomise(lanes=6),
)
SECONDS, STEPS = 0.3, 150
ANGLES = np.array([0.0, -0.7, 1.3])
PLANE = sloping(0.0, 0.0)
HELD = {"velocity_gain": np.full((4, 3), 1e4)}  # joints that hardly give way


def of_lanes(**changes):
    return dataclasses.replace(STUDY, randomise=dataclasses.replace(STUDY.randomise, **changes))


def drawn(pegasus, ranges, count, seed=0):
    """So many worlds on level ground, and the maps that planners see."""
    terrain = HeightMap(np.zeros((count, 6, 4)), np.zeros((count, 2)), np.full(count, 0.1))
    return worlds(ranges, pegasus, Ground(), terrain, jax.random.split(jax.random.key(seed), count))


def test_every_draw_fills_its_range(pegasus):
    """Uniform: of 300 the least and the greatest are within 3 % of the range of its ends; factors are independent."""
    truth, seen = drawn(pegasus, Randomise(mass=0.2, com=0.03, friction=(0.4, 0.9), gains=0.3, map_noise=0.02), 300)
    robot = truth.robot
    names = (*MASSES, "stiffness", "velocity_gain")
    factors = {name: np.asarray(getattr(robot, name)) / np.asarray(getattr(pegasus, name))[None] for name in names}
    one = {name: x.reshape(300, -1) for name, x in factors.items()}
    assert all(np.ptp(x, axis=1).max() < 1e-12 for x in one.values())
    for name in MASSES:
        assert_allclose(one[name][:, 0], one["trunk_mass"][:, 0], rtol=1e-12)
    rows = [one["trunk_mass"][:, 0], *np.asarray(robot.trunk_com - pegasus.trunk_com[None]).T, truth.ground.friction]
    rows += [one["stiffness"][:, 0], one["velocity_gain"][:, 0], np.asarray(seen.elevation)[:, 2, 1]]
    spans = [(0.8, 1.2), *[(-0.03, 0.03)] * 3, (0.4, 0.9), (0.7, 1.3), (0.7, 1.3), (-0.02, 0.02)]
    for row, (low, high) in zip(rows, spans):
        assert low <= row.min() < low + 0.03 * (high - low)
        assert high - 0.03 * (high - low) < row.max() <= high
    assert np.abs(np.corrcoef(rows) - np.eye(len(rows))).max() < 0.25
    noise = np.asarray(seen.elevation).reshape(300, -1)
    assert np.abs(np.corrcoef(noise.T) - np.eye(24)).max() < 0.25  # each cell by itself
    assert_array_equal(truth.terrain.elevation, 0.0)
    same = {name for name, x in vars(robot).items() if np.all(np.asarray(x) == np.asarray(getattr(pegasus, name))[None])}
    assert set(vars(robot)) - same == {*MASSES, "trunk_com", "stiffness", "velocity_gain"}


def test_no_range_is_no_change(pegasus):
    truth, seen = drawn(pegasus, NOTHING, 2)
    jax.tree.map(lambda x, wanted: assert_array_equal(x, np.stack([wanted] * 2)), truth.robot, pegasus)
    assert_array_equal(np.stack(truth.ground), np.tile(np.array(Ground())[:, None], 2))
    assert_array_equal(seen.elevation, 0.0)


def test_lanes_are_the_same_however_many_and_others_with_another_seed(pegasus):
    """Flat ground is one terrain: it is walked in other worlds. Rough ones are spread over the five held-out ones."""
    few, many = (make_worlds(of_lanes(lanes=n), pegasus, Ground(), "flat")[1] for n in (6, 14))
    assert many.ground.friction.shape == (7,)
    jax.tree.map(lambda x, y: assert_array_equal(x, y[:3]), few, many)
    assert len(np.unique(many.robot.trunk_mass)) == 7
    other = make_worlds(dataclasses.replace(STUDY, seed=1), pegasus, Ground(), "flat")[1]
    rough = make_worlds(STUDY, pegasus, Ground(), "rough")[1]
    masses = np.concatenate([x.robot.trunk_mass for x in (few, other, rough)])
    assert len(np.unique(masses)) == 9
    held = make_sites(STUDY, pegasus, "rough", held_out=True).terrain.elevation
    assert_array_equal(rough.terrain.elevation, held[np.array([0, 1, 3])])


def test_planners_see_the_noisy_map_and_feet_meet_the_true_one(pegasus):
    """With so much noise no foot may stand in most places, which the true level ground would allow everywhere."""
    noisy = of_lanes(map_noise=0.1, map_filter=0.0)
    site, truth = make_worlds(noisy, pegasus, Ground(), "flat")
    assert_array_equal(truth.terrain.elevation, 0.0)
    assert np.abs(site.terrain.elevation).max() > 0.09
    assert np.mean(site.valid) < 0.1
    alike, _ = make_worlds(of_lanes(map_noise=0.0), pegasus, Ground(), "flat")
    once = make_sites(STUDY, pegasus, "flat", held_out=True)
    jax.tree.map(lambda x, y: assert_array_equal(x, np.repeat(y, 3, axis=0)), alike, once)


def test_planners_take_the_median_of_the_noisy_map(pegasus):
    """Three foot radii are 0.06 m: on maps of 0.04 m the cell and its eight neighbours. Against scipy's, but for the border."""
    raw, site = (make_worlds(of_lanes(map_noise=0.1, map_filter=r), pegasus, Ground(), "rough")[0] for r in (0.0, 3.0))
    wanted = [median_filter(x, size=3) for x in np.asarray(raw.terrain.elevation)]
    assert_allclose(np.asarray(site.terrain.elevation)[:, 1:-1, 1:-1], np.array(wanted)[:, 1:-1, 1:-1], rtol=1e-12)


def test_every_contestant_meets_the_same_worlds(pegasus):
    site, truth = make_worlds(STUDY, pegasus, Ground(), "rough")
    vectors, lanes = everyone(STUDY, "rough", np.zeros((3, 10)), site, truth)
    assert len(vectors) == 6 * 3
    lanes = lanes.take(np.arange(18))
    jax.tree.map(lambda x, y: assert_array_equal(x, np.concatenate([y] * 6)), (lanes.site, lanes.truth), (site, truth))


def standing(slope=0.0):
    """A plan that stands parallel to the slope, its legs all alike, without torques beforehand."""
    half = 0.5 * np.arctan(slope)
    drop = 0.26 * np.cos(ANGLES[1]) + 0.34 * np.cos(ANGLES[1] + ANGLES[2])
    up = np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    turned = [np.cos(half), 0.0, -np.sin(half), 0.0]
    feet = np.zeros((4, 3))  # enough for where the ground is the same under all
    rows = (np.tile(ANGLES, (4, 1)), np.zeros((4, 3)), np.zeros((4, 3)), (0.004 + drop) * up, turned, np.zeros(6), feet)
    held = [jnp.asarray(np.stack([x, x]), float) for x in (*rows, np.ones(4))]
    zero = jnp.zeros(())
    checks = PlanChecks(**dict.fromkeys(PlanChecks._fields, zero) | {"status": jnp.asarray(Status.OK)})
    return LanePlan(None, Reference(jnp.array([0.0, SECONDS]), *held), jnp.zeros(len(CONSTRAINTS)), checks)


@pytest.fixture(scope="module")
def walk(pegasus):
    """The meters of a plan on a map, with a truth or without."""
    lab = Lab(pegasus, ("gait.skew",), Ground(), (8, 8), STEPS, 1, "net")
    setting = Setting(None, jnp.zeros(()), jnp.ones(()))
    return jax.jit(lambda plan, terrain, truth: lab.followed(plan, Site(terrain, None), setting, truth)[1])


def truth_of(pegasus, terrain=PLANE, ranges=NOTHING, friction=0.8, **robot):
    """A truth without any draw but what is given."""
    batch = jax.tree.map(lambda x: jnp.asarray(x)[None], terrain)
    truth = jax.tree.map(lambda x: x[0], worlds(ranges, pegasus, Ground(), batch, jax.random.split(jax.random.key(0), 1))[0])
    ground = truth.ground._replace(friction=jnp.asarray(friction))
    return truth._replace(robot=dataclasses.replace(truth.robot, **robot), ground=ground)


def test_a_world_that_is_the_planners_is_the_ordinary_lane(pegasus, walk):
    """To rounding: a robot that is traced is not folded into the program."""
    there, here = walk(standing(), PLANE, truth_of(pegasus)), walk(standing(), PLANE, None)
    jax.tree.map(lambda x, y: assert_allclose(x, y, rtol=1e-9, atol=1e-12), there, here)


@pytest.mark.parametrize("share", [1.0, 1.5])
def test_feet_carry_the_lanes_weight(pegasus, walk, share):
    """k b softplus(d / b) at the depth d to which the hind feet sink, which are nearer to the centre of mass."""
    body = Mujoco(pegasus)(np.concatenate([np.zeros(3), [1.0, 0.0, 0.0, 0.0], np.tile(ANGLES, 4)]))
    behind = (body.feet[0, 0] - body.com[0]) / (body.feet[0, 0] - body.feet[2, 0])
    masses = {name: share * getattr(pegasus, name) for name in MASSES}
    seen, ground = walk(standing(), PLANE, truth_of(pegasus, **masses, **HELD)), Ground()
    force = ground.stiffness * ground.softness * np.logaddexp(0.0, seen.penetration / ground.softness)
    assert_allclose(force, 0.5 * behind * share * 35.2 * GRAVITY, rtol=0.05)  # it rocks at first


def test_the_lanes_centre_of_mass_is_over_its_feet(pegasus, walk):
    """The margin aside is half the stance's width, less the way of the centre of mass."""
    aside = 0.04
    moved = truth_of(pegasus, trunk_com=pegasus.trunk_com + jnp.array([0.0, aside, 0.0]))
    before, after = (walk(standing(), PLANE, truth).margin for truth in (truth_of(pegasus), moved))
    assert_allclose(before, 0.10 + 0.08, atol=1e-3)
    assert_allclose(before - after, aside * float(pegasus.trunk_mass / pegasus.mass), atol=2e-3)


def test_a_lane_slides_by_its_own_friction(pegasus, walk):
    """g (sin - mu cos) down a slope of 0.25 where the planner's 0.8 would hold."""
    slope = sloping(0.25, 0.0)
    held, slid = (walk(standing(0.25), slope, truth_of(pegasus, slope, friction=mu, **HELD)).moved[0] for mu in (0.8, 0.1))
    assert abs(held) < 2e-3
    assert_allclose(slid, -0.5 * GRAVITY * (0.25 - 0.1) * SECONDS**2 / (1.0 + 0.25**2), rtol=0.05)


def test_a_lane_stands_on_its_own_ground(pegasus, walk):
    """The true ground lies lower than the map says: the walk begins there, and all is as on the map."""
    lower = dataclasses.replace(PLANE, elevation=PLANE.elevation - 0.05)
    there, here = walk(standing(), PLANE, truth_of(pegasus, lower)), walk(standing(), PLANE, None)
    jax.tree.map(lambda x, y: assert_allclose(x, y, atol=1e-9), there, here)
    assert here.penetration < 2e-3


def test_a_start_is_set_down_until_the_first_foot_touches():
    feet = jnp.array([[0.3, 0.2, 0.0], [0.2, -0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0]])
    plan = standing().reference
    plan = plan._replace(foot_pos=plan.foot_pos.at[0].set(feet))
    after = jax.jit(set_down)(plan, PLANE, sloping(0.1, 0.05))
    assert_allclose(after.trunk_pos[0] - plan.trunk_pos[0], [0.0, 0.0, 0.1 * 0.3 + 0.05 * 0.2], atol=1e-12)
    jax.tree.map(assert_array_equal, after._replace(trunk_pos=0), plan._replace(trunk_pos=0))
    assert_array_equal(after.trunk_pos[1], plan.trunk_pos[1])


def test_the_referee_gets_each_lanes_robot_ground_and_friction(pegasus, monkeypatch):
    """Without a truth: the lab's."""
    seen = []
    none = Verdict(*[np.zeros((2,))] * 6)
    plan = standing()
    plan = plan._replace(reference=plan.reference._replace(foot_pos=plan.reference.foot_pos.at[..., 0].set(0.4)))
    plans = jax.tree.map(lambda x: np.stack([x] * 2), plan)
    lab = StandInLab(robot=pegasus, ground=Ground(friction=0.7), plan_lanes=lambda *_: plans)
    verdict = none._replace(energy=(np.ones(2),) * 3, moved=np.ones((2, 3)), fell=np.zeros(2, bool))
    monkeypatch.setattr(referees, "replay_each", lambda *x: seen.append(x) or verdict)
    truths = [truth_of(pegasus, sloping(0.1, 0.0), Randomise(), mu) for mu in (0.3, 0.4)]
    truth = jax.tree.map(lambda *x: np.stack(x), *truths)
    site = Site(jax.tree.map(lambda x: np.stack([x] * 2), PLANE), None)
    setting = SimpleNamespace(least_bend=np.zeros(2))
    for each in (truth, None):
        referees.replay_contest(lab, np.zeros((2, 1)), Lanes(site, setting, each), 2)
    for (robots, terrains, tracks, frictions), robot, ground, mus, up in zip(
        seen, (truths[1].robot, pegasus), (truth.terrain, site.terrain), ((0.3, 0.4), (0.7, 0.7)), (0.04, 0.0)
    ):
        jax.tree.map(assert_array_equal, robots[1], robot)
        assert_array_equal(terrains[1].elevation, ground.elevation[1])
        assert_allclose(tracks[1].trunk_pos[0] - plan.reference.trunk_pos[0], [0.0, 0.0, up], atol=1e-12)
        assert_allclose(frictions, mus)
