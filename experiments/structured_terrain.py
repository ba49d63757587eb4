"""Paper C, IV.B (Fig. 9, 10): a straight walk over cuboids, and what looking ahead is good for.

Footholds in the order of their distance to the default one, cells at edges are no footholds. Fig. 9: two cycles at depth 2.
Fig. 10: with depth 1 the search takes steps after which none is left; how often that happens on 1,000 terrains at depths 1, 2
and 4, and how often the three pruning rules discard a solution that is there.

    python -m experiments.structured_terrain [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, write
from experiments.walk_maps import GAIT
from jaxleg.planning.gaits import Scene
from jaxleg.planning.navigation import NavigationStatus, Navigator, Walked
from jaxleg.planning.path import BodyPath, PathStatus
from jaxleg.search.batches import over_lanes
from jaxleg.search.navigate import CHUNK, navigator_of
from jaxleg.terrain import Grid, HeightMap, TerrainSettings, terrain
from jaxleg.viz.navigation import Look, draw_dead_end

GRID = Grid(70, 36, 0.04, (0.02, 0.02))
START, CELLS = (16, 18), 36  # of a straight path along x: 1.4 m
TERRAINS, DIFFICULTY = 1000, (0.6, 1.0)
DEPTHS = (1, 2, 4)


def main(out: Path | None = None, quick: bool = False) -> None:
    """Count dead ends by depth; `quick` takes 32 terrains."""
    study, lab = setup()
    count = 32 if quick else TERRAINS
    base = navigator_of(study, lab.robot, GAIT, GRID.resolution)
    scenes = over_lanes(lambda ground: scene(base, ground), CHUNK)(maps(count))
    series = {f"depth {depth}": searched(base, scenes, depth) for depth in DEPTHS}
    series["depth 4, nothing pruned"] = searched(base, scenes, 4, prune=False)
    rows = {name: row(walked) for name, walked in series.items()}
    for name, r in rows.items():
        print(f"{name:26s}{r}")
    pruning = lost(series["depth 4"], series["depth 4, nothing pruned"])
    print(f"pruning: {pruning}")
    folder = out or Path("runs/structured_terrain")
    shown = picture(scenes, series["depth 1"], series["depth 4"], folder / "dead_end.png")
    write("structured_terrain", out, {"terrains": count, "rows": rows, "pruning": pruning, "shown": shown})


def maps(count: int) -> HeightMap:
    """Cuboids of rising difficulty."""

    @jax.jit
    @jax.vmap
    def make(seed, difficulty):
        return terrain("cuboids", GRID, jax.random.fold_in(jax.random.key(9), seed), difficulty, TerrainSettings())

    made = make(jnp.arange(count), jnp.linspace(*DIFFICULTY, count).astype(np.float32))
    return jax.tree.map(np.asarray, made)


def scene(navigator: Navigator, ground: HeightMap) -> Scene:
    """The ground without costs: footholds are ordered by distance alone."""
    none = jnp.zeros((4, 8, *ground.elevation.shape), ground.elevation.dtype)
    return Scene(ground, navigator.valid(ground), none, navigator.obstacles(ground))


def searched(base: Navigator, scenes: Scene, depth: int, prune: bool = True) -> Walked:
    """The series of gaits along the straight line on all terrains."""
    tree = dataclasses.replace(base.settings.tree, depth=depth, budget=20000)
    path = dataclasses.replace(base.settings.path, cells=CELLS, steps=64)
    one = jnp.ones_like(base.gait.cost_weight)
    gait = dataclasses.replace(base.gait, prune=prune, cost_weight=0.0 * one, distance_weight=one)
    navigator = dataclasses.replace(base, gait=gait, settings=dataclasses.replace(base.settings, tree=tree, path=path))
    return over_lanes(lambda s: navigator.along(s, straight(s.terrain)), CHUNK)(scenes)


def straight(ground: HeightMap) -> BodyPath:
    """A path along x."""
    cells = jnp.stack([START[0] + jnp.arange(CELLS), jnp.full(CELLS, START[1])], axis=1)
    zero = jnp.zeros((), ground.elevation.dtype)
    return BodyPath(cells, jnp.zeros(CELLS, jnp.int32), jnp.array(CELLS), zero, jnp.array(int(PathStatus.OK), jnp.int32))


def row(walked: Walked) -> dict[str, Any]:
    """Outcomes by status, and candidates tried."""
    stood = walked.status != NavigationStatus.NO_STANCE
    counts = {s.name.lower(): int((walked.status == s).sum()) for s in NavigationStatus if (walked.status == s).any()}
    share = float((walked.status[stood] == NavigationStatus.OK).mean())
    return counts | {"reached_share": share, "tried_mean": float(walked.visited[stood].mean())}


def lost(pruned: Walked, full: Walked) -> dict[str, Any]:
    """Terrains that only the unpruned search crosses, the other way round, and the candidates that pruning spares."""
    ok = [w.status == NavigationStatus.OK for w in (pruned, full)]
    both = ok[0] & ok[1]
    same = np.array([np.allclose(a, b) for a, b in zip(pruned.states.feet[both], full.states.feet[both])])
    return {
        "crossed_only_unpruned": int((~ok[0] & ok[1]).sum()),
        "crossed_only_pruned": int((ok[0] & ~ok[1]).sum()),
        "crossed_by_both": int(both.sum()),
        "of_these_the_same_footholds": int(same.sum()),
        "tried_pruned_over_unpruned": float(pruned.visited[both].sum() / full.visited[both].sum()),
    }


def picture(scenes: Scene, short: Walked, long: Walked, path: Path) -> int | None:
    """Draw the first terrain where depth 1 gets stuck after some steps and depth 4 goes on."""
    stuck = (short.status == NavigationStatus.DEAD_END) & (long.status == NavigationStatus.OK) & (short.count >= 4)
    if not stuck.any():
        return None
    i = int(np.flatnonzero(stuck)[0])
    looks = [
        Look(ahead, jax.tree.map(lambda x, w=w: np.asarray(x[i])[: int(w.count[i]) + 1], w.states), ahead == 1)
        for ahead, w in ((1, short), (4, long))
    ]
    ground = jax.tree.map(lambda x: x[i], scenes.terrain)
    draw_dead_end(ground, scenes.valid[i], *looks, path)
    return i


if __name__ == "__main__":
    tyro.cli(main)
