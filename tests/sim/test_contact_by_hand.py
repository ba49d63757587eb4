"""Contact of one foot against numbers worked out by hand: the spring, its damping, Coulomb and viscous friction, slopes."""

import jax
import numpy as np
import pytest

from jaxleg.sim.contact import Ground, foot_contact
from tests.motions import sloping

RADIUS, DT = 0.004, 0.0025
GROUND = Ground(stiffness=6e4, damping=1e3, softness=5e-4, friction=0.8, creep=3e-3)
SLOPE = (0.3, -0.2)
NORMAL = np.array([-0.3, 0.2, 1.0]) / np.sqrt(1.13)
touch = jax.jit(foot_contact)


def contact(depth, velocity=(0.0, 0.0, 0.0), slope=(0.0, 0.0), dt=DT, ground=GROUND):
    """Contact of a foot whose sphere is so deep in a plane, under the origin."""
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    centre = (RADIUS - depth) * normal
    return touch(ground, sloping(*slope), RADIUS, centre, np.asarray(velocity), dt)


def on_foot(seen, velocity):
    return np.asarray(seen.force) - np.asarray(seen.resistance) @ np.asarray(velocity)


@pytest.mark.parametrize(
    ("depth", "newton"),
    [(-0.01, 0.0), (0.0, 20.794415), (1e-3, 63.807840), (2e-3, 120.544498), (0.01, 600.0)],
)
def test_the_spring_sets_in_over_its_softness(depth, newton):
    """30 N log(1 + exp(depth / 0.5 mm)): at 0 a fifth of a foot's load, deep in 60 N a millimetre."""
    seen = contact(depth)
    np.testing.assert_allclose(seen.force, [0.0, 0.0, newton], atol=1e-6)
    np.testing.assert_allclose(seen.penetration, depth, atol=1e-12)


def test_a_slope_pushes_along_its_normal_by_the_depth_along_it():
    seen = contact(1e-3, slope=SLOPE)
    np.testing.assert_allclose(seen.penetration, 1e-3, atol=1e-12)
    np.testing.assert_allclose(seen.normal, NORMAL, atol=1e-12)
    np.testing.assert_allclose(seen.force, 63.807840 * NORMAL, rtol=1e-7)


@pytest.mark.parametrize("slope", [(0.0, 0.0), SLOPE])
@pytest.mark.parametrize(
    ("speed", "share"), [(3e-3, 1.0 / np.sqrt(2.0)), (4e-3, 0.8), (3e-5, 0.0099995), (0.3, 0.99995), (3.0, 1.0)]
)
def test_friction_opposes_sliding_and_is_coulombs_beyond_the_creep_speed(slope, speed, share):
    """At v_0 it is 71 % of mu N; far below it grows with the speed; its direction is the sliding's, in the ground's plane."""
    normal = NORMAL if slope == SLOPE else np.array([0.0, 0.0, 1.0])
    along = np.cross(normal, [0.6, 0.8, 0.0])
    along /= np.linalg.norm(along)
    seen = contact(1e-3, speed * along, slope)
    np.testing.assert_allclose(on_foot(seen, speed * along), 63.807840 * (normal - 0.8 * share * along), rtol=1e-6, atol=1e-6)


def test_a_part_of_the_velocity_along_the_normal_adds_nothing_to_the_sliding():
    along = np.cross(NORMAL, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(NORMAL, [1.0, 0.0, 0.0]))
    velocity = 3e-3 * along + 0.5 * NORMAL
    force = on_foot(contact(1e-3, velocity, SLOPE), velocity)
    np.testing.assert_allclose(force @ along, -0.8 * 63.807840 / np.sqrt(2.0), rtol=1e-6)


@pytest.mark.parametrize("dt", [0.0, 0.0025, 0.004])
def test_along_the_normal_there_is_the_damping_and_the_springs_change_over_the_step(dt):
    """Deep in: 1000 N s/m and dt times 60 N a millimetre; half of both at the surface; nothing in the air."""
    deep, surface, air = (contact(depth, slope=SLOPE, dt=dt) for depth in (0.01, 0.0, -0.01))
    whole = 1e3 + dt * 6e4
    np.testing.assert_allclose(on_foot(deep, -0.1 * NORMAL) - 600.0 * NORMAL, 0.1 * whole * NORMAL, rtol=1e-6)
    np.testing.assert_allclose(NORMAL @ np.asarray(surface.resistance) @ NORMAL, 0.5 * whole, rtol=1e-9)
    np.testing.assert_allclose(air.resistance, 0.0, atol=1e-4)


@pytest.mark.parametrize("name", Ground._fields)
def test_every_number_of_the_ground_counts(name):
    """Twice the number: the force changes as its formula says."""
    velocity = np.array([0.002, 0.0, -0.01])
    more = GROUND._replace(**{name: 2.0 * getattr(GROUND, name)})
    pressed = more.stiffness * more.softness * np.log(1.0 + np.exp(1e-3 / more.softness))
    push = pressed + 0.01 * (more.damping + DT * more.stiffness) / (1.0 + np.exp(-1e-3 / more.softness))
    drag = more.friction * pressed * 0.002 / np.hypot(0.002, more.creep)
    np.testing.assert_allclose(
        on_foot(contact(1e-3, velocity, ground=more), velocity), [-drag, 0.0, push], rtol=1e-9, atol=1e-9
    )
