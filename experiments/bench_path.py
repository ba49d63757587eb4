"""How fast are body paths planned? 1024 maps of 100 x 100 cells with all eight headings in one call, beside other planners.

Cost maps: smooth random ground, a part of the cost by heading, an eighth of the cells blocked. Ours gives the cost to go of
every cell, the path and its status. scipy's Dijkstra works on the same directed graph (built beforehand, not timed), from the
goal too; its costs must be ours. scikit-image's `route_through_array` and pyastar2d solve an easier problem, the mean over the
headings as one cost a cell, and stop at the goal. They take the maps one by one in one process, ours all cores.

The floor: 5 or 6 rounds of 12 moves a cell, an addition, a comparison and a choice each, are 2 million operations a map, 0.1 ms
of a core that does 8 at a time.

    python -m experiments.bench_path [--quick]
"""

import importlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import timed, write
from jaxleg.cli import configure_jax
from jaxleg.conventions import HEADINGS
from jaxleg.route.path import BodyPath, PathWeights, find_path
from jaxleg.status import Status
from jaxleg.terrain import Grid, rough

GRID = Grid(100, 100, 0.05, (0.0, 0.0))
START, GOAL, LONGEST = (1, 1), (98, 98), 600
MU_DISTANCE, MU_COST = 0.4, 0.6
STATUSES = (Status.OK, Status.NO_PATH, Status.START_BLOCKED, Status.GOAL_BLOCKED, Status.TOO_LONG)  # of a path
BLOCKED = 1.1  # standard deviations above the mean
BATCH = 4  # maps at once on a device: more do not stay in its cache
Route = Callable[[], float]  # cost of the way over a map: infinite without one, NaN where a planner does not tell


def main(out: Path | None = None, quick: bool = False) -> None:
    """Time all that are installed, compare the answers; `quick` takes 128 maps."""
    configure_jax()
    jax.config.update("jax_enable_compilation_cache", False)  # cold means compiled, whoever ran it before
    cost = maps(128 if quick else 1024)
    ours = time_ours(cost)
    few = np.arange(0, len(cost), len(cost) // (16 if quick else 64))
    found = jax.tree.map(lambda x: np.asarray(x)[few], ours["answer"])
    times = {"ours_warm": ours["warm"] / len(cost), "ours_cold": ours["cold"] / len(cost)}
    missing, agreement = [], {}
    for name, (module, prepare) in PEERS.items():
        try:
            route = prepare(importlib.import_module(module))
        except ImportError:
            missing.append(name)
            continue
        times[name], costs = time_peer(route, np.asarray(cost)[few])
        agreement[name] = compare(costs, found, same_problem=name == "scipy_dijkstra")
    report(times, agreement, missing)
    ratios = {name: seconds / times["ours_warm"] for name, seconds in times.items()}
    status = {s.name.lower(): int((np.asarray(ours["answer"].status) == s).sum()) for s in STATUSES}
    rows = {"maps": len(cost), "seconds_a_map": times, "times_ours_warm": ratios, "status": status}
    write("bench_path", out, rows | {"agreement": agreement, "missing": missing})


def maps(count: int) -> jax.Array:
    """Cost maps (count, heading, nx, ny): from 0.05 to about 1, infinite where blocked; the ends are open."""

    def make(key):
        ground, block, *turned = jax.random.split(key, 2 + len(HEADINGS))
        wave = lambda k, length: rough(GRID, k, 2.0, length).elevation  # noqa: E731
        by_heading = jnp.stack([wave(k, 0.4) for k in turned])
        cost = 0.05 + 0.95 * jax.nn.sigmoid(0.8 * wave(ground, 0.5) + 0.4 * by_heading)
        blocked = wave(block, 0.2) > BLOCKED
        for i, j in (START, GOAL):
            blocked = blocked.at[i - 1 : i + 2, j - 1 : j + 2].set(False)
        return jnp.where(blocked, jnp.inf, cost)

    return jax.jit(lambda keys: jax.lax.map(make, keys))(jax.random.split(jax.random.key(0), count))


def path(cost: jax.Array) -> BodyPath:
    """The path over one map."""
    weights = PathWeights(*(jnp.asarray(mu, cost.dtype) for mu in (MU_DISTANCE, MU_COST)))
    return find_path(cost, jnp.array(START), jnp.array(GOAL), weights, jnp.full(2, GRID.resolution, cost.dtype), LONGEST)


def time_ours(cost: jax.Array) -> dict[str, Any]:
    """Answers, and wall time of the first call (compiled in it) and of later ones; maps shared out over the devices."""
    devices = jax.sharding.Mesh(np.array(jax.local_devices()), ("lane",))
    along = jax.sharding.PartitionSpec("lane")
    cost = jax.block_until_ready(jax.device_put(cost, jax.sharding.NamedSharding(devices, along)))

    def share(lanes):
        return jax.lax.map(path, lanes, batch_size=BATCH)

    call = jax.jit(jax.shard_map(share, mesh=devices, in_specs=along, out_specs=along, check_vma=False))
    began = time.perf_counter()
    answer = jax.block_until_ready(call(cost))
    cold = time.perf_counter() - began
    return {"answer": answer, "cold": cold, "warm": timed(call, cost, repeats=5)}


def scipy_dijkstra(csgraph: Any) -> Callable[[np.ndarray], Route]:
    """Exact costs on the directed graph of (17)."""
    from scipy.sparse import csr_array

    cells = np.stack(np.meshgrid(range(GRID.nx), range(GRID.ny), indexing="ij"), axis=-1).reshape(-1, 2)

    def prepare(cost):
        rows = []
        for h, step in enumerate(np.array(HEADINGS)):
            onto = cells + step
            inside = np.all((onto >= 0) & (onto < (GRID.nx, GRID.ny)), axis=1)
            i, j = onto[inside].T
            way = GRID.resolution * np.hypot(*step)
            rows.append((i * GRID.ny + j, np.flatnonzero(inside), MU_DISTANCE * way + MU_COST * cost[h, i, j].astype(float)))
        there, here, price = (np.concatenate(x) for x in zip(*rows))
        open_ = np.isfinite(price)
        size = len(cells)
        graph = csr_array((price[open_], (there[open_], here[open_])), (size, size))
        number = GOAL[0] * GRID.ny + GOAL[1]
        return lambda: float(csgraph.dijkstra(graph, indices=number)[START[0] * GRID.ny + START[1]])

    return prepare


def scikit_image(graph: Any) -> Callable[[np.ndarray], Route]:
    """Moves cost the mean of both cells times the way; blocked cells are negative."""

    def prepare(cost):
        price = plain(cost)
        price = np.where(np.isfinite(price), price, -1.0)

        def route():
            try:
                return float(graph.route_through_array(price, START, GOAL, fully_connected=True, geometric=True)[1])
            except ValueError:  # its answer where there is no way
                return np.inf

        return route

    return prepare


def pyastar2d(module: Any) -> Callable[[np.ndarray], Route]:
    """A move costs the cell that is entered, at least 1; gives no cost."""

    def prepare(cost):
        price = plain(cost)
        price = (price / price.min()).astype(np.float32)
        return lambda: np.inf if module.astar_path(price, START, GOAL, allow_diagonal=True) is None else np.nan

    return prepare


def plain(cost: np.ndarray) -> np.ndarray:
    """One cost a cell: a straight move on the mean over the headings."""
    return MU_DISTANCE * GRID.resolution + MU_COST * cost.mean(axis=0).astype(float)


PEERS = {
    "scipy_dijkstra": ("scipy.sparse.csgraph", scipy_dijkstra),
    "scikit_image": ("skimage.graph", scikit_image),
    "pyastar2d": ("pyastar2d", pyastar2d),
}


def time_peer(prepare: Callable[[np.ndarray], Route], cost: np.ndarray) -> tuple[float, np.ndarray]:
    """Least mean seconds a map of three rounds, and the costs."""
    routes, rounds = [prepare(one) for one in cost], []
    for _ in range(3):
        began = time.perf_counter()
        costs = [route() for route in routes]
        rounds.append((time.perf_counter() - began) / len(cost))
    return min(rounds), np.array(costs)


def compare(costs: np.ndarray, found: BodyPath, same_problem: bool) -> dict[str, Any]:
    """Maps on which both find a way or neither does; on the same problem also the greatest relative difference of costs."""
    way = ~np.isinf(costs)
    agreement: dict[str, Any] = {"maps": len(costs), "same_way_or_none": int(np.sum(way == np.isfinite(found.cost)))}
    if same_problem:
        agreement["relative_difference"] = float(np.max(np.abs(found.cost[way] / costs[way] - 1.0)))
    return agreement


def report(times: dict[str, float], agreement: dict[str, dict[str, Any]], missing: list[str]) -> None:
    """Print the table."""
    print(f"{'planner':16s}{'ms a map':>10s}{'x ours':>8s}  the same answers")
    for name, seconds in times.items():
        told = ", ".join(f"{key} {value:.3g}" for key, value in agreement.get(name, {}).items())
        print(f"{name:16s}{1e3 * seconds:10.3f}{seconds / times['ours_warm']:8.2f}  {told}")
    if missing:
        print(f"not installed (uv sync --extra peers): {', '.join(missing)}")


if __name__ == "__main__":
    tyro.cli(main)
