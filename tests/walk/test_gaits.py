"""Candidate footholds against plain loops, and what makes a step impossible: reach, balance, walls, the unseen."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.foothold.rectangle import Extent
from jaxleg.gait.timing import shift_time
from jaxleg.route.stations import Stations
from jaxleg.series.candidates import adjustment_of, place_of, steps_away
from jaxleg.status import Status
from jaxleg.swing.cycloid import swing_foot
from jaxleg.terrain import HeightMap
from jaxleg.terrain.ground import on_ground
from jaxleg.terrain.site import Site
from jaxleg.walk.choose import step_nodes
from jaxleg.walk.config import Navigation
from jaxleg.walk.feasible import Standing, feasible, holding_power
from jaxleg.walk.navigation import make_navigator
from tests.crawls import gait
from tests.walk.test_parts import crawler

SIZE, SHAPE, ORIGIN = 0.04, (50, 40), np.array([-1.0, -0.8])
LEG = 3  # RH swings
FEET = np.array([[0.36, 0.2, 0.004], [0.28, -0.2, 0.004], [-0.28, 0.2, 0.004], [-0.36, -0.2, 0.004]])
TARGET = np.array([-0.2, -0.2, 0.004])
LEVEL, STILL = np.zeros(SHAPE), np.zeros(6)


@pytest.fixture(scope="module")
def navigator(pegasus):
    return make_navigator(pegasus, Navigation(), gait(0.46), 0.1, 0.03, SIZE)


def terrain_of(elevation):
    return HeightMap(jnp.asarray(elevation), jnp.asarray(ORIGIN), jnp.array(SIZE))


@pytest.fixture(scope="module")
def cause(navigator, pegasus):
    """Why RH cannot step from FEET to a target on a map, with the trunk adjusted and its pose moved."""

    @jax.jit
    def run(elevation, target, adjust, moved):
        ground = navigator.site(terrain_of(elevation)).obstacles
        feet, plan, yaw = jnp.asarray(FEET), navigator.planner, jnp.array(0.0)
        start = plan.posture.stand(pegasus, plan.gait, feet, yaw)
        pose = plan.posture.swing(pegasus, plan.gait, feet, feet.at[LEG].set(target), jnp.array(LEG), adjust, yaw) + moved
        return feasible(pegasus, plan, ground, Standing(feet, start), jnp.array(LEG), target, pose)

    def ask(elevation=LEVEL, target=TARGET, adjust=(0.0, 0.0, 0.0), moved=STILL):
        return Status(int(run(*(jnp.asarray(x) for x in (elevation, target, adjust, moved)))))

    return ask


def wall(x, y, half, height):
    """Flat ground with a block."""
    i, j = (ORIGIN[k] + SIZE * np.arange(SHAPE[k]) for k in (0, 1))
    inside = (np.abs(i - x) <= half)[:, None] & (np.abs(j - y) <= half)[None]
    return np.where(inside, height, 0.0)


def test_a_step_on_level_ground_can_be_made(cause):
    assert cause() == Status.OK


def test_what_makes_a_step_impossible(cause):
    assert cause(target=TARGET + np.array([0.5, 0.0, 0.0])) == Status.KINEMATICS
    assert cause(adjust=(0.16, 0.0, 0.0)) == Status.KINEMATICS
    assert cause(moved=np.array([0.0, -0.12, 0, 0, 0, 0])) == Status.STABILITY
    assert cause(elevation=wall(-0.5, -0.2, 0.05, 0.25)) == Status.HIND_LEG  # the knees point backward
    assert cause(elevation=wall(0.16, 0.2, 0.05, 0.25)) == Status.LEFT_LEG
    assert cause(elevation=wall(0.0, 0.0, 0.06, 0.6)) == Status.COLLISION
    unseen = np.zeros(SHAPE)
    assert cause(elevation=unseen, target=np.full(3, np.nan)) == Status.NOT_FINITE


def test_weak_motors_and_a_foot_that_would_have_to_pull_are_causes(navigator, pegasus):
    """Motors that could hold a tenth; a trunk beyond its feet, with no margin asked for."""
    plan = dataclasses.replace(navigator.planner, limits=dataclasses.replace(navigator.planner.limits, margin=jnp.array(-1.0)))
    feet, yaw, leg = jnp.asarray(FEET), jnp.array(0.0), jnp.array(LEG)

    @jax.jit
    def why(robot, aside):
        ground = navigator.site(terrain_of(LEVEL)).obstacles
        start = plan.posture.stand(robot, plan.gait, feet, yaw)
        after = feet.at[LEG].set(TARGET)
        pose = plan.posture.swing(robot, plan.gait, feet, after, leg, jnp.zeros(3), yaw).at[1].add(aside)
        return feasible(robot, plan, ground, Standing(feet, start), leg, jnp.asarray(TARGET), pose)

    assert why(pegasus, 0.0) == Status.OK
    assert why(dataclasses.replace(pegasus, torque_limit=0.1 * pegasus.torque_limit), 0.0) == Status.TORQUE
    assert why(dataclasses.replace(pegasus, torque_limit=9.0 * pegasus.torque_limit), -0.15) == Status.LOAD


def test_a_wall_that_nothing_comes_near_does_not_matter(cause):
    assert cause(elevation=wall(0.0, 0.7, 0.05, 1.0)) == Status.OK


def test_footholds_are_the_best_valid_cells_of_the_turned_rectangle(navigator, pegasus):
    rng = np.random.default_rng(0)
    valid, cost = rng.random(SHAPE) < 0.5, rng.random((4, 8, *SHAPE))
    cost[rng.random(cost.shape) < 0.05] = np.inf
    site = Site(terrain_of(0.02 * rng.normal(size=SHAPE)), jnp.asarray(valid), None, jnp.asarray(cost))
    plan = navigator.planner

    @jax.jit
    def find(xy, yaw, leg):
        return plan.foothold.propose(pegasus, plan.gait, site, jnp.broadcast_to(xy, (4, 2)), yaw, leg)

    for _ in range(6):
        default, yaw, leg = rng.uniform(-0.6, 0.6, 2), rng.uniform(-4.0, 4.0), rng.integers(4)
        rows = []
        for i, j in np.argwhere(valid):
            xy = ORIGIN + SIZE * np.array([i, j])
            ahead, left = (np.cos(yaw), np.sin(yaw)) @ (xy - default), (-np.sin(yaw), np.cos(yaw)) @ (xy - default)
            if abs(ahead) <= 0.14 + 1e-5 and abs(left) <= 0.10 + 1e-5:
                value = cost[leg, round(yaw / (np.pi / 4)) % 8, i, j] + 0.3 * np.hypot(ahead, left) / np.hypot(0.14, 0.10)
                rows.append((value, *xy))
        rows = np.array(sorted(r for r in rows if np.isfinite(r[0])))[:12]
        seen = find(jnp.asarray(default), jnp.array(yaw), jnp.array(leg))
        assert int(seen.exists.sum()) == len(rows)
        np.testing.assert_allclose(np.asarray(seen.cost)[: len(rows)], rows[:, 0], atol=1e-9)
        np.testing.assert_allclose(np.asarray(seen.xy)[: len(rows)], rows[:, 1:], atol=1e-9)


@pytest.mark.parametrize("part", ["ranked", "cascade"])
def test_more_footholds_wanted_than_there_are_cells_are_none(navigator, pegasus, part):
    """Nine cells either way."""
    plan = navigator.planner
    ranked = dataclasses.replace(plan.foothold, cells=1, count=40)
    seen = {"ranked": ranked, "cascade": dataclasses.replace(crawler().foothold, extent=Extent((1, 1), 1), count=40)}[part]
    site = Site(terrain_of(np.zeros(SHAPE)), jnp.ones(SHAPE, bool), None, jnp.ones((4, 8, *SHAPE)))
    nominal = jnp.zeros((4, 2))
    found = jax.jit(seen.propose)(pegasus, plan.gait, site, nominal, jnp.zeros(()), jnp.zeros((), jnp.int32))
    assert found.xy.shape == (40, 2)
    assert 0 < int(found.exists.sum()) <= 9
    assert np.all(np.asarray(found.exists)[: int(found.exists.sum())])


@pytest.fixture(scope="module")
def swung(navigator, pegasus):
    """Apex of a swing over a map, and its foot at shares of it."""

    @jax.jit
    def run(elevation, start, end, shares):
        plan = navigator.planner
        apex = plan.swing.flight(pegasus, plan.gait, navigator.site(terrain_of(elevation)).obstacles, start, end).apex
        return apex, jax.vmap(lambda s: swing_foot(start, end, apex, s, plan.gait.lift_share))(shares)

    return run


@pytest.mark.parametrize("seed", range(30))
def test_a_swing_clears_a_block_wherever_it_stands_and_hardly_more(swung, navigator, pegasus, seed):
    """By the clearance times its lift, over all columns within the legs' radius along x and y."""
    rng, shares = np.random.default_rng(seed), np.linspace(0.15, 0.85, 701)
    start = np.array([*rng.uniform(-0.5, 0.0, 2), 0.0])
    turn, length, place, half, height = rng.uniform((0.0, 0.1, 0.3, 0.0, 0.05), (2.0 * np.pi, 0.35, 0.7, 0.04, 0.15))
    end = start + length * np.array([np.cos(turn), np.sin(turn), 0.0])
    elevation = wall(*(start + place * (end - start))[:2], half, height)
    apex, foot = map(np.asarray, swung(elevation, start, end, shares))
    lift = foot[:, 2] / apex
    wide = 0.5 * SIZE + float(max(pegasus.leg_radius, pegasus.foot_radius))
    near = [np.abs(foot[:, k, None] - ORIGIN[k] - SIZE * np.arange(SHAPE[k])) <= wide for k in (0, 1)]
    ground = np.where(near[0][:, :, None] & near[1][:, None], elevation, 0.0).max(axis=(1, 2))
    needed = max(np.max(ground / lift) + navigator.planner.swing.clearance, navigator.planner.gait.swing_height)
    assert needed - 1e-9 <= apex <= needed + 0.025


def test_a_swing_over_level_ground_is_the_least_one(swung, navigator):
    apex, _ = swung(LEVEL, FEET[LEG], np.add(TARGET, [0.1, 0.05, 0.0]), np.linspace(0.15, 0.85, 701))
    np.testing.assert_allclose(apex, navigator.planner.gait.swing_height)


def test_holding_power_is_least_with_nearly_straight_legs(pegasus):
    """Paper A, Fig. 5: standing takes the most current in between, the least nearly straight; and it goes with R."""
    up = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    power = jax.jit(lambda robot, h: holding_power(robot, jnp.asarray(FEET), h * up, jnp.ones(4)))
    high, low = power(pegasus, 0.56), power(pegasus, 0.42)
    assert 0.0 < high < 0.5 * low


def test_the_order_by_energy_is_of_foothold_cost_plus_weighed_energy(navigator, pegasus):
    """Candidate by candidate: the energy is of holding the pose while the trunk shifts to it and RH swings."""
    weights = {"order": "energy", "energy_weight": jnp.array(3.0), "energy": jnp.array(70.0)}
    plan = dataclasses.replace(navigator.planner, series=dataclasses.replace(navigator.planner.series, **weights))
    counts, rng = plan.series.counts, np.random.default_rng(1)
    site = Site(terrain_of(LEVEL), jnp.ones(SHAPE, bool), None, jnp.asarray(rng.random((4, 8, *SHAPE))))
    stations = Stations(jnp.zeros((4, 2)), jnp.zeros(4), jnp.array(4))
    away = steps_away(np.arange(counts.candidates), counts)
    feet, standing, leg = jnp.asarray(FEET), np.arange(4) != LEG, jnp.array(LEG)

    @jax.jit
    def run(away):
        start = plan.posture.stand(pegasus, plan.gait, feet, jnp.array(0.0))
        seen, order = step_nodes(plan, pegasus, site, stations).expand(Standing(feet, start), jnp.array(0))
        landed = feet.at[LEG].set(on_ground(pegasus, site.terrain, seen.xy[0]))

        def energy(away):
            adjust = adjustment_of(away, plan.series.adjustments)
            pose = plan.posture.swing(pegasus, plan.gait, feet, landed, leg, adjust, start[5])
            seconds = shift_time(start, pose, plan.series.acceleration) + plan.series.swing_time
            return holding_power(pegasus, landed, pose, jnp.asarray(standing, float)) * seconds

        return seen.cost, order, jax.lax.map(energy, away)

    cost, order, energy = map(np.asarray, run(away))
    foothold = np.asarray(place_of(np.arange(counts.candidates), counts).foothold)
    value = cost[foothold] + 3.0 * energy / 70.0
    np.testing.assert_array_equal(np.sort(order), np.arange(counts.candidates))
    usable = np.isfinite(value[order])
    assert usable.mean() > 0.5
    assert np.all(usable[: usable.sum()])
    assert np.all(np.diff(value[order][usable]) >= -1e-9)
    assert np.ptp(3.0 * energy[np.isfinite(energy)] / 70.0) > 0.1 * np.ptp(cost)  # both count
