"""Your own ground: a height map from an array, and your own kind of terrain for the commands.

python -m experiments.examples.own_terrain
"""

import jax
import jax.numpy as jnp
import numpy as np
import tyro

import jaxleg as jl
from experiments.examples.plan_a_walk import GRID, plan, planner


def ditches(grid: jl.Grid, key: jax.Array, difficulty: jax.Array, settings: jl.TerrainSettings) -> jl.HeightMap:
    """Ditches across the way, 10 cm wide, up to 20 cm deep: registered as a kind, `generator = "ditches"` finds it."""
    x = grid.origin[0] + grid.resolution * jnp.arange(grid.nx)
    first = jax.random.uniform(key, (), minval=0.0, maxval=0.3)
    inside = jnp.mod(x - first, 0.4) < 0.1
    return grid.map(jnp.broadcast_to(jnp.where(inside, -0.2 * difficulty, 0.0)[:, None], (grid.nx, grid.ny)))


def main(robot: str = "configs/robots/pegasus.toml", seed: int = 0) -> None:
    """Plan paper A's walk over the ditches and say where its feet are put."""
    jl.KINDS["ditches"] = ditches
    pegasus = jl.load_robot(robot)
    some, sizes = planner(pegasus), jl.Sizes.of(pegasus)

    @jax.jit
    def run(key):
        terrain = ditches(GRID, key, jnp.ones(()), jl.TerrainSettings())
        site = jl.site_of(jl.FootingRule(), sizes, GRID.resolution, terrain)
        return plan(pegasus, some, site)

    choices, walk = run(jax.random.key(seed))
    for stance, how in zip(np.asarray(walk.footholds), np.asarray(choices.found)):
        print("  ".join(f"{x:6.2f} {y:5.2f} {z:5.2f}" for x, y, z in stance), how)


if __name__ == "__main__":
    tyro.cli(main)
