"""Every heavy program can be lowered for an accelerator, and calls no library there: for tiny matrices one would be slow."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export

from jaxleg.search.config import Gait, Kind, Search, Study, Terrains, Workspace
from jaxleg.search.contestants import searched_planner
from jaxleg.search.lanes import settings_of
from jaxleg.search.leaves import read_leaves
from jaxleg.search.model import linearised
from jaxleg.search.navigate import navigator_of
from jaxleg.search.run import make_lab
from jaxleg.search.sites import make_sites
from jaxleg.terrain import Grid, TerrainSettings, terrain

STUDY = Study(kinds={"rough": Kind("rough")}, terrains=Terrains(train=2, held_out=2, cells=(64, 40)), search=Search(starts=1))
GRID = Grid(60, 50, 0.04, (0.02, 0.02))
pytestmark = pytest.mark.slow  # all that is traced for this is traced elsewhere, for CPUs


def lowered(lane, *arguments):
    """The program of two lanes for CUDA, as text."""
    traced = export.export(jax.jit(jax.vmap(lane)), platforms=["cuda"])(*arguments)
    assert traced.platforms == ("cuda",)
    return traced.mlir_module()


@pytest.fixture(scope="module")
def lanes(pegasus):
    """A lab, and two lanes of it."""
    lab, site = make_lab(STUDY, pegasus), make_sites(STUDY, pegasus, "rough", held_out=False)
    planner = searched_planner(STUDY, "rough")
    vectors = np.tile(read_leaves(planner, STUDY.search.move), (2, 1))
    return lab, (vectors, site, settings_of(planner, 2))


@pytest.mark.parametrize("name", ["proxy", "proxy's gradient", "model", "plan", "simulation", "simulation's gradient"])
def test_the_searchs_programs(lanes, name):
    lab, arguments = lanes

    def proxy(x, site, setting):
        return lab.proxy(x, site, lab.choose(x, site, setting), setting).objective

    def simulated(x, site, setting):
        return lab.simulated(x, site, lab.choose(x, site, setting), setting)[0]

    def model(x, site, setting):
        choice = lab.choose(x, site, setting)
        return linearised(lambda y: lab.parts(y, site, choice, setting), x, 0.1 * jnp.ones_like(x), lab.rows)

    def plan(x, site, setting):
        return lab.plan(x, site, lab.choose(x, site, setting), setting)

    programs = {"proxy": proxy, "model": model, "plan": plan, "simulation": simulated}
    programs |= {"proxy's gradient": jax.grad(proxy), "simulation's gradient": jax.grad(simulated)}
    assert "custom_call" not in lowered(programs[name], *arguments)


def test_a_library_would_be_seen():
    assert "custom_call" in lowered(jnp.linalg.cholesky, np.tile(np.eye(3), (2, 1, 1)))


def test_the_navigators_programs(pegasus):
    navigator = navigator_of(STUDY, pegasus, Gait(workspace=Workspace(high=0.46)), GRID.resolution)
    maps = jax.vmap(lambda key: terrain("cuboids", GRID, key, 0.5, TerrainSettings()))(jax.random.split(jax.random.key(3), 2))
    surveys = jax.eval_shape(jax.vmap(navigator.survey), maps)
    some = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), surveys)
    ends = np.ones((2, 2)), 2.0 * np.ones((2, 2)), np.zeros((2, GRID.nx, GRID.ny), bool)
    assert "custom_call" not in lowered(navigator.survey, maps)
    assert "custom_call" not in lowered(lambda *x: navigator.planned(navigator.walk(*x)), some, *ends)
