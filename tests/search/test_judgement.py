"""How a lane is judged: slacks, penalty and objective worked out by hand, and what the compiled judges are made of."""

import dataclasses
import functools
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.gait.params import GaitParams
from jaxleg.leg.energy import Power
from jaxleg.search.config import PARAMETERS
from jaxleg.search.lanes import CONSTRAINTS, Lab, Setting, penalty, per_metre, to_params
from jaxleg.status import Status
from jaxleg.walk.data import PlanChecks

DEGREE = np.pi / 180.0
UNITS = dict(zip(CONSTRAINTS, (DEGREE, 0.01, 0.05, 0.1, DEGREE, 0.01, 0.01, 0.01, 0.01)))  # what costs a baseline's energy
CHECKS = PlanChecks(
    knee_bend=jnp.asarray(0.5),
    margin=jnp.asarray(0.07),
    torque_ratio=jnp.asarray(0.8),
    load=jnp.asarray(0.30),
    joint_room=jnp.asarray(0.4),
    lowering=jnp.asarray(0.02),
    status=jnp.asarray(Status.OK),
)
GAIT = GaitParams(*(jnp.asarray(x) for x in (0.5, -0.1, 0.1, 0.2, 0.62, 0.36, 0.08, 0.45, 0.5, 0.1)))
fined, slope_of = jax.jit(penalty), jax.jit(jax.grad(penalty))
SETTING = Setting(least_bend=jnp.asarray(0.35), margin=jnp.asarray(0.05), energy=jnp.asarray(1000.0))


@pytest.fixture(scope="module")
def judge(pegasus):
    """What `Lab.slack` needs of a lab: the robot, and a search rectangle 0.30 m long."""
    return SimpleNamespace(robot=pegasus, rectangle=SimpleNamespace(length=jnp.asarray(0.30)))


def test_every_slack_by_hand(judge, pegasus):
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
    }
    slack = jax.jit(functools.partial(Lab.slack, judge))(GAIT, CHECKS, SETTING)
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


def test_a_vector_names_the_gait():
    vector = jnp.arange(10.0)
    assert dataclasses.asdict(to_params(vector)) == dict(zip(PARAMETERS, np.arange(10.0)))
    assert PARAMETERS[:4] == ("hip_height", "foot_offset", "skew", "step_length")
