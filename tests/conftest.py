import gc
import os
from pathlib import Path

import jax
import pytest

from jaxleg.cli.start import compile_sooner
from jaxleg.robot import load_robot

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")  # our own code says what it broadcasts and casts ...
jax.config.update("jax_numpy_dtype_promotion", "strict")  # ... others' runs in `numerics.foreign`
if "JAX_NUM_CPU_DEVICES" not in os.environ:
    jax.config.update("jax_num_cpu_devices", 2)  # as the command line does on two cores; see batch.py
_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxleg"
jax.config.update("jax_compilation_cache_dir", os.environ.get("JAXLEG_CACHE") or str(_CACHE))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_disable_most_optimizations", True)  # most programs of the tests run for less time than they compile
compile_sooner()
gc.freeze()  # tracing makes many small objects that stay; looking through them again and again takes a seventh of the time
gc.set_threshold(200_000, 20, 20)


@pytest.fixture(scope="session")
def pegasus():
    return load_robot(Path(__file__).parents[1] / "configs/robots/pegasus.toml")


@pytest.fixture(scope="module")
def optimised():
    """Programs of these tests run for longer than they compile."""
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", True)


LONGEST = ("test_search.py", "test_navigate.py", "test_reactive.py", "test_rollout_gradient.py")


def pytest_collection_modifyitems(items):
    """Files that compile longest go first, so that all workers end at about the same time."""
    items.sort(key=lambda item: item.path.name not in LONGEST)
