"""One compiled planner for all tests of walks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.crawls import crawl, in_numpy, settings, terrain_of


@pytest.fixture(scope="session")
def walk_on(pegasus):
    none = np.zeros((3, 4, 2)), np.zeros((3, 4), np.int32)

    @jax.jit
    def plan(robot, params, options, terrain):
        return crawl(robot, params, options, terrain, *map(jnp.asarray, none))

    def walk(params, kind="flat", bend=20.0, **cog):
        return in_numpy(plan(pegasus, params, settings(bend, **cog), terrain_of(kind)))

    return walk
