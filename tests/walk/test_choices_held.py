"""With its choices held a walk moves with the planner's numbers: footholds by closed form, energy by differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import LEG_END, LEG_SIDE
from jaxleg.gait.nominal import LATER
from jaxleg.posture.collision import Sizes
from jaxleg.rotations import turned
from jaxleg.route.stations import Stations
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.terrain import Grid, rough
from jaxleg.terrain.footing import FootingRule
from jaxleg.walk.build import build_walk, chosen_footholds
from jaxleg.walk.choices import no_choice
from jaxleg.walk.config import Navigation
from jaxleg.walk.presets import paper_c
from jaxleg.walk.proxy import evaluate
from jaxleg.walk.site import site_of
from tests.crawls import gait

GRID = Grid(60, 60, 0.04, (-1.2, -1.2))
MOVED = (
    "gait.step_length",
    "gait.stance_width",
    "gait.foot_offset",
    "gait.workspace.high",
    "posture.levelling",
    "timing.acceleration",
)
SCALE = np.array([0.2, 0.4, 0.1, 0.5, 1.0, 1.0])
BEND = 0.15  # of the way, a half cycle [rad]


def stations_of(step):
    """On a curve to the left: the stance turns as it goes on, by half a step a half cycle."""
    yaw = BEND * jnp.arange(6.0)
    ahead = jnp.stack([jnp.full(6, 0.5 * step), jnp.zeros(6)], axis=1)
    return Stations(jnp.cumsum(jax.vmap(turned)(ahead, yaw), axis=0) - jnp.array([[0.3, 0.1]]), yaw, jnp.array(2, jnp.int32))


@pytest.fixture(scope="module")
def held(pegasus):
    """Paper C's planner, its site, and choices of one cycle with offsets and adjusted poses."""
    planner = paper_c(Navigation(), gait(0.44), 0.1, 0.03, GRID.resolution)
    site = jax.jit(
        lambda: site_of(FootingRule(), Sizes.of(pegasus), GRID.resolution, rough(GRID, jax.random.key(3), 0.03, 0.4))
    )()
    rng = np.random.default_rng(0)
    adjust = jnp.asarray(rng.integers(-1, 2, (4, 3)), jnp.int32)
    offset = jnp.asarray(rng.normal(0.0, 0.02, (2, 4, 2)))
    return planner, site, no_choice(1, offset.dtype)._replace(offset=offset, adjust=adjust)


def test_footholds_move_with_step_and_stance_as_the_parallelogram_does(held, pegasus):
    """A foot is half the stance's length and width, and the skew beyond half a step, from its station."""
    planner, site, choices = held

    @jax.jit
    @jax.jacobian
    def slopes(numbers):
        moved = dataclasses.replace(planner, gait=dataclasses.replace(planner.gait, **numbers))
        return chosen_footholds(moved, pegasus, site.terrain, stations_of(0.2), choices)[..., :2]

    names = ("step_length", "stance_length", "stance_width", "skew")
    found = slopes({name: getattr(planner.gait, name) for name in names})
    yaw = BEND * (2 * np.arange(2)[:, None] + LATER[None])
    ahead, left = np.stack([np.cos(yaw), np.sin(yaw)], -1), np.stack([-np.sin(yaw), np.cos(yaw)], -1)
    end, side = (np.array(sign)[None, :, None] for sign in (LEG_END, LEG_SIDE))
    by_hand = {
        "step_length": -0.25 * side * ahead,  # the stations are held here
        "stance_length": 0.5 * end * ahead,
        "stance_width": 0.5 * side * left,
        "skew": 0.5 * side * ahead,
    }
    for name in names:
        np.testing.assert_allclose(found[name], by_hand[name], atol=1e-12)


@pytest.mark.slow
def test_the_energy_of_a_curved_walk_has_a_true_gradient(held, pegasus):
    """Reverse mode against central differences and forward mode; every number moved has an effect."""
    planner, site, choices = held

    def energy(numbers):
        moved = with_leaves(planner, MOVED, numbers)
        seen = evaluate(pegasus, build_walk(moved, pegasus, site, stations_of(moved.gait.step_length), choices))
        total = jax.tree.map(jnp.sum, seen.energy)
        return (total.mechanical_positive + total.joule) / seen.distance

    at = read_leaves(planner, MOVED)
    value, slope = jax.jit(energy), np.asarray(jax.jit(jax.grad(energy))(at)) * SCALE
    step = 1e-5 * SCALE[:, None] * np.eye(len(MOVED))
    differences = np.array([(value(at + h) - value(at - h)) / 2e-5 for h in step])
    np.testing.assert_allclose(slope, differences, rtol=1e-4, atol=1e-5 * np.abs(differences).max())
    assert np.all(np.abs(slope) > 1e-4 * np.linalg.norm(slope))
