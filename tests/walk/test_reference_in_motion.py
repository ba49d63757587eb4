"""The reference of a trunk that moves and turns about all axes, over standing and swinging feet, against MuJoCo and scipy."""

import jax
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.motions import SWINGS, Mujoco, sloping, step_instants

SECONDS, SAMPLES = (0.5, 0.4), (250, 200)  # 2 ms
TERRAIN = sloping(0.1, -0.05)
BREAKS = np.array([250, 270, 286, 350, 414, 430])  # phases, load and lift shares, mid-swing: accelerations jump there
INSIDE = [k for k in range(3, sum(SAMPLES) - 3, 7) if np.abs(k - BREAKS).min() > 3]


@pytest.fixture(scope="module")
def moved(pegasus):
    return jax.tree.map(np.asarray, step_instants(pegasus, TERRAIN, SECONDS, SAMPLES))


def rates(time, values):
    """Fourth-order central differences."""
    h, x = time[1] - time[0], np.asarray(values)
    k = np.array(INSIDE)
    return (8.0 * (x[k + 1] - x[k - 1]) - (x[k + 2] - x[k - 2])) / (12.0 * h)


def test_the_samples_are_equally_spaced_in_each_phase(moved):
    time = moved[0]
    np.testing.assert_allclose(time, np.linspace(0.0, sum(SECONDS), sum(SAMPLES) + 1), atol=1e-12)


def test_joints_move_at_the_rates_of_their_angles(moved):
    time, at, _ = moved
    np.testing.assert_allclose(rates(time, at.angles), at.velocity[INSIDE], atol=2e-4)
    np.testing.assert_allclose(rates(time, at.velocity), at.acceleration[INSIDE], atol=2e-2)
    assert np.abs(at.velocity).max() > 1.0
    assert np.abs(at.acceleration).max() > 20.0


def test_the_trunk_moves_and_spins_at_the_rates_of_its_pose(moved):
    time, _, track = moved
    np.testing.assert_allclose(rates(time, track.trunk_pos), track.trunk_vel[INSIDE, :3], atol=1e-6)
    turns, k = Rotation.from_quat(np.roll(track.trunk_quat, -1, axis=1)), np.array(INSIDE)
    spin = (turns[k - 1].inv() * turns[k + 1]).as_rotvec() / (time[k + 1] - time[k - 1])[:, None]  # in B
    np.testing.assert_allclose(spin, track.trunk_vel[k, 3:], atol=2e-4)
    assert np.abs(spin).max(axis=0).min() > 0.1


def test_the_angles_put_the_feet_where_the_plan_has_them(moved, pegasus):
    _, at, track = moved
    mujocos = Mujoco(pegasus)
    for k in INSIDE:
        body = mujocos(np.concatenate([track.trunk_pos[k], track.trunk_quat[k], track.joint_pos[k].ravel()]))
        np.testing.assert_allclose(body.feet, track.foot_pos[k], atol=1e-9)
        np.testing.assert_allclose(body.com, at.com[k], atol=1e-9)


def test_the_torques_and_the_ground_together_make_the_motion(moved, pegasus):
    """What the motors leave of MuJoCo's inverse dynamics the feet must give; they give the trunk its wrench, too.

    So the loads, and that the foot in the air gets nothing.
    """
    time, at, track = moved
    mujocos = Mujoco(pegasus)
    model, data = mujocos.model, mujocos.data
    velocity = np.concatenate([track.trunk_vel, track.joint_vel.reshape(-1, 12)], axis=1)
    for k, acceleration in zip(INSIDE, rates(time, velocity)):
        q = np.concatenate([track.trunk_pos[k], track.trunk_quat[k], track.joint_pos[k].ravel()])
        body = mujocos(q, velocity[k])
        data.qacc[:] = acceleration
        mujoco.mj_inverse(model, data)
        rest = data.qfrc_inverse - np.concatenate([np.zeros(6), track.joint_torque[k].ravel()])
        force = np.stack(
            [np.linalg.solve(body.jacobian[i, :, 6 + 3 * i : 9 + 3 * i].T, rest[6 + 3 * i : 9 + 3 * i]) for i in range(4)]
        )
        np.testing.assert_allclose(np.einsum("lik,li->k", body.jacobian[:, :, :6], force), rest[:6], atol=0.2)
        weight = track.contact[k]
        np.testing.assert_allclose(force[:, 2], weight * at.load[k], atol=0.2)
        if weight[SWINGS] == 0.0:
            np.testing.assert_allclose(force[SWINGS], 0.0, atol=0.1)
        assert np.all(np.delete(force[:, 2], SWINGS) > 5.0)


def test_load_is_taken_off_a_foot_before_it_moves_and_given_back_after(moved):
    _, _, track = moved
    weight, height = track.contact[:, SWINGS], track.foot_pos[:, SWINGS, 2]
    swing = np.arange(SAMPLES[1] + 1) / SAMPLES[1]
    np.testing.assert_allclose(weight[: SAMPLES[0]], 1.0)
    outer = np.clip(np.minimum(swing, 1.0 - swing) / 0.1, 0.0, 1.0)
    expected = 1.0 - (10.0 * outer**3 - 15.0 * outer**4 + 6.0 * outer**5)
    np.testing.assert_allclose(weight[SAMPLES[0] :], expected, atol=1e-9)
    still = (swing <= 0.1) | (swing >= 0.9)
    assert np.ptp(height[SAMPLES[0] :][swing <= 0.1]) == 0.0
    assert np.all(weight[SAMPLES[0] :][~still] < 1e-12)
    np.testing.assert_array_equal(np.delete(track.contact, SWINGS, axis=1), 1.0)
