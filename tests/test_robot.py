import copy
import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.conventions import GRAVITY, LEFT_LEGS, LEG_SIDE, RIGHT_LEGS, InputError
from jaxleg.gait.limits import leg_length
from jaxleg.robot import Robot, RobotFile, build_robot, load_robot
from jaxleg.settings import load
from jaxleg.walk.reference import Pose, instant_of

PEGASUS = Path(__file__).parents[1] / "configs/robots/pegasus.toml"
MIRROR = np.array([1.0, -1.0, 1.0])


def test_mass_and_load_of_a_leg(pegasus):
    assert_allclose(pegasus.mass, 35.2)
    assert 86.2 <= pegasus.mass * GRAVITY / 4 <= 86.4


def test_stretched_leg_is_as_long_as_the_paper_says(pegasus):
    assert_allclose(-np.asarray(pegasus.link_offset)[:, 1:, 2].sum(axis=1), 0.60)


@pytest.mark.parametrize("field", ["hip_position", "link_offset", "link_com"])
def test_places_are_mirrored(pegasus, field):
    values = np.asarray(getattr(pegasus, field))
    assert_allclose(values[list(LEFT_LEGS)], values[list(RIGHT_LEGS)] * MIRROR)
    assert np.any(values[..., 1] * np.reshape(LEG_SIDE, (4,) + (1,) * (values.ndim - 2)) > 0)


@pytest.mark.parametrize("field", ["link_mass", "link_inertia", "rotor_inertia", "joint_damping", "torque_limit"])
def test_legs_are_alike(pegasus, field):
    values = np.asarray(getattr(pegasus, field))
    assert_allclose(values, np.broadcast_to(values[0], values.shape))


def test_inertia_of_every_body_is_that_of_a_solid(pegasus):
    for moments in (np.asarray(pegasus.link_inertia).reshape(-1, 3), np.asarray(pegasus.trunk_inertia)[None]):
        assert np.all(moments > 0)
        assert np.all(moments.sum(axis=1) >= 2 * moments.max(axis=1))  # triangle inequality


def test_uniform_rod_about_its_middle(pegasus):
    mass, length = np.asarray(pegasus.link_mass)[0, 2], 0.34
    inertia, about_axis = np.asarray(pegasus.link_inertia)[0, 2], mass * 0.03**2
    assert_allclose(inertia[2], about_axis)
    assert_allclose(inertia[:2], mass * length**2 / 12 + about_axis)


@pytest.mark.parametrize(("knees", "sign"), [("backward", 1.0), ("forward", -1.0)])
def test_knee_sign(knees, sign):
    file = load(RobotFile, PEGASUS)
    file = dataclasses.replace(file, geometry=dataclasses.replace(file.geometry, knees=knees))
    assert build_robot(file).knee_sign == sign


def test_robot_is_a_pytree_of_all_its_fields(pegasus):
    assert len(jax.tree.leaves(pegasus)) == len(dataclasses.fields(Robot))
    assert all(np.all(np.isfinite(leaf)) for leaf in map(np.asarray, jax.tree.leaves(pegasus)))


def test_joint_ranges_are_wide_open_unless_given(pegasus):
    assert_allclose(pegasus.joint_range, np.broadcast_to([-np.pi, np.pi], (4, 3, 2)))
    given = load_robot(PEGASUS.with_name("dh_quadruped.toml")).joint_range
    assert_allclose(given, np.broadcast_to(np.deg2rad([[-40, 60], [-100, 100], [-155, -5]]), (4, 3, 2)))


def test_the_mass_of_a_batch_of_robots_is_each_ones(pegasus):
    factors = np.array([1.0, 2.0, 3.0])
    many = jax.jit(lambda robot: jax.tree.map(lambda x: factors.reshape(3, *(1,) * x.ndim) * x[None], robot))(pegasus)
    assert_allclose(jax.jit(lambda robots: robots.mass)(many), 35.2 * factors)
    assert_allclose(jax.jit(jax.vmap(lambda robot: robot.mass))(many), 35.2 * factors)
    assert_allclose(jax.jit(leg_length)(many), 0.60 * factors)


def test_torque_has_a_gradient_in_every_number_of_the_file():
    """Sum of the torques' squares in a standing posture, through `build_robot`, against central differences."""
    file = load(RobotFile, PEGASUS)
    pose = np.array([0.02, 0.01, 0.46, 0.05, -0.04, 0.1])
    feet = np.array([[0.36, 0.2, 0.03], [0.28, -0.2, 0.0], [-0.28, 0.2, 0.01], [-0.36, -0.2, -0.02]])

    def effort(numbers):
        robot = build_robot(with_numbers(file, numbers))
        at = Pose(jnp.asarray(pose), jnp.asarray(feet), *(jnp.zeros_like(x) for x in (pose, feet, pose, feet)))
        return jnp.sum(instant_of(robot, at, jnp.ones(4)).torque ** 2)

    numbers = {"geometry.thigh": 0.26, "geometry.hip_link": 0.08, "masses.total": 35.2, "masses.shank": 0.4}
    numbers |= {"masses.thigh_com": 0.3, "geometry.hip_spacing": 0.6}
    run = jax.jit(jax.value_and_grad(effort))
    slopes = run(numbers)[1]
    for key, value in numbers.items():
        step = 1e-5 * value
        ahead, behind = (run(numbers | {key: value + d})[0] for d in (step, -step))
        assert_allclose(slopes[key], (ahead - behind) / (2.0 * step), rtol=1e-6, err_msg=key)


def with_numbers(file, numbers):
    for key, value in numbers.items():
        table, name = key.split(".")
        part = copy.copy(getattr(file, table))  # not `replace`: jaxtyping's hook lets no tracer through __init__
        object.__setattr__(part, name, value)
        file = dataclasses.replace(file, **{table: part})
    return file


def test_a_bad_file_is_refused_with_its_key(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(PEGASUS.read_text().replace("thigh = 0.26", "thigh = -0.26"))
    with pytest.raises(InputError, match=r"geometry\.thigh"):
        load_robot(path)
