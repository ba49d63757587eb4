"""Inverse dynamics and load sharing against C MuJoCo, numpy and virtual work."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.conventions import GRAVITY
from jaxleg.leg import dynamics
from jaxleg.leg.dynamics import Motion
from jaxleg.leg.kinematics import foot_position
from jaxleg.leg.moving import Moving, Wrench
from jaxleg.robot.mjcf import robot_mjcf
from jaxleg.vectors import Rows, vector, vectors

folds_of = jax.jit(dynamics.all_folds)
UP = np.array([0.0, 0.0, GRAVITY])
UPRIGHT = np.eye(3)


def moving(spin, spin_rate, acceleration):
    return Moving(*(vector(jnp.asarray(x)) for x in (spin, spin_rate, acceleration)))


REST = Motion(*[np.zeros((4, 3))] * 2, moving(np.zeros(3), np.zeros(3), UP))


@jax.jit
def inverse_dynamics(robot, folds, motion):
    """Joint torques, force and moment."""
    torque, wrench = dynamics.inverse_dynamics(robot, folds, motion)
    return torque, wrench.force.array(), wrench.moment.array()


@jax.jit
def share_load(feet, weight, force, moment):
    shared = dynamics.share_load(jax.vmap(vector)(feet), weight, Wrench(vector(force), vector(moment)))
    return jax.vmap(lambda v: v.array())(shared)


@jax.jit
def torques_on_ground(robot, folds, motion, weight, turn):
    """Joint torques, and forces in W (leg, 3)."""
    torque, force = dynamics.torques_on_ground(robot, folds, motion, weight, Rows(*vectors(turn)))
    return torque, jax.vmap(lambda v: v.array())(force)


@jax.jit
def centre_of_mass(robot, folds):
    return dynamics.centre_of_mass(robot, folds).array()


SAMPLES = [np.random.default_rng(seed) for seed in range(4)]


@pytest.fixture(scope="module")
def lopsided(pegasus):
    """Pegasus with the trunk's centre of mass off every axis."""
    return pegasus.__class__(**(vars(pegasus) | {"trunk_com": jnp.array([0.07, -0.03, 0.02])}))


@pytest.fixture(scope="module")
def simulation(lopsided):
    model = mujoco.MjModel.from_xml_string(robot_mjcf(lopsided))
    return model, mujoco.MjData(model)


def random_state(rng, data):
    data.qpos[:] = rng.uniform(-1.0, 1.0, 19)
    data.qpos[3:7] /= np.linalg.norm(data.qpos[3:7])
    data.qvel[:], data.qacc[:] = rng.normal(size=18), 5.0 * rng.normal(size=18)


def legs_of(values):
    return np.array(values[-12:]).reshape(4, 3)


@pytest.mark.parametrize("rng", SAMPLES)
def test_inverse_dynamics_is_mujocos(lopsided, simulation, rng):
    model, data = simulation
    random_state(rng, data)
    acceleration = data.qacc.copy()
    mujoco.mj_inverse(model, data)
    turn = data.xmat[1].reshape(3, 3)  # B -> W
    motion = Motion(
        *(legs_of(data.qvel), legs_of(acceleration)),
        moving(data.qvel[3:6], acceleration[3:6], turn.T @ (acceleration[:3] + UP)),
    )
    torque, force, moment = inverse_dynamics(lopsided, folds_of(lopsided, legs_of(data.qpos)), motion)
    assert_allclose(torque, legs_of(data.qfrc_inverse), atol=1e-8)  # qfrc_inverse gives back the joints' damping
    assert_allclose(turn @ force, data.qfrc_inverse[:3], atol=1e-8)
    assert_allclose(moment, data.qfrc_inverse[3:6], atol=1e-8)


@pytest.mark.parametrize("rng", SAMPLES)
def test_centre_of_mass_is_mujocos(lopsided, simulation, rng):
    model, data = simulation
    random_state(rng, data)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    ours = np.asarray(centre_of_mass(lopsided, folds_of(lopsided, legs_of(data.qpos))))
    assert_allclose(data.qpos[:3] + data.xmat[1].reshape(3, 3) @ ours, data.subtree_com[1], atol=1e-12)


def random_load(rng, loaded):
    feet = np.array([[0.3, 0.2, -0.5], [0.3, -0.2, -0.5], [-0.3, 0.2, -0.5], [-0.3, -0.2, -0.5]])
    feet += rng.uniform(-0.08, 0.08, (4, 3))
    weight = rng.uniform(0.2, 1.0, 4) * np.isin(range(4), loaded)
    return feet, weight, 100.0 * rng.normal(size=3), 30.0 * rng.normal(size=3)


def grasp_matrix(feet):
    return np.vstack([np.tile(np.eye(3), 4), np.hstack([np.cross(foot, np.eye(3)).T for foot in feet])])


@pytest.mark.parametrize("loaded", [(0, 1, 2, 3), (0, 1, 2), (1, 2, 3), (0, 2, 3)])
@pytest.mark.parametrize("rng", SAMPLES)
def test_share_load_is_the_weighted_least_norm(rng, loaded):
    feet, weight, force, moment = random_load(rng, loaded)
    ours = np.asarray(share_load(feet, weight, force, moment))
    assert_allclose(ours.sum(axis=0), force, atol=1e-9)
    assert_allclose(np.cross(feet, ours).sum(axis=0), moment, atol=1e-9)
    assert_allclose(ours[weight == 0], 0.0)
    root = np.repeat(np.sqrt(weight), 3)
    least = root * (np.linalg.pinv(grasp_matrix(feet) * root) @ np.concatenate([force, moment]))
    assert_allclose(ours.ravel(), least, atol=1e-8)


@pytest.mark.parametrize("airborne", range(4))
def test_three_feet_on_level_ground_are_statically_determinate(airborne):
    rng = np.random.default_rng(airborne)
    on = [leg for leg in range(4) if leg != airborne]
    feet, weight, _, _ = random_load(rng, on)
    feet[:, 2] = -0.5
    moment = np.array([*rng.normal(size=2), 0.0])
    force = np.array([0.0, 0.0, 345.0])
    ours = np.asarray(share_load(feet, weight, force, moment))
    balance = np.stack([np.ones(3), feet[on, 1], -feet[on, 0]])
    assert_allclose(ours[on, 2], np.linalg.solve(balance, [345.0, *moment[:2]]), atol=1e-9)
    assert_allclose(ours[:, :2], 0.0, atol=1e-9)


@jax.jit
@jax.grad
def work_rate(q, robot, force):
    """Of gravity and ground, whose forces are held constant; the trunk stays."""
    com = dynamics.centre_of_mass(robot, dynamics.all_folds(robot, q))
    feet = jax.vmap(foot_position)(robot.joint_axis, robot.link_offset, q)
    return jnp.sum(force * feet) - robot.mass * GRAVITY * com.z


@pytest.mark.parametrize("rng", SAMPLES)
def test_standing_still_does_no_virtual_work(lopsided, rng):
    angles = [[0.0, -0.5, 1.0]] * 4 + rng.uniform(-0.3, 0.3, (4, 3))
    weight = rng.uniform(0.3, 1.0, 4)
    torque, force = jax.device_get(torques_on_ground(lopsided, folds_of(lopsided, angles), REST, weight, UPRIGHT))
    assert_allclose(torque + work_rate(angles, lopsided, force), 0.0, atol=1e-9)
    assert_allclose(force.sum(axis=0), float(lopsided.mass) * UP, atol=1e-9)


def test_airborne_leg_bears_only_itself(pegasus):
    folds = folds_of(pegasus, np.tile([0.1, -0.5, 1.0], (4, 1)))
    torque, force = jax.device_get(torques_on_ground(pegasus, folds, REST, np.array([1.0, 1.0, 0.0, 1.0]), UPRIGHT))
    free = np.asarray(inverse_dynamics(pegasus, folds, REST)[0])
    assert_allclose(force[2], 0.0)
    assert_allclose(torque[2], free[2])
    assert np.all(np.linalg.norm(torque - free, axis=1)[[0, 1, 3]] > 1.0)
