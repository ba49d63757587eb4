"""The search of a free form: its gradients are true, and a descent on them finds what ten numbers cannot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.leg.energy import CONVENTIONS
from jaxleg.posture.collision import Sizes, robot_obstacles
from jaxleg.search import descent
from jaxleg.search.config import Kind, Study
from jaxleg.search.contestants import baseline, bounds, contestant
from jaxleg.search.free import free_lab
from jaxleg.search.lanes import settings_of
from jaxleg.search.run import make_lab
from jaxleg.search.training import Lanes
from jaxleg.terrain import Grid
from jaxleg.terrain.site import Site

pytestmark = pytest.mark.slow  # the proxy is compiled for more numbers than in test_search.py
GRID = Grid(112, 52, 0.02, (-0.9, -0.51))
STUDY = Study(kinds={"flat": Kind()})


@pytest.fixture(scope="module")
def lab(pegasus):
    return free_lab(make_lab(STUDY, pegasus), move=STUDY.search.move, chunk=1)


@pytest.fixture(scope="module")
def lanes(lab):
    """A plane that rises ahead, the paper's gait judged against its own energy, its margin to be kept; two lanes alike."""
    terrain = GRID.map(jnp.asarray(0.05 * GRID.resolution * np.arange(GRID.nx)[:, None] * np.ones((1, GRID.ny))))
    site = Site(terrain, np.ones((GRID.nx, GRID.ny), bool), robot_obstacles(Sizes.of(lab.robot), terrain, GRID.resolution))
    sites, setting = jax.tree.map(lambda x: np.stack([x] * 2), site), settings_of(contestant(STUDY, "flat", "paper"), 2)
    score, _ = lab.proxy_gradients(np.tile(start(lab), (2, 1)), sites, setting)
    energy = jnp.asarray(score.energy[:, CONVENTIONS.index(lab.convention)])
    return Lanes(sites, setting._replace(energy=energy, margin=jnp.asarray(score.checks.margin) - 0.002))


def start(lab):
    return np.concatenate([baseline(STUDY, "flat", "paper"), np.zeros(len(lab.bounds))])


def test_reverse_mode_is_the_difference(lab, lanes):
    """Along random directions of all numbers, from a form at random."""
    rng, span = np.random.default_rng(3), np.concatenate([bounds(STUDY, "flat", "best"), lab.bounds])
    width, step = span[:, 1] - span[:, 0], 1e-6
    at = start(lab) + 0.05 * width * rng.uniform(0.1, 1.0, len(width))
    _, gradient = lab.proxy_gradients(np.tile(at, (2, 1)), lanes.site, lanes.setting)
    for _ in range(4):
        way = width * rng.standard_normal(len(width))
        score, _ = lab.proxy_gradients(at + step * np.array([way, -way]), lanes.site, lanes.setting)
        difference = (score.objective[0] - score.objective[1]) / (2.0 * step)
        np.testing.assert_allclose(gradient[0] @ way, difference, rtol=1e-5)


def test_a_descent_saves_beyond_the_ten_numbers_and_keeps_to_the_constraints(lab, lanes):
    """Fifteen steps with the ten held: energy falls by a twentieth at least, margin and knee bend stay."""
    held = np.repeat(start(lab)[: len(lab.move), None], 2, axis=1)
    span = descent.ranges(np.concatenate([held, lab.bounds])[None])
    found, objective = descent.searched(lab, lanes, span, span.scaled(start(lab))[None], [(2, 1)], 15)
    score, _ = lab.proxy_gradients(np.repeat(found, 2, axis=0), lanes.site, lanes.setting)
    assert objective[0] < 0.95
    assert score.energy[0, CONVENTIONS.index(lab.convention)] < 0.95 * lanes.setting.energy[0]
    assert score.slack[0].min() > -0.002
    np.testing.assert_allclose(found[0, : len(lab.move)], held[:, 0])
