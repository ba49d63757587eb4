import dataclasses

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.conventions import GRAVITY, JOINTS, LEGS
from jaxleg.robot.mjcf import LINKS, robot_mjcf


@pytest.fixture(scope="module")
def model(pegasus):
    return mujoco.MjModel.from_xml_string(robot_mjcf(pegasus))


def names(model, kind, count):
    return [mujoco.mj_id2name(model, kind, i) for i in range(count)]


def test_sizes_mass_and_gravity(pegasus, model):
    assert (model.nq, model.nv, model.nsite) == (19, 18, 4)
    assert_allclose(model.body_mass.sum(), pegasus.mass)
    assert_allclose(model.opt.gravity, [0.0, 0.0, -GRAVITY])


def test_joints_and_feet_are_in_the_order_of_the_conventions(model):
    links = [f"{leg}_{link}" for leg in LEGS for link in LINKS]
    assert len(LINKS) == len(JOINTS)
    assert names(model, mujoco.mjtObj.mjOBJ_JOINT, model.njnt) == ["root", *links]
    assert names(model, mujoco.mjtObj.mjOBJ_BODY, model.nbody) == ["world", "trunk", *links]
    assert names(model, mujoco.mjtObj.mjOBJ_SITE, 4) == [f"{leg}_foot" for leg in LEGS]


def inertia_tensor(model, body):
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    return turn @ np.diag(model.body_inertia[body]) @ turn.T


@pytest.mark.parametrize("body", range(12))
def test_every_link_is_the_robots(pegasus, model, body):
    leg, j = divmod(body, 3)
    names = ("link_inertia", "link_mass", "link_com", "joint_axis", "rotor_inertia", "joint_damping")
    inertia, mass, com, axis, rotor, damping = (np.asarray(getattr(pegasus, name))[leg, j] for name in names)
    assert_allclose(inertia_tensor(model, 2 + body), np.diag(inertia), atol=1e-12)
    assert_allclose(model.body_mass[2 + body], mass)
    assert_allclose(model.body_ipos[2 + body], com)
    assert_allclose(model.jnt_axis[1 + body], axis)
    assert_allclose(model.dof_armature[6 + body], rotor)
    assert_allclose(model.dof_damping[6 + body], damping)


def test_trunk_is_the_robots(pegasus, model):
    assert_allclose(inertia_tensor(model, 1), np.diag(pegasus.trunk_inertia), atol=1e-12)
    assert_allclose(model.body_mass[1], pegasus.trunk_mass)
    assert_allclose(model.dof_damping[:6], 0.0)
    assert_allclose(model.dof_armature[:6], 0.0)


@pytest.mark.parametrize("feet_contact", [False, True])
def test_only_the_feet_and_the_trunk_collide_and_only_when_asked(pegasus, feet_contact):
    model = mujoco.MjModel.from_xml_string(robot_mjcf(pegasus, feet_contact))
    collide = {model.geom(i).name for i in np.flatnonzero(model.geom_contype | model.geom_conaffinity)}
    assert collide == ({"trunk"} | {f"{leg}_foot" for leg in LEGS} if feet_contact else set())


def test_a_robot_without_hip_links_compiles_with_feet_where_kinematics_has_them(pegasus):
    links = np.array(pegasus.link_offset)
    links[:, 0] = 0.0
    plain = dataclasses.replace(pegasus, link_offset=jnp.asarray(links))
    model = mujoco.MjModel.from_xml_string(robot_mjcf(plain))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert_allclose(data.site_xpos, np.asarray(pegasus.hip_position) - [0.0, 0.0, 0.6], atol=1e-12)


def test_numbers_survive_the_text(pegasus, model):
    third = pegasus.__class__(**(vars(pegasus) | {"trunk_mass": jnp.array(23 + 1 / 3)}))
    assert mujoco.MjModel.from_xml_string(robot_mjcf(third)).body_mass[1] == 23 + 1 / 3
