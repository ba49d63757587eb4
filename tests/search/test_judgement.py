"""How a lane is judged: slacks, penalty and objective worked out by hand, and what the compiled judges are made of."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.foothold.rectangle import Extent, SearchRectangle
from jaxleg.gait.params import GaitParams
from jaxleg.gait.support import CogRule
from jaxleg.leg.energy import Power
from jaxleg.search.lanes import CONSTRAINTS, Setting, penalty, per_metre
from jaxleg.search.leaves import leaf_names, read_leaves
from jaxleg.status import Status
from jaxleg.walk.data import PlanChecks
from jaxleg.walk.presets import paper_a
from tests.crawls import up_to
from tests.stand_ins import StandInLab

DEGREE = np.pi / 180.0
UNITS = dict(zip(CONSTRAINTS, (DEGREE, 0.01, 0.05, 0.1, DEGREE, *[0.01] * 5)))  # what costs a baseline's energy
CHECKS = PlanChecks(
    knee_bend=jnp.asarray(0.5),
    margin=jnp.asarray(0.07),
    torque_ratio=jnp.asarray(0.8),
    load=jnp.asarray(0.30),
    joint_room=jnp.asarray(0.4),
    lowering=jnp.asarray(0.02),
    used=up_to(jnp.asarray(0.5)),
    inside=jnp.asarray(1.0),
    found=jnp.array([1.0, 0.0, 0.0, 0.0]),
    status=jnp.asarray(Status.OK),
)
GAIT = GaitParams(up_to(jnp.asarray(0.5)), *(jnp.asarray(x) for x in (-0.1, 0.1, 0.2, 0.62, 0.36, 0.08, 0.45, 0.5, 0.1)))
fined, slope_of = jax.jit(penalty), jax.jit(jax.grad(penalty))
RECTANGLE = SearchRectangle(*(jnp.asarray(x) for x in (0.30, 0.08, 0.08, 0.5, 0.0)))
PLANNER = paper_a(GAIT, RECTANGLE, Extent((0, 0), 0), CogRule(jnp.asarray(0.5)), speed=0.05, least_bend=0.35)
SETTING = Setting(PLANNER, margin=jnp.asarray(0.05), energy=jnp.asarray(1000.0))


def test_every_slack_by_hand(pegasus):
    """H_COG 0.50 m lowered by 0.02, L_Step 0.20, L_Search 0.30; legs as in the paper: sqrt(L_Leg^2 - H_COG^2) is `half`."""
    thigh, shank = -np.asarray(pegasus.link_offset)[0, 1:, 2]
    half = np.sqrt((thigh + shank) ** 2 - 0.48**2)
    wanted = {
        "knee_bend": 0.15,
        "margin": 0.02,
        "torque": 0.2,
        "load": 0.25,
        "joint_range": 0.4,
        "search_behind": 0.1,
        "step_reach": half - 0.2,
        "search_reach": 2.0 * half - 0.1 - 0.3,
        "knee_clear": 0.48 - thigh,
        "workspace": 0.5 - 0.002,  # H_COG over a lower bound of nothing, less a tenth of the foot's radius
    }
    slack = jax.jit(StandInLab(robot=pegasus).slack)(PLANNER, CHECKS, SETTING)
    assert_allclose(dict(zip(CONSTRAINTS, np.asarray(slack)))["step_reach"], wanted["step_reach"], rtol=1e-12)
    assert_allclose(slack, [wanted[name] for name in CONSTRAINTS], rtol=1e-9)


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_one_unit_of_violation_costs_about_the_baseline(name):
    """2 (sqrt(1 + v^2) - 1) for v units: 0.83 for one, nearly 2 v - 2 for many, nothing while kept."""
    at = CONSTRAINTS.index(name)
    broken = lambda units: np.where(np.arange(len(CONSTRAINTS)) == at, -units * UNITS[name], 1.0)  # noqa: E731
    assert_allclose(fined(broken(1.0)), 2.0 * (np.sqrt(2.0) - 1.0), rtol=1e-6)
    assert_allclose(fined(broken(100.0)), 198.0, rtol=1e-3)
    assert fined(broken(-0.1)) == 0.0
    slope = np.asarray(slope_of(broken(2.0)))
    assert_allclose(slope[at], -2.0 * 2.0 / np.sqrt(5.0) / UNITS[name], rtol=1e-6)
    assert np.count_nonzero(slope) == 1


def test_energy_per_metre_by_convention():
    joints = lambda total: np.full((4, 3), total / 12.0)  # noqa: E731
    energy = Power(joints(60.0), joints(100.0), joints(40.0))  # regeneration returns 40 J
    assert_allclose(jax.jit(per_metre)(energy, 0.5), [200.0, 280.0, 360.0], rtol=1e-12)


def test_a_vectors_numbers_take_their_places_in_the_planner_of_the_lane():
    """The least knee bend that binds stays the lane's, whatever is moved."""
    names = ("swing.clearance", "gait.skew", "limits.knee_bend")
    planner = StandInLab(move=names).planner(jnp.asarray([0.07, 0.15, 0.2]), SETTING)
    wanted = dict(zip(leaf_names(PLANNER), read_leaves(PLANNER, leaf_names(PLANNER)).tolist()))
    wanted |= dict(zip(names, (0.07, 0.15, 0.2)))
    assert dict(zip(leaf_names(planner), read_leaves(planner, leaf_names(planner)).tolist())) == wanted
    assert SETTING.least_bend == 0.35
