"""One engine and one compiled walk by hand for all tests of the simulation."""

import jax
import numpy as np
import pytest

from jaxleg.sim.legged import legged_engine
from jaxleg.sim.step import step
from tests.motions import Mujoco


@pytest.fixture(scope="session")
def engine(pegasus):
    return legged_engine(pegasus)


@pytest.fixture(scope="session")
def bodies(pegasus):
    return Mujoco(pegasus)


@pytest.fixture(scope="session")
def roll(engine):
    """States and measurements after each step of a tracking, stepped without any rollout."""

    @jax.jit
    def run(robot, ground, terrain, state, tracking):
        def once(state, now):
            after, seen = step(engine, robot, ground, terrain, state, now)
            return after, (after, seen)

        return jax.lax.scan(once, state, tracking)[1]

    return lambda *numbers: jax.tree.map(np.asarray, run(*numbers))
