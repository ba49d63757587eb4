"""A trunk on the ground is a fall, in MJX and in C MuJoCo; so is what cannot be computed, and a foot over unseen ground."""

import dataclasses
import os

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco import rollout

from jaxleg.control.contract import State
from jaxleg.sim import fall
from jaxleg.sim.contact import Ground
from jaxleg.sim.follow import follow
from jaxleg.sim.legged import legged_engine
from jaxleg.sim.model import build_model
from jaxleg.sim.referee import controls, no_log, replay, start_state
from jaxleg.sim.referee_feedback import follow_all
from jaxleg.sim.rollout import simulate
from jaxleg.sim.verdict import unstable
from jaxleg.terrain import Grid, flat
from jaxleg.walk.reference import reference
from jaxleg.walk.standing import up_down
from tests.crawls import gait

LEVEL = flat(Grid(46, 26, 0.04, (-0.9, -0.5)))
HEIGHT = 0.46  # of the trunk's middle; its lower face is 0.075 m lower, 0.80 x 0.24 m
X, Y = (np.asarray(LEVEL.origin)[i] + 0.04 * np.arange(n) for i, n in enumerate(LEVEL.elevation.shape))


def block(x, y, z):
    """Level ground with a block of this height between two x and two y."""
    inside = ((x[0] <= X) & (x[1] >= X))[:, None] & ((y[0] <= Y) & (y[1] >= Y))
    return np.where(inside, z, 0.0)


TRUNK_MEETS = {
    "wall across": (block((-0.03, 0.02), (-0.5, 0.5), 0.6), True),
    "wall along": (block((-0.1, 0.1), (-0.01, 0.03), 0.6), True),
    "pillar": (block((0.18, 0.2), (0.05, 0.08), 0.6), True),
    "wall below": (block((-0.03, 0.02), (-0.5, 0.5), 0.37), False),
    "box beside": (block((-0.1, 0.1), (0.22, 0.5), 0.6), False),
    "box ahead": (block((0.5, 0.7), (-0.1, 0.1), 0.6), False),
    "level": (block((0.0, -1.0), (0.0, -1.0), 0.0), False),
    "unseen below": (block((-0.1, 0.1), (-0.1, 0.1), np.nan), False),
    "unseen under a foot": (block((0.26, 0.34), (0.1, 0.3), np.nan), True),
}
EXPECTED = [fell for _, fell in TRUNK_MEETS.values()]
GROUNDS = np.array([ground for ground, _ in TRUNK_MEETS.values()])
LANES = dataclasses.replace(LEVEL, elevation=0, origin=None, resolution=None)


@pytest.fixture(scope="module")
def standing(pegasus):
    """A reference that stands for 0.3 s."""

    @jax.jit
    def stand(robot):
        return reference(robot, up_down(robot, gait(), LEVEL, HEIGHT, HEIGHT, 0.05), (2, 2))

    return jax.tree.map(np.asarray, stand(pegasus))


@pytest.fixture(scope="module")
def simulated(pegasus):
    """Meters by `simulate`, and the same walks by `follow`: grounds (lane, nx, ny) and as many references."""
    engine = legged_engine(pegasus)

    def lane(terrain, track):
        last = jnp.asarray(track.time.shape[0] - 1)
        numbers = last, 4, jnp.asarray(0.0025), jnp.asarray(125)
        return simulate(engine, pegasus, Ground(), terrain, track, 10), follow(
            engine, pegasus, Ground(), terrain, track, *numbers
        )

    run = jax.jit(jax.vmap(lane, in_axes=(LANES, 0)))
    return lambda grounds, tracks: jax.tree.map(
        np.asarray, run(dataclasses.replace(LEVEL, elevation=grounds), jax.tree.map(lambda *x: np.stack(x), *tracks))
    )


def single(elevation):
    return dataclasses.replace(LEVEL, elevation=jnp.asarray(elevation))


def test_a_trunk_on_the_ground_is_a_fall_in_the_rollout(simulated, standing):
    meters, followed = simulated(GROUNDS, [standing] * len(EXPECTED))
    assert meters.fell.tolist() == EXPECTED
    assert followed.meters.fell.tolist() == EXPECTED
    assert followed.finished.tolist() == [not fell for fell in EXPECTED]


def test_a_trunk_on_the_ground_is_a_fall_in_mujoco(pegasus, standing):
    grounds, tracks = [single(ground) for ground, _ in TRUNK_MEETS.values()], [standing] * len(EXPECTED)
    assert replay(pegasus, grounds, tracks, 0.8).fell.tolist() == EXPECTED
    assert follow_all(pegasus, grounds, tracks, 0.8).verdict.fell.tolist() == EXPECTED


def spoiled(track, **changes):
    return track._replace(**{name: change(getattr(track, name)) for name, change in changes.items()})


def test_what_cannot_be_computed_is_a_fall_and_leaves_no_log(pegasus, simulated, standing, tmp_path, monkeypatch):
    """Both engines, with feedback and without; MuJoCo writes its MUJOCO_LOG.TXT into the working folder."""
    monkeypatch.chdir(tmp_path)
    bad = [
        spoiled(standing, trunk_quat=np.zeros_like),
        spoiled(standing, joint_pos=lambda x: np.full_like(x, 1e30)),
        spoiled(standing, joint_torque=lambda x: np.where(np.arange(len(x))[:, None, None] > 4, np.nan, x)),
        standing,
    ]
    terrains, lanes = [LEVEL] * len(bad), len(EXPECTED)  # as many as above: the same program
    meters, followed = simulated(np.stack([LEVEL.elevation] * lanes), bad + [standing] * (lanes - len(bad)))
    assert meters.fell[1:].tolist() == [True, True] + [False] * (lanes - 3)
    assert followed.meters.fell.tolist() == [True, True, True] + [False] * (lanes - 3)
    assert np.isfinite(followed.meters.energy.joule).all()
    assert replay(pegasus, terrains, bad, 0.8).fell[1:].tolist() == [True, True, False]
    judged = follow_all(pegasus, terrains, bad, 0.8).verdict
    assert judged.fell.tolist() == [True, True, True, False]
    assert np.isfinite(judged.energy.joule).all()
    assert judged.time[-1] == pytest.approx(0.3, abs=0.004)
    assert os.listdir(tmp_path) == []


def random_turn(rng, tilt):
    """A rotation by any yaw whose z axis is tilted so far [rad]."""
    about = rng.uniform(0, 2 * np.pi)
    axis, yaw = np.array([np.cos(about), np.sin(about), 0.0]), rng.uniform(0, 2 * np.pi)
    skew = np.cross(np.eye(3), axis)
    leaned = np.eye(3) - np.sin(tilt) * skew + (1 - np.cos(tilt)) * skew @ skew
    turned = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return leaned @ turned


def depth_over_face(size, position, rotation, points):
    """How high the lower face is over ground points (n, 3), or -inf where it is not over them: numpy, face's plane."""
    down, normal = position - 0.5 * size[2] * rotation[:, 2], rotation[:, 2]
    z = down[2] - ((points[:, :2] - down[:2]) @ normal[:2]) / normal[2]
    local = (np.column_stack([points[:, :2], z]) - position) @ rotation
    over = np.all(np.abs(local[:, :2]) <= 0.5 * size[:2], axis=1)
    return np.where(over, z - points[:, 2], np.inf)


def test_no_column_under_the_box_is_missed_and_none_far_beside_it_counts(pegasus):
    """Random poses over random pillars against the plane of the lower face; what is only near may count either way."""
    rng, count, size = np.random.default_rng(0), 400, np.asarray(pegasus.trunk_size)
    cells = np.stack(np.meshgrid(X, Y, indexing="ij"), axis=-1).reshape(-1, 2)
    positions = np.column_stack([rng.uniform(-0.3, 0.3, count), rng.uniform(-0.2, 0.2, count), rng.uniform(0.3, 0.5, count)])
    turns = np.stack([random_turn(rng, tilt) for tilt in rng.uniform(0.0, 0.4, count)])
    grounds = np.where(rng.random((count, len(cells))) < 0.004, rng.uniform(0.0, 0.6, (count, len(cells))), 0.0)

    def look(elevation, position, rotation):
        trunk = fall.watch_trunk(
            pegasus, dataclasses.replace(LEVEL, elevation=elevation), State(jnp.zeros(19), jnp.zeros(18)), jnp.zeros((4, 3))
        )
        return fall.touches(trunk, position, rotation)

    seen = np.asarray(jax.jit(jax.vmap(look))(grounds.reshape(count, *LEVEL.elevation.shape), positions, turns))
    grown = size + 2.0 * np.array([0.14, 0.14, 0.0])
    inside, near = np.zeros(count, bool), np.zeros(count, bool)
    for i in range(count):
        points = np.column_stack([cells, grounds[i]])
        inside[i] = (depth_over_face(size, positions[i], turns[i], points) < 0.0).any()
        near[i] = (depth_over_face(grown, positions[i], turns[i], points) < 0.12).any()
    assert 50 < inside.sum() < near.sum() < count - 20
    assert seen[inside].all()
    assert not seen[~near].any()


@jax.jit
def judge(robot, state, feet):
    return fall.fallen(fall.watch_trunk(robot, LEVEL, state, feet), state, feet)


@pytest.mark.parametrize(("tilt", "falls"), [(0.0, False), (0.7, False), (0.9, True), (2.0, True), (np.pi, True)])
def test_a_trunk_on_its_side_or_back_has_fallen(pegasus, tilt, falls):
    """High over the ground, so that nothing but the tilt can say so."""
    q = np.zeros(19)
    q[2], q[3], q[4] = 2.0, np.cos(0.5 * tilt), np.sin(0.5 * tilt)
    state, feet = State(q, np.zeros(18)), np.zeros((4, 3))
    assert bool(judge(pegasus, state, feet)) == falls


def test_steps_that_mujoco_warned_of_are_unstable(pegasus, standing):
    """With `rollout`'s own record of them: after a warning time stands still. A robot that stands is stable."""
    model = build_model(pegasus, LEVEL, 0.8)
    starts = np.stack([start_state(model, x) for x in (standing, spoiled(standing, joint_pos=lambda x: np.full_like(x, 1e30)))])
    held = np.repeat(controls(pegasus, standing)[:1], 5, axis=0)
    with no_log():
        states, _ = rollout.rollout([model] * 2, [mujoco.MjData(model)], starts, np.stack([held] * 2))
    assert unstable(starts[:, 0], states).tolist() == [False, True]
    assert unstable(starts[:, 0], np.clip(states, -10.0, 10.0)).tolist() == [False, True]  # by the clock alone
    states[0, -1, 20] = np.nan
    assert unstable(starts[:, 0], states).all()
