import os
from pathlib import Path

import jax
import pytest

from jaxleg.robot import load_robot

jax.config.update("jax_enable_x64", True)
_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxleg"
jax.config.update("jax_compilation_cache_dir", os.environ.get("JAXLEG_CACHE") or str(_CACHE))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


@pytest.fixture(scope="session")
def pegasus():
    return load_robot(Path(__file__).parents[1] / "configs/robots/pegasus.toml")
