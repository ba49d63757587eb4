"""Both engines' terms against C MuJoCo."""

import dataclasses

import jax
import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.search.config import Kind, Simulation, Study
from jaxleg.search.run import make_lab
from jaxleg.sim.engine import mjx_engine
from jaxleg.sim.legged import legged_engine


@pytest.mark.parametrize("make", [mjx_engine, legged_engine])
def test_a_study_chooses_the_engine(make, pegasus):
    study = Study(kinds={"flat": Kind()}, simulation=Simulation(engine=make.__name__.removesuffix("_engine")))
    assert make_lab(study, pegasus).engine.__qualname__.startswith(make.__name__)


def slanted(robot):
    """No centre on an axis, every link and leg of another size and weight."""
    rng = np.random.default_rng(2)

    def moved(name):
        value = getattr(robot, name)
        return value + 0.05 * rng.normal(size=value.shape)

    places = {name: moved(name) for name in ("link_com", "trunk_com", "hip_position", "link_offset")}
    scale = rng.uniform(0.5, 1.5, robot.link_mass.shape)
    weights = dict(link_mass=robot.link_mass * scale, link_inertia=robot.link_inertia * scale[..., None])
    return dataclasses.replace(robot, **places, **weights, rotor_inertia=robot.rotor_inertia * scale)


@pytest.fixture(
    scope="module",
    params=[(mjx_engine, False), (legged_engine, False), (legged_engine, True)],
    ids=["mjx", "legged", "legged, slanted"],
)
def pair(request, pegasus):
    """An engine's terms and MuJoCo's data at one random state."""
    make, odd = request.param
    pegasus = slanted(pegasus) if odd else pegasus
    rng = np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(robot_mjcf(pegasus))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = rng.uniform(-1.0, 1.0, 19), rng.normal(size=18)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    mujoco.mj_forward(model, data)
    terms = jax.jit(make(pegasus))(data.qpos, data.qvel)
    return jax.tree.map(np.asarray, terms), model, data


def test_mass_matrix_is_mujocos_and_legs_do_not_couple(pair):
    terms, model, data = pair
    mass = np.zeros((18, 18))
    mass[:6, :6] = terms.trunk
    for leg in range(4):
        own = slice(6 + 3 * leg, 9 + 3 * leg)
        mass[:6, own], mass[own, :6], mass[own, own] = (
            terms.coupling[leg],
            terms.coupling[leg].T,
            terms.legs[leg],
        )
    full = np.zeros((18, 18))
    mujoco.mj_fullM(model, data, full)
    assert_allclose(mass, full, atol=1e-9)


def test_bias_is_mujocos(pair):
    terms, _, data = pair
    assert_allclose(np.concatenate([terms.trunk_bias, terms.leg_bias.ravel()]), data.qfrc_bias, atol=1e-9)


def test_feet_and_centre_of_mass_are_mujocos(pair):
    terms, _, data = pair
    assert_allclose(terms.foot, data.site_xpos, atol=1e-12)
    assert_allclose(terms.com, data.subtree_com[1], atol=1e-12)


@pytest.mark.parametrize("leg", range(4))
def test_foot_jacobian_is_mujocos(pair, leg):
    terms, model, data = pair
    jacobian = np.zeros((3, 18))
    mujoco.mj_jacSite(model, data, jacobian, None, leg)
    assert_allclose(terms.foot_by_trunk[leg], jacobian[:, :6], atol=1e-10)
    assert_allclose(terms.foot_by_leg[leg], jacobian[:, 6 + 3 * leg : 9 + 3 * leg], atol=1e-10)
