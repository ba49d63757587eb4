"""Your own objective: the numbers of a planner moved by gradient, whatever they are called.

python -m experiments.examples.own_objective
"""

import jax
import jax.numpy as jnp
import optax
import tyro

import jaxleg as jl
from experiments.examples.plan_a_walk import GRID, plan, planner

MOVED = ("gait.workspace.high", "gait.foot_offset", "gait.step_length")  # any of jl.leaf_names(planner)
RATE, LEAST_BEND, LEAST_MARGIN = 0.004, 0.35, 0.06  # [m] a step, [rad], [m]


def main(robot: str = "configs/robots/pegasus.toml", steps: int = 30) -> None:
    """Least energy per metre by the proxy, with a knee bend and a stability margin kept by penalties."""
    pegasus = jl.load_robot(robot)
    some, terrain = planner(pegasus), jl.flat(GRID)
    site = jl.site_of(jl.FootingRule(), jl.Sizes.of(pegasus), GRID.resolution, terrain)

    def objective(numbers: jax.Array, site: jl.Site) -> jax.Array:
        """Energy per metre over 500 J/m, and what the constraints lack."""
        _, walk = plan(pegasus, jl.with_leaves(some, MOVED, numbers), site)
        seen = jl.evaluate(pegasus, walk)
        lacks = jax.nn.relu(LEAST_BEND - seen.checks.knee_bend) + 5.0 * jax.nn.relu(LEAST_MARGIN - seen.checks.margin)
        return jl.electrical(jax.tree.map(jnp.sum, seen.energy), "positive") / seen.distance / 500.0 + 5.0 * lacks

    optimiser, numbers = optax.adam(RATE), jl.read_leaves(some, MOVED)
    state, slope = optimiser.init(numbers), jax.jit(jax.value_and_grad(objective))
    for step in range(steps + 1):
        value, gradient = slope(numbers, site)
        if step % 10 == 0:
            print(f"{step:3d}  {float(value):.3f}  " + "  ".join(f"{n} {x:.3f}" for n, x in zip(MOVED, numbers.tolist())))
        update, state = optimiser.update(gradient, state)
        numbers = optax.apply_updates(numbers, update)


if __name__ == "__main__":
    tyro.cli(main)
