"""What the commands share: usage, exit statuses, and how JAX is configured."""

import contextlib
import os
from pathlib import Path

from jaxleg.conventions import InputError

USAGE = """usage: jaxleg COMMAND ...

  search CONFIG   search planner parameters over many terrains, verify them in simulation on held-out ones
      --out FOLDER    where the run goes (default: runs/NAME-OF-CONFIG)
      --resume        go on with the run in FOLDER

  plan CONFIG --terrain FILE_OR_KIND --start X Y --goal X Y
                  plan a walk over one map: body path, footholds, postures, swings (CONFIG: as for search, or its best.toml)
      --out FILE      the plan (default: runs/plan.npz)
      --figure FILE   a picture of it
      --gait NAME     whose gait of CONFIG's kinds to walk with (default: the kind of the terrain, or the first)
      --difficulty D  of a terrain made by KIND, in [0, 1] (default: 0.5)

  replay PLAN     simulate a plan: energy, cost of transport, slip, stability margin, falls
      --engine mjx or mujoco
      --out FILE      the result (default: replay.json beside the plan)
      --video FILE    a GIF of it

  --seed N        random seed; like any other key of CONFIG, e.g. --search.steps 20, --navigation.tree.depth 2
  --help          all keys of CONFIG with their limits: jaxleg search CONFIG --help
"""
HELP = {"-h", "--help"}
SOONER = "--xla_cpu_use_fusion_emitters=false"  # ours compile sooner and run no slower; JAX 0.11 no longer knows it
EXIT_INFEASIBLE, EXIT_INPUT, EXIT_INTERRUPTED, EXIT_PIPE = 1, 2, 130, 141


def configure_jax() -> None:
    """Persistent compilation cache, exact matrix products, a device a core; called once, before anything is compiled.

    Raises `InputError` where JAX finds no device of the platform asked for.
    """
    import jax

    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    compile_sooner()
    os.environ["MPLBACKEND"] = "agg"  # figures are files; a notebook's back end may not even be installed here
    if cache := cache_folder():
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_default_matmul_precision", "highest")
    if "JAX_NUM_CPU_DEVICES" not in os.environ:
        jax.config.update("jax_num_cpu_devices", os.cpu_count() or 1)  # see batch.py
    try:
        jax.local_devices()
    except RuntimeError as error:
        raise InputError(f"JAX_PLATFORMS is {os.environ.get('JAX_PLATFORMS', '')!r}: {first_line(error)}") from error


def compile_sooner() -> None:
    """Have XLA take the way that compiles soonest, where it knows two; before JAX looks for devices."""
    import jax

    known = os.environ.get("XLA_FLAGS", "")
    if jax.__version_info__ < (0, 11) and SOONER not in known:
        os.environ["XLA_FLAGS"] = f"{known} {SOONER}".strip()


def cache_folder() -> Path | None:
    """Where compiled programs are kept: as the environment names it, else in the user's cache; None where nobody may write."""
    try:
        users = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxleg"
    except RuntimeError:  # a user without a home
        users = None
    named = os.environ.get("JAXLEG_CACHE") or os.environ.get("JAX_COMPILATION_CACHE_DIR") or users
    with contextlib.suppress(OSError):
        if named:
            Path(named).mkdir(parents=True, exist_ok=True)
            return Path(named) if os.access(named, os.W_OK) else None
    return None


def first_line(error: Exception) -> str:
    """What an error says first."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
