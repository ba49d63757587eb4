"""Paper C, 4.2 (Fig. 9, 10): a straight walk over cuboids, and what looking ahead is good for.

Footholds in the order of their distance to the default one, cells at edges are no footholds. Fig. 9: two cycles at depth 2.
Fig. 10: with depth 1 the search takes steps after which none is left; how often that happens on 1,000 terrains at depths 1, 2
and 4, and how often the three pruning rules discard a solution that is there.

    python -m experiments.structured_terrain [--quick]
"""

import dataclasses
import functools
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Array, Bool, Int

from experiments.common import setup, write
from experiments.walk_maps import GAIT
from jaxleg.batch import layout, over_lanes, over_queue, shared_out
from jaxleg.foothold.contract import FootholdStatus
from jaxleg.route.path import BodyPath
from jaxleg.search.navigate import MOST, navigator_of
from jaxleg.series.tree import SearchStatus, advance, begin
from jaxleg.status import Status
from jaxleg.terrain import Grid, HeightMap, TerrainSettings, terrain
from jaxleg.terrain.site import Site
from jaxleg.viz.navigation import Look, draw_dead_end
from jaxleg.walk.choose import first_stance, step_nodes
from jaxleg.walk.feasible import Standing
from jaxleg.walk.navigation import Navigator

GRID = Grid(70, 36, 0.04, (0.02, 0.02))
START, CELLS = (16, 18), 36  # of a straight path along x: 1.4 m
TERRAINS, DIFFICULTY = 1000, (0.6, 1.0)
DEPTHS = (1, 2, 4)
STEPS, BUDGET = 64, 3000  # most steps of a walk, most candidates tried


def main(out: Path | None = None, quick: bool = False) -> None:
    """Count dead ends by depth; `quick` takes 32 terrains."""
    study, lab = setup()
    count = 32 if quick else TERRAINS
    base = navigator_of(study, lab.robot, GAIT, GRID.resolution)
    grounds = over_lanes(base.site, *layout(count, MOST))(maps(count))
    series = {f"depth {depth}": searched(base, grounds, depth) for depth in DEPTHS}
    series["depth 4, nothing pruned"] = searched(base, grounds, 4, prune=False)
    rows = {name: row(found) for name, found in series.items()}
    for name, r in rows.items():
        print(f"{name:26s}{r}")
    pruning = lost(series["depth 4"], series["depth 4, nothing pruned"])
    print(f"pruning: {pruning}")
    folder = out or Path("runs/structured_terrain")
    shown = picture(grounds, series["depth 1"], series["depth 4"], folder / "dead_end.png")
    write("structured_terrain", out, {"terrains": count, "rows": rows, "pruning": pruning, "shown": shown})


def maps(count: int) -> HeightMap:
    """Cuboids of rising difficulty."""

    @jax.jit
    @jax.vmap
    def make(seed, difficulty):
        return terrain("cuboids", GRID, jax.random.fold_in(jax.random.key(9), seed), difficulty, TerrainSettings())

    made = make(jnp.arange(count), jnp.linspace(*DIFFICULTY, count).astype(np.float32))
    return jax.tree.map(np.asarray, made)


class Outcome(NamedTuple):
    """How a series of gaits ended: `SearchStatus`, whether the first stance stood, states, steps, candidates tried."""

    status: Int[Array, ""]
    stood: Bool[Array, ""]
    states: Standing
    count: Int[Array, ""]
    visited: Int[Array, ""]


def without_cost(site: Site) -> Site:
    """A site that costs nothing anywhere: footholds are ordered by distance alone."""
    return site._replace(cost=jnp.zeros((4, 8, *site.valid.shape), site.terrain.origin.dtype))


def searched(base: Navigator, grounds: Site, depth: int, prune: bool = True) -> Outcome:
    """The series of gaits along the straight line on all terrains."""
    one = jnp.ones_like(base.planner.foothold.cost_weight)
    foothold = dataclasses.replace(base.planner.foothold, cost_weight=0.0 * one, distance_weight=one)
    series = dataclasses.replace(base.planner.series, prune=prune, depth=depth)
    path = dataclasses.replace(base.settings.path, cells=CELLS)
    navigator = dataclasses.replace(
        base,
        settings=dataclasses.replace(base.settings, path=path),
        planner=dataclasses.replace(base.planner, foothold=foothold, series=series),
    )
    share = -(-len(grounds.valid) // jax.local_device_count())
    return shared_out(functools.partial(_searched, navigator), share)(grounds)


def _searched(navigator: Navigator, grounds: Site) -> Outcome:
    """All terrains of a device through a queue: one that is thrashed through to the end does not keep the others waiting."""
    planner, robot = navigator.planner, navigator.robot

    def prepare(site: Site):
        line = navigator.line(site.terrain, straight(site.terrain))
        seen = planner.route.stations(planner.gait, line, STEPS // 2 + 3)
        root, found = first_stance(planner, robot, without_cost(site), seen)
        return seen, root, jnp.all(found.status != FootholdStatus.NONE)

    def nodes(item):
        return step_nodes(planner, robot, without_cost(item[0]), item[1])

    def start(item):
        series = begin(nodes(item), item[2], STEPS, planner.series.depth)
        return series._replace(status=jnp.where(item[3], series.status, SearchStatus.DEAD_END).astype(jnp.int32))

    def go(item, series):
        return advance(nodes(item), series, jnp.minimum(2 * item[1].count, STEPS), jnp.array(BUDGET, jnp.int32))

    seen, root, stood = jax.vmap(prepare)(grounds)
    done = over_queue(start, go, lambda s: s.status == SearchStatus.RUNNING, (grounds, seen, root, stood), 16)
    return Outcome(done.status, stood, done.states, done.step, done.visited)


def straight(height: HeightMap) -> BodyPath:
    """A path along x."""
    cells = jnp.stack([START[0] + jnp.arange(CELLS), jnp.full(CELLS, START[1])], axis=1)
    zero = jnp.zeros((), height.elevation.dtype)
    return BodyPath(cells, jnp.zeros(CELLS, jnp.int32), jnp.array(CELLS), zero, jnp.array(int(Status.OK), jnp.int32))


def row(found: Outcome) -> dict[str, Any]:
    """Outcomes by status among the terrains that have a first stance, and candidates tried."""
    status = found.status[found.stood]
    counts = {s.name.lower(): int((status == s).sum()) for s in SearchStatus if (status == s).any()}
    share = float((status == SearchStatus.FOUND).mean())
    return {"stood": len(status), **counts, "reached_share": share, "tried_mean": float(found.visited[found.stood].mean())}


def lost(pruned: Outcome, full: Outcome) -> dict[str, Any]:
    """Terrains that only the unpruned search crosses, the other way round, and the candidates that pruning spares."""
    ok = [w.stood & (w.status == SearchStatus.FOUND) for w in (pruned, full)]
    both = ok[0] & ok[1]
    same = np.array([np.allclose(a, b) for a, b in zip(pruned.states.feet[both], full.states.feet[both])])
    return {
        "crossed_only_unpruned": int((~ok[0] & ok[1]).sum()),
        "crossed_only_pruned": int((ok[0] & ~ok[1]).sum()),
        "crossed_by_both": int(both.sum()),
        "of_these_the_same_footholds": int(same.sum()),
        "tried_pruned_over_unpruned": float(pruned.visited[both].sum() / full.visited[both].sum()),
    }


def picture(grounds: Site, short: Outcome, long: Outcome, path: Path) -> int | None:
    """Draw the terrain where depth 1 gets stuck after most steps and depth 4 goes on."""
    stuck = short.stood & (short.status == SearchStatus.DEAD_END) & (long.status == SearchStatus.FOUND)
    if not stuck.any():
        return None
    i = int(np.argmax(np.where(stuck, short.count, -1)))
    looks = [
        Look(ahead, jax.tree.map(lambda x, w=w: np.asarray(x[i])[: int(w.count[i]) + 1], w.states), ahead == 1)
        for ahead, w in ((1, short), (4, long))
    ]
    draw_dead_end(jax.tree.map(lambda x: x[i], grounds.terrain), grounds.valid[i], *looks, path)
    return i


if __name__ == "__main__":
    tyro.cli(main)
