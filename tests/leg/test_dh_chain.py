"""Paper C's quadruped (4.1, Fig. 8) as a Denavit-Hartenberg chain: an oracle of the kinematics that shares nothing with it.

From the centre of the body two virtual axes, both vertical, which do not turn: one at half the body's length, one at half its
width. Then hip, thigh and knee; the thigh's axis is a shoulder's width outwards. A row is theta, d, a, alpha of the standard
convention: turn about z, move along z, move along the new x, turn about it.
"""

import tomllib
from pathlib import Path

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg.conventions import LEG_END, LEG_SIDE, LEGS
from jaxleg.leg.kinematics import Reach, foot_jacobian, leg_angles, leg_frames
from jaxleg.robot import load_robot

ROBOTS = Path(__file__).parents[2] / "configs/robots"
QUARTER = np.pi / 2


def left_table(end, length, width, shoulder, thigh, shank, q):
    """Front leg: `end` 1, hind leg: -1. The hip's axis points forward, the thigh's and the knee's to the right."""
    return [
        (0.0, 0.0, end * length, 0.0),  # virtual: to the end of the body
        (QUARTER, 0.0, width, QUARTER),  # virtual: to its side; the next axis is the hip's
        (q[0] - QUARTER, 0.0, 0.0, QUARTER),  # hip; x now points down the leg
        (q[1], -shoulder, thigh, 0.0),
        (q[2], 0.0, shank, 0.0),
    ]


def right_table(end, length, width, shoulder, thigh, shank, q):
    """The same mirrored: the hip's axis points backward, so that abduction is positive, and the shoulder to the right."""
    return [
        (0.0, 0.0, end * length, 0.0),
        (-QUARTER, 0.0, width, QUARTER),
        (q[0] - QUARTER, 0.0, 0.0, -QUARTER),
        (q[1], shoulder, thigh, 0.0),
        (q[2], 0.0, shank, 0.0),
    ]


def transform(theta, d, a, alpha):
    """Frame i in frame i - 1."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]])


def chain(lengths, leg, q):
    """Foot in the body's frame [m], and its derivative by the angles: z x (foot - origin) of each axis that turns."""
    table = left_table if LEG_SIDE[leg] > 0 else right_table
    frames = [np.eye(4)]
    for row in table(LEG_END[leg], *lengths, q):
        frames.append(frames[-1] @ transform(*row))
    foot = frames[-1][:3, 3]
    return foot, np.stack([np.cross(f[:3, 2], foot - f[:3, 3]) for f in frames[2:5]], axis=1)


@jax.jit
@jax.vmap
def ours(hip, axis, offset, angles):
    frames = leg_frames(axis, offset, angles)
    return hip + frames.foot, foot_jacobian(frames)


@pytest.mark.parametrize("name", ["dh_quadruped", "pegasus"])
def test_foot_and_jacobian_are_those_of_the_chain(name):
    geometry = tomllib.loads((ROBOTS / f"{name}.toml").read_text())["geometry"]
    lengths = [geometry["hip_spacing"] / 2, geometry["hip_width"] / 2, *(geometry[k] for k in ("hip_link", "thigh", "shank"))]
    robot = load_robot(ROBOTS / f"{name}.toml")
    rng = np.random.default_rng(0)
    leg, angles = rng.permutation(np.arange(400) % len(LEGS)), rng.uniform(-np.pi, np.pi, (400, 3))
    foot, jacobian = ours(*(np.asarray(x)[leg] for x in (robot.hip_position, robot.joint_axis, robot.link_offset)), angles)
    expected = [chain(lengths, k, q) for k, q in zip(leg, angles)]
    assert_allclose(foot, np.stack([f for f, _ in expected]), atol=1e-9)
    assert_allclose(jacobian, np.stack([j for _, j in expected]), atol=1e-9)


def test_it_stands_within_its_joint_ranges():
    robot = load_robot(ROBOTS / "dh_quadruped.toml")
    below = np.stack([0.0 * np.ones(4), np.array(LEG_SIDE) * 0.07, -0.36 * np.ones(4)], axis=1)
    inverse = jax.jit(jax.vmap(leg_angles, (0, 0, None, 0)))
    angles, status = jax.device_get(inverse(robot.joint_axis, robot.link_offset, robot.knee_sign, below))
    low, high = np.moveaxis(np.asarray(robot.joint_range), -1, 0)
    assert np.all(status == Reach.OK)
    assert np.all((angles > low + 0.2) & (angles < high - 0.2))
    assert_allclose(angles, np.broadcast_to(angles[0], (4, 3)), atol=1e-12)  # abduction and swing alike on all legs
