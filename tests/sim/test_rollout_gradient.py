"""The gradient of a simulated walk is true: forward mode, reverse mode and central differences, on bumpy ground.

By default with a robot of massless links, whose terms are a few lines (and whose mass may be differentiated), by the slow test
with the search's own. Both engines' terms are differentiated for themselves, forwards and backwards: the walk is the same.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import GRAVITY
from jaxleg.leg.dynamics import all_leg_frames
from jaxleg.leg.energy import CONVENTIONS, electrical
from jaxleg.leg.kinematics import foot_jacobian
from jaxleg.numerics import cross, matmul, matvec
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import Terms, mjx_engine
from jaxleg.sim.legged import legged_engine
from jaxleg.sim.rollout import simulate
from jaxleg.terrain import HeightMap
from tests.motions import shift_and_step

SHAPE, STEP = (30, 24), 1e-6
ROBOT = ("stiffness", "velocity_gain", "joint_damping", "torque_constant", "trunk_mass", "contact_radius")
MATERIAL = tuple(f"ground_{name}" for name in Ground._fields)
TRACK = ("joint_pos", "joint_vel", "joint_torque")
INPUTS = (*ROBOT, *MATERIAL, *TRACK, "time", "elevation")
RNG = np.random.default_rng(0)
BUMPS, RAISED = 0.02 * RNG.normal(size=SHAPE), 0.01 * RNG.normal(size=SHAPE)
ALONG = {name: RNG.normal(size=(4, 3)) * scale for name, scale in zip(TRACK, (0.01, 0.1, 3.0))}


def massless_links(robot):
    """The engine of a robot whose mass is all in its trunk, its motors' rotors and nowhere else."""

    def terms(q, v):
        rotation, frames = rotation_from_quaternion(q[3:7]), all_leg_frames(robot, q[7:].reshape(4, 3))
        arm = robot.hip_position + frames.foot
        zero, none = jnp.zeros((3, 3)), jnp.zeros((4, 3))
        inertia = jnp.diag(robot.trunk_inertia)
        trunk = jnp.block([[robot.mass * jnp.eye(3), zero], [zero, inertia]])
        weight = robot.mass * GRAVITY * jnp.array([0.0, 0.0, 1.0])
        gyroscopic = cross(v[3:6], matvec(inertia, v[3:6]))
        x, y, z = arm[:, 0], arm[:, 1], arm[:, 2]
        turning = jnp.stack([none[:, 0], z, -y, -z, none[:, 0], x, y, -x, none[:, 0]], axis=-1).reshape(4, 3, 3)
        turn = jnp.broadcast_to(rotation, (4, 3, 3))
        by_trunk = jnp.concatenate([jnp.broadcast_to(jnp.eye(3), (4, 3, 3)), matmul(turn, turning)], axis=-1)
        by_leg = matmul(turn, jax.vmap(foot_jacobian)(frames))
        foot = q[:3][None] + matvec(turn, arm)
        legs = jax.vmap(jnp.diag)(robot.rotor_inertia)
        bias = jnp.concatenate([weight, gyroscopic])
        return Terms(trunk, jnp.zeros((4, 6, 3)), legs, bias, none, foot, by_trunk, by_leg, q[:3])

    return terms


def derivatives(make_engine, pegasus):
    """Outputs by inputs of 40 steps: forward mode, reverse mode, central differences."""
    # no foot starts on a grid line, where the surface's second derivative jumps
    terrain = HeightMap(jnp.asarray(BUMPS), jnp.array([-0.87, -0.71]), jnp.array(0.06))
    first = jax.jit(lambda track: jax.tree.map(lambda x: x[:5], track))
    track = first(shift_and_step(pegasus, terrain, (0.5, 0.5), (10, 16)))

    def walk(change):
        """Energies, distance and time after relative changes of numbers, and changes along the directions of arrays."""
        by = dict(zip(INPUTS, change))
        robot = dataclasses.replace(pegasus, **{name: getattr(pegasus, name) * (1.0 + by[name]) for name in ROBOT})
        ground = Ground(*(value * (1.0 + by[name]) for name, value in zip(MATERIAL, Ground())))
        moved = {name: getattr(track, name) + by[name] * ALONG[name][None] for name in TRACK}
        followed = track._replace(time=track.time * (1.0 + by["time"]), **moved)
        surface = dataclasses.replace(terrain, elevation=terrain.elevation + by["elevation"] * RAISED)
        meters = simulate(make_engine(robot), robot, ground, surface, followed, 10)
        energies = [jnp.sum(electrical(meters.energy, name)) for name in CONVENTIONS]
        return jnp.stack([*energies, meters.moved[0], meters.time])

    @jax.jit
    def all_three(at):
        ends = jnp.stack([jnp.eye(len(INPUTS)), -jnp.eye(len(INPUTS))]) * STEP
        high, low = jax.lax.map(jax.vmap(walk), ends)
        return jax.jacfwd(walk)(at), jax.jacrev(walk)(at), (high - low).T / (2.0 * STEP)

    return [np.asarray(x) for x in all_three(jnp.zeros(len(INPUTS)))]


@pytest.fixture(scope="module", params=["massless links", pytest.param("legged", marks=pytest.mark.slow)])
def found(request, pegasus):
    return derivatives({"massless links": massless_links, "legged": legged_engine}[request.param], pegasus)


def test_forward_mode_is_reverse_mode(found):
    forward, reverse, _ = found
    scale = np.abs(forward).max(axis=1, keepdims=True)
    np.testing.assert_allclose(reverse / scale, forward / scale, atol=1e-9)


@pytest.mark.parametrize("name", INPUTS)
def test_both_are_central_differences(found, name):
    forward, _, difference = (x[:, INPUTS.index(name)] for x in found)
    size = np.abs(found[0]).max(axis=1)
    np.testing.assert_allclose(forward / size, difference / size, rtol=1e-5, atol=1e-7)
    assert np.abs(forward[:4]).max() > 1e-4


@pytest.mark.parametrize("make", [legged_engine, pytest.param(mjx_engine, marks=pytest.mark.slow)])
def test_the_terms_have_true_derivatives(make, pegasus):
    """Along a direction in which the quaternion stays one; backwards the same product with any other vector."""
    rng, engine = np.random.default_rng(1), make(pegasus)
    q, v = rng.uniform(-1.0, 1.0, 19), rng.normal(size=18)
    q[3:7] /= np.linalg.norm(q[3:7])
    along = rng.normal(size=19), rng.normal(size=18)
    along[0][3:7] -= q[3:7] * (q[3:7] @ along[0][3:7])
    weight = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), jax.eval_shape(engine, q, v))

    @jax.jit
    def all_three(q, v):
        """The terms, their change, and the gradient of their weighted sum."""
        back = jax.vjp(engine, q, v)[1]
        return *jax.jvp(engine, (q, v), tuple(map(jnp.asarray, along))), back(weight)

    _, change, gradient = all_three(q, v)
    backwards = sum(np.sum(g * d) for g, d in zip(gradient, along))
    np.testing.assert_allclose(backwards, sum(np.sum(w * x) for w, x in zip(weight, change)), rtol=1e-9)
    low, high = (all_three(*(x + h * d for x, d in zip((q, v), along)))[0] for h in (-1e-5, 1e-5))
    for name, slope, a, b in zip(Terms._fields, change, low, high):
        np.testing.assert_allclose(slope, np.subtract(b, a) / 2e-5, rtol=1e-6, atol=1e-7, err_msg=name)
