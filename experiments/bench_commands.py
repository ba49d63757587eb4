"""How long do the README's two commands take? Each with cold caches, and once more with warm ones.

A cold run has a compilation cache of its own that is empty. CPU seconds beside wall time say how busy the machine was with it.

    python -m experiments.bench_commands [--quick]
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import tyro

from experiments.common import CONFIG, write

ROOT = Path(__file__).parent.parent
SHORT = ["tests/test_energy.py", "tests/test_gait.py"]  # with `quick`


def main(out: Path | None = None, quick: bool = False) -> bool:
    """Time `jaxleg search` and `pytest`; returns whether both end well. `quick`: two test files alone."""
    with tempfile.TemporaryDirectory() as folder:
        commands = {"pytest": ["-m", "pytest", *(SHORT if quick else [])]}
        if not quick:
            commands["search"] = ["-m", "jaxleg.cli", "search", str(CONFIG), "--out", "RUN"]
        result = {name: both(command, Path(folder) / name) for name, command in commands.items()}
    write("bench_commands", out, result)
    return all(row["status"] == 0 for runs in result.values() for row in runs.values())


def both(command: list[str], cache: Path) -> dict[str, dict[str, Any]]:
    """A command's cold and its warm run."""
    rows = {}
    for state in ("cold", "warm"):
        row = rows[state] = timed([x.replace("RUN", f"{cache}-{state}") for x in command], cache)
        print(
            f"{cache.name:8s}{state:6s}{row['wall_s']:8.0f} s wall {row['cpu_s']:8.0f} s CPU  status {row['status']}",
            flush=True,
        )
    return rows


def timed(command: list[str], cache: Path) -> dict[str, Any]:
    """Wall and CPU seconds of a Python command with a compilation cache, and its exit status."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = os.environ | {"JAXLEG_CACHE": str(cache), "JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, *command], cwd=ROOT, env=environment, capture_output=True, check=False)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": wall, "cpu_s": used, "status": done.returncode}


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
