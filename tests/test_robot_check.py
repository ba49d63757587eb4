"""Robots that cannot be are refused when they are read, in one sentence that names file, key, value and what is allowed."""

import tomllib
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

from jaxleg.conventions import InputError
from jaxleg.leg.kinematics import foot_jacobian, leg_frames
from jaxleg.robot import RobotFile, check, load_robot
from jaxleg.settings import load

ROBOTS = Path(__file__).parents[1] / "configs/robots"


@pytest.fixture
def spoil(tmp_path):
    """Pegasus, or another robot, with some keys changed, as a file."""

    def write(name="pegasus", **changes):
        table = tomllib.loads((ROBOTS / f"{name}.toml").read_text())
        for key, value in changes.items():
            part = next(t for t in ("geometry", "masses", "motor") if key in table[t] or key in OPTIONAL[t])
            table[part][key] = value
        path = tmp_path / "robot.toml"
        path.write_text(tomli_w.dumps(table))
        return path

    return write


OPTIONAL = {"geometry": ("hip_range_deg", "thigh_range_deg", "knee_range_deg"), "masses": (), "motor": ()}
IMPOSSIBLE = {
    "lighter than its legs": (dict(total=10.0), ["masses.total is 10", "12.4 kg", "at least 13.78"]),
    "no trunk": (dict(total=12.4), ["masses.total is 12.4"]),
    "no trunk's length": (dict(trunk_size=[0.0, 0.24, 0.15]), ["geometry.trunk_size[0] is 0", "at least 0.01"]),
    "trunk inside out": (dict(trunk_size=[0.8, -0.24, 0.15]), ["geometry.trunk_size[1] is -0.24"]),
    "massless link": (dict(shank=1e-300), ["1e-300", "at least"]),
    "dust": (dict(hip=1e-5), ["masses.hip is 1e-05 kg", "at least 0.0001 of masses.total"]),
    "too weak": (dict(torque_limit=1e-6), ["motor.torque_limit is 1e-06 N m", "must be at least", "easiest standing posture"]),
    "knees never bent": (dict(knee_range_deg=[-3.0, 3.0]), ["geometry.knee_range_deg is [-3.0, 3.0]", "stands with its knees"]),
    "knees bent the other way": (dict(knee_range_deg=[-150.0, -10.0]), ["knee_range_deg", "between 6 and"]),
    "thighs up": (dict(thigh_range_deg=[120.0, 170.0]), ["geometry.thigh_range_deg is [120.0, 170.0]"]),
    "radians": (dict(knee_range_deg=[0.2, 2.7]), ["geometry.knee_range_deg is [0.2, 2.7]", "radians"]),
    "wrong way round": (dict(knee_range_deg=[150.0, 10.0]), ["knee_range_deg is [150.0, 10.0]", "least angle to the greatest"]),
    "ranges against each other": (dict(thigh_range_deg=[60.0, 90.0], knee_range_deg=[5.0, 40.0]), ["range_deg"]),
    "endless gear": (dict(gear_ratio=1e200), ["motor.gear_ratio is 1e+200", "at most 10000"]),
    "weight far away": (dict(com_offset=[100.0, 0.0, 0.0]), ["masses.com_offset is 100 m along x", "-0.4 to 0.4"]),
    "weight below": (dict(com_offset=[0.0, 0.0, -0.1]), ["masses.com_offset is -0.1 m along z"]),
}


@pytest.mark.parametrize("kind", IMPOSSIBLE)
def test_an_impossible_robot_is_refused_by_name(spoil, kind):
    changes, words = IMPOSSIBLE[kind]
    with pytest.raises(InputError) as caught:
        load_robot(spoil(**changes))
    sentence = str(caught.value)
    assert "\n" not in sentence
    for word in ("robot.toml: ", *words):
        assert word in sentence


POSSIBLE = {
    "as they are": dict(),
    "no hip link": dict(hip_link=0.0),
    "weight behind": dict(com_offset=[-0.1, 0.0, 0.0]),
    "knees of paper": dict(knee_range_deg=[48.0, 156.0]),
    "weak": dict(torque_limit=12.0),
}


@pytest.mark.parametrize("kind", POSSIBLE)
def test_a_possible_robot_is_read(spoil, kind):
    assert load_robot(spoil(**POSSIBLE[kind])).mass > 0.0


@pytest.mark.parametrize("path", sorted(ROBOTS.glob("*.toml")), ids=lambda p: p.stem)
def test_every_robot_of_the_package_is_read(path):
    load_robot(path)


def test_mujocos_objections_are_told(spoil, monkeypatch):
    monkeypatch.setattr(check, "robot_mjcf", lambda robot: "<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>")
    with pytest.raises(InputError, match=r"robot.toml: MuJoCo cannot build this robot: .*size"):
        load_robot(spoil())


@pytest.mark.parametrize("name", ["pegasus", "dh_quadruped"])
def test_standing_postures_are_those_of_the_robot(name):
    """Heights and lever arms of the postures against forward kinematics and Jacobian of the robot that is built."""
    path = ROBOTS / f"{name}.toml"
    file, robot = load(RobotFile, path), load_robot(path)
    found = check._standing(file.geometry, check._spans(file.geometry))
    for i in np.linspace(0, len(found.angles) - 1, 7).astype(int):
        frames = leg_frames(robot.joint_axis[0], robot.link_offset[0], jnp.array(found.angles[i]))
        np.testing.assert_allclose(-frames.foot[2], found.height[i], atol=1e-12)
        np.testing.assert_allclose(np.abs(np.asarray(foot_jacobian(frames))[2]), found.arm[i], atol=1e-12)
