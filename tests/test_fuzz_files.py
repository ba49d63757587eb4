"""Hundreds of spoiled maps and plans: each is refused in one sentence or used, soon and in little memory."""

import collections
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.conventions import InputError
from jaxleg.sim.contact import Ground
from jaxleg.sim.follow import follow
from jaxleg.sim.legged import legged_engine
from jaxleg.terrain.features import FeatureSettings, traversability
from jaxleg.terrain.files import load_map
from jaxleg.terrain.heightmap import HeightMap, height
from jaxleg.walk.plan_check import LAYOUTS
from jaxleg.walk.plan_file import load_plan
from tests import spoiled
from tests.plans import EACH, SHIFT, arrays_of, save_standing

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # zipfile and numpy warn of what is refused anyway
SECONDS, BYTES = 5.0, 2**30
CELLS = (24, 20)
MEMORY = Path("/proc/self/clear_refs"), Path("/proc/self/status")


def memory(name: str) -> int:
    """Memory of this process [bytes]: now (VmRSS), or most since `measure` began (VmHWM)."""
    line = next(line for line in MEMORY[1].read_text().splitlines() if line.startswith(name))
    return 1024 * int(line.split()[1])


def measured(load, path):
    """What `load` returns or the sentence with which it refuses, within the limits of time and memory."""
    MEMORY[0].write_text("5")  # the greatest memory counts from here
    before, began = memory("VmRSS"), time.monotonic()
    try:
        result = load(path)
    except InputError as error:
        result = str(error)
        assert result.startswith(f"{path}: ")
        assert result.isprintable()
        assert len(result) < 400
    assert time.monotonic() - began < SECONDS
    assert memory("VmHWM") - before < BYTES
    return result


def tried(load, use, files, path) -> collections.Counter:
    """How many files are accepted and refused; what is accepted is used."""
    count = collections.Counter()
    for what, data in files:
        path.write_bytes(data)
        try:
            result = measured(load, path)
            refused = isinstance(result, str)
            count.update(["refused"] if refused else ["accepted", use(result)])
        except Exception as error:
            raise AssertionError(f"{what}: {error!r}") from error
    return count


def to_cells(elevation, cells):
    """A map of always the same size, so that one compilation serves: cut off, or going on level."""
    more = [(0, max(0, want - have)) for want, have in zip(cells, elevation.shape)]
    return jnp.asarray(np.pad(np.asarray(elevation)[: cells[0], : cells[1]], more, mode="edge"))


@jax.jit
def seen_by_a_planner(terrain: HeightMap):
    """Traversability, and heights along the diagonal."""
    last = terrain.resolution * (jnp.array(CELLS, float) - 1.0)
    points = terrain.origin[None] + jnp.linspace(0.0, 1.0, 16)[:, None] * last[None]
    return traversability(terrain, 0.04, FeatureSettings()), jax.vmap(height, in_axes=(None, 0))(terrain, points)


def use_map(file) -> str:
    terrain = HeightMap(to_cells(file.terrain.elevation, CELLS), file.terrain.origin, file.terrain.resolution)
    easy, heights = (np.asarray(x) for x in seen_by_a_planner(terrain))
    assert np.all(np.isnan(easy) | ((easy >= 0.0) & (easy <= 1.0)))
    assert not np.isinf(heights).any()
    assert np.isfinite(file.datum).all()
    if np.isfinite(terrain.elevation).all():
        assert np.isfinite(easy).all()
        assert np.isfinite(heights).all()
    return "used"


def test_spoiled_maps(tmp_path):
    with jax.enable_x64(False):
        count = tried(load_map, use_map, spoiled.maps(seed=0), tmp_path / "map.npz")
    print(dict(count))
    assert count["accepted"] + count["refused"] >= 300
    assert count["accepted"] >= 30


@pytest.fixture(scope="module")
def second():
    """One second of a plan in simulation; the robot is an argument, so that one compilation serves for all."""

    @jax.jit
    def run(robot, friction, terrain, reference, last, tick):
        ticks = jnp.round(1.0 / tick).astype(jnp.int32)
        return follow(legged_engine(robot), robot, Ground(friction=friction), terrain, reference, last, EACH, tick, ticks)

    return run


def test_spoiled_plans(tmp_path, pegasus, second):
    def use(file) -> str:
        rows = EACH + SHIFT + 1
        last = len(file.reference.time) - 1
        reference = jax.tree.map(lambda x: jnp.concatenate([x, *[x[-1:]] * (rows - len(x))])[:rows], file.reference)
        terrain = HeightMap(to_cells(file.terrain.elevation, (60, 50)), file.terrain.origin, file.terrain.resolution)
        numbers = (jnp.asarray(file.params[key], float) for key in ("friction", "tick"))
        friction, tick = numbers
        seen = second(file.robot, friction, terrain, reference, jnp.asarray(last), tick)
        finite = all(np.isfinite(x).all() for x in jax.tree.leaves(seen))
        assert finite or seen.meters.fell
        return "fell" if seen.meters.fell else "walked"

    with jax.enable_x64(False):
        robot = jax.tree.map(lambda x: jnp.asarray(x, float), pegasus)
        good = arrays_of(save_standing(tmp_path / "good.npz", robot))
        assert use(load_plan(tmp_path / "good.npz")) == "walked"
        count = tried(load_plan, use, spoiled.plans(0, good, list(LAYOUTS)), tmp_path / "plan.npz")
    print(dict(count))
    assert count["accepted"] + count["refused"] >= 300
    assert count["accepted"] >= 30
