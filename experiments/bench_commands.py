"""How long do the README's commands take? Each with cold caches, and once more with warm ones.

A cold run has a compilation cache of its own that is empty. CPU seconds beside wall time say how busy the machine was with it.
`jaxleg plan` goes a few metres over fractal ground on maps of two sizes: its peak memory grows with them.

    python -m experiments.bench_commands [--quick] [--parts search]     the parts named, added to the result that is there
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
import tyro

from experiments.common import CONFIG, write
from jaxleg.terrain import Grid, TerrainSettings, terrain
from jaxleg.terrain.files import MapFile, save_map

ROOT = Path(__file__).parent.parent
SHORT = ["tests/leg/test_energy.py"]  # with `quick`
Part = Literal["pytest", "search", "plan_500", "plan_1000"]
SIZES, CELL, START, GOAL = (500, 1000), 0.04, ("1", "1"), ("4", "1.5")  # cells along a side of the maps to plan on; [m]


def main(out: Path | None = None, quick: bool = False, parts: tuple[Part, ...] = ()) -> bool:
    """Time `pytest`, `jaxleg search` and `jaxleg plan`, or `parts` of these; returns whether all end well. `quick`: one test
    file."""
    file = (out or Path("runs/bench_commands")) / "result.json"
    known = json.loads(file.read_text()) if parts and file.exists() else {}
    with tempfile.TemporaryDirectory() as folder:
        commands = {"pytest": ["-m", "pytest", *(SHORT if quick else [])]}
        if not quick:
            commands["search"] = ["-m", "jaxleg.cli", "search", str(CONFIG), "--out", "RUN"]
            commands |= {f"plan_{cells}": plan_on(cells, Path(folder)) for cells in SIZES}
        result = {name: both(commands[name], Path(folder) / name) for name in parts or commands}
    write("bench_commands", out, known | result)
    return all(row["status"] == 0 for runs in result.values() for row in runs.values())


def plan_on(cells: int, folder: Path) -> list[str]:
    """The command that plans a walk on a map of so many cells along each side."""
    path = folder / f"{cells}.npz"
    ground = terrain("fractal", Grid(cells, cells, CELL, (0.0, 0.0)), jax.random.key(0), np.float32(0.2), TerrainSettings())
    save_map(MapFile(ground, np.zeros(3)), path)
    where = ["--terrain", str(path), "--start", *START, "--goal", *GOAL, "--out", "RUN.npz"]
    return ["-m", "jaxleg.cli", "plan", str(CONFIG), *where]


def both(command: list[str], cache: Path) -> dict[str, dict[str, Any]]:
    """A command's cold and its warm run."""
    rows = {}
    for state in ("cold", "warm"):
        row = rows[state] = timed([x.replace("RUN", f"{cache}-{state}") for x in command], cache)
        print(
            f"{cache.name:10s}{state:6s}{row['wall_s']:8.0f} s wall {row['cpu_s']:8.0f} s CPU {row['peak_gib']:6.2f} GiB"
            f"  status {row['status']}",
            flush=True,
        )
    return rows


def timed(command: list[str], cache: Path) -> dict[str, Any]:
    """Wall and CPU seconds of a Python command with a compilation cache, the peak memory of its processes, and its status."""
    environment, began = os.environ | {"JAXLEG_CACHE": str(cache), "JAX_PLATFORMS": "cpu"}, time.perf_counter()
    process = subprocess.Popen([sys.executable, *command], cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)  # waited for already
    row = {"wall_s": time.perf_counter() - began, "cpu_s": used.ru_utime + used.ru_stime, "peak_gib": used.ru_maxrss / 2**20}
    return row | {"status": process.returncode}


if __name__ == "__main__":
    sys.exit(0 if tyro.cli(main) else 1)
