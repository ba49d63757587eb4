"""How does the energy of a simulated walk change with the gait? Reverse mode through two cycles of contact.

python -m experiments.examples.gradient_through_simulation
"""

import dataclasses

import jax
import jax.numpy as jnp
import tyro

import jaxleg as jl
from experiments.examples.plan_a_walk import GRID, plan, planner

SAMPLES, STEPS = (60, 50), 3  # of the reference a shift and a swing, simulation steps between them


def main(robot: str = "configs/robots/pegasus.toml") -> None:
    """Print energy per metre in simulation and its gradient by the gait's numbers, the footholds' choice held."""
    pegasus = jl.load_robot(robot)
    some, engine = planner(pegasus), jl.legged_engine(pegasus)
    site = jl.site_of(jl.FootingRule(), jl.Sizes.of(pegasus), GRID.resolution, jl.flat(GRID))
    choices = jax.jit(lambda site: plan(pegasus, some, site)[0])(site)

    def energy(gait: jl.GaitParams, site: jl.Site, choices: jl.Choices) -> jax.Array:
        """Electrical energy per metre [J/m], braking lost."""
        moved = dataclasses.replace(some, gait=gait)
        stations = moved.route.stations(gait, None, 6)
        walk = jl.build_walk(moved, pegasus, site, stations, choices)
        meters = jl.simulate(engine, pegasus, jl.Ground(), site.terrain, jl.reference(pegasus, walk, SAMPLES), STEPS)
        return jl.electrical(jax.tree.map(jnp.sum, meters.energy), "positive") / meters.moved[0]

    value, slope = jax.jit(jax.value_and_grad(energy))(some.gait, site, choices)
    print(f"{float(value):.0f} J/m")
    for field in dataclasses.fields(slope):
        print(f"  by {field.name:15s}{float(getattr(slope, field.name)):9.1f}")


if __name__ == "__main__":
    tyro.cli(main)
