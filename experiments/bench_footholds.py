"""How fast are footholds planned? Candidate cells a second: 4096 terrains x 12 footholds in one call, 0.02 m cells.

Search rectangle 0.3 x 0.08 m (15 x 5 cells) on maps of 80 x 32 cells, half of them stairs, half rough ground, 2 % of the cells
unseen. Foot disc, stance test, legs' reach and all runs of the cascade included; only the cells of the first run are counted.
Map features (traversability) are timed in and out. Beside it the same algorithm in plain NumPy, terrain by terrain, in the same
run, with the same answers.

    python -m experiments.bench_footholds [--quick]
"""

import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import timed, write
from experiments.plain_footholds import plain_features, plain_plan, plain_valid
from jaxleg.cli import configure_jax
from jaxleg.foothold.cascade import Reachable, choose_stance
from jaxleg.foothold.contract import Footholds, FootholdStatus
from jaxleg.foothold.rectangle import SearchRectangle, extent_of
from jaxleg.terrain import Grid, HeightMap, TerrainSettings, terrain_batch, valid_cells
from jaxleg.terrain.features import FeatureSettings, traversability

RESOLUTION, FOOT, STEP, LEAST = 0.02, 0.02, 0.2, 0.7
GRID = Grid(80, 32, RESOLUTION, (-0.6, -0.31))
STANCE = np.array([[0.34, 0.18], [0.24, -0.18], [-0.26, 0.18], [-0.36, -0.18]])
NOMINAL = STANCE + STEP * np.arange(3)[:, None, None] * np.array([1.0, 0.0])  # 12 footholds
LIMITS = (-0.3, 0.24, STEP)  # heights and distance that a leg reaches
EXTENT = extent_of(0.38, 0.08, STEP, RESOLUTION)
CELLS = 15 * 5 * NOMINAL.shape[0] * 4  # candidates a terrain in the first run
BATCH = 64  # terrains at once on a device
PUBLISHED = 4.5e5  # cells a second, the best CPU figure we know


def main(out: Path | None = None, quick: bool = False) -> None:
    """Time both, compare their answers; `quick` takes 512 terrains."""
    configure_jax()
    count = 512 if quick else 4096
    elevation = maps(count)
    easy = timed_batch(easy_cells, elevation)
    plan = timed_batch(planned, elevation, easy["answer"])
    few = slice(0, count, count // 64)
    plain = plain_rates(np.asarray(elevation)[few], np.asarray(easy["answer"])[few])
    agree = np.array_equal(np.asarray(plan["answer"].status)[few], plain["status"]) and np.allclose(
        np.asarray(plan["answer"].offset)[few], plain["offset"], atol=1e-6
    )
    status = {s.name.lower(): int((np.asarray(plan["answer"].status) == s).sum()) for s in FootholdStatus}
    seconds = {"features_out": plan["seconds"], "features_in": plan["seconds"] + easy["seconds"]}
    rates = {name: CELLS * count / wall for name, wall in seconds.items()}
    ratios = {name: plain[name] * count / wall for name, wall in seconds.items()}
    for name in rates:
        print(f"{name:13s}{count} terrains in {1e3 * seconds[name]:7.1f} ms: {rates[name]:.3g} candidate cells/s,", end=" ")
        print(f"x{ratios[name]:.0f} plain NumPy ({1e3 * plain[name]:.2f} ms a terrain)")
    print(f"statuses {status}; NumPy's answers {'are the same' if agree else 'DIFFER'}")
    rows = {"terrains": count, "cells_per_second": rates, "times_numpy": ratios, "published_cells_per_second": PUBLISHED}
    write("bench_footholds", out, rows | {"status": status, "same_answers": agree})


def maps(count: int) -> jax.Array:
    """Elevations (count, nx, ny) [m]: stairs and rough ground of rising difficulty, 2 % of the cells unseen."""

    def make(key):
        ramp = jnp.linspace(0.2, 1.0, count // 2)
        kinds = [terrain_batch(kind, GRID, key, 0, ramp, TerrainSettings()).elevation for kind in ("stairs", "rough")]
        every = jnp.concatenate(kinds)
        return jnp.where(jax.random.uniform(key, every.shape) < 0.02, jnp.nan, every)

    return jax.jit(make)(jax.random.key(0))


def easy_cells(elevation: jax.Array) -> jax.Array:
    """Traversability of one map, against the threshold."""
    return traversability(GRID.map(elevation), RESOLUTION, FeatureSettings()) >= LEAST


def planned(elevation: jax.Array, easy: jax.Array) -> Footholds:
    """Twelve footholds on one map: valid cells (foot disc), then the cascade."""
    terrain: HeightMap = GRID.map(elevation)
    valid = valid_cells(terrain, RESOLUTION, FOOT, easy=easy)
    rectangle = SearchRectangle(*(jnp.asarray(x, float) for x in (0.30, 0.08, 0.08, 0.5, 0.0)))
    reachable = Reachable(*map(jnp.asarray, LIMITS))
    stances = jax.vmap(choose_stance, in_axes=(0, None, None, None, None, None))
    return stances(jnp.asarray(NOMINAL, float), valid, terrain, rectangle, reachable, EXTENT)


def timed_batch(lane: Any, *batched: Any) -> dict[str, Any]:
    """Answer and least wall time of one compiled call over all maps, shared out over the devices."""
    devices = jax.sharding.Mesh(np.array(jax.local_devices()), ("lane",))
    along = jax.sharding.PartitionSpec("lane")
    batched = jax.device_put(batched, jax.sharding.NamedSharding(devices, along))

    def share(*lanes):
        return jax.lax.map(lambda x: lane(*x), lanes, batch_size=BATCH)

    call = jax.jit(jax.shard_map(share, mesh=devices, in_specs=along, out_specs=along, check_vma=False))
    answer = jax.block_until_ready(call(*batched))
    return {"answer": answer, "seconds": timed(call, *batched, repeats=5)}


def plain_rates(elevation: np.ndarray, easy: np.ndarray) -> dict[str, Any]:
    """Seconds a terrain of plain NumPy, with and without the features, and its answers."""
    began = time.perf_counter()
    answers = [plain_plan(NOMINAL, z, plain_valid(z, RESOLUTION, FOOT, e), GRID, LIMITS) for z, e in zip(elevation, easy)]
    middle = time.perf_counter()
    for z in elevation:
        plain_features(z, RESOLUTION)
    out, features = (middle - began) / len(elevation), (time.perf_counter() - middle) / len(elevation)
    offset, status = (np.stack(x) for x in zip(*answers))
    return {"features_out": out, "features_in": out + features, "offset": offset, "status": status}


if __name__ == "__main__":
    tyro.cli(main)
