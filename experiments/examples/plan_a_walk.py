"""Paper A's planner on rough ground: footholds, walk, energy.

python -m experiments.examples.plan_a_walk
"""

import jax
import jax.numpy as jnp
import numpy as np
import tyro

import jaxleg as jl

GRID = jl.Grid(112, 52, 0.02, (-0.9, -0.51))  # cells along x and y, their size [m], the first one's centre
SPACE = dict(behind=-0.20, ahead=0.0, low=0.48, high=0.52)
GAIT = dict(foot_offset=-0.10, skew=0.10, step_length=0.20, stance_length=0.60, stance_width=0.36)
FLIGHT = dict(swing_height=0.08, shift_share=0.45, hind_share=0.5, lift_share=0.05)


def planner(robot: jl.Robot, speed: float = 0.05, least_bend: float = 20.0) -> jl.Planner:
    """The paper's own numbers at a speed [m/s] and a least knee bend [deg]."""
    space, others = (jax.tree.map(jnp.asarray, numbers) for numbers in (SPACE, GAIT | FLIGHT))
    gait = jl.GaitParams(workspace=jl.Workspace(**space), **others)
    rectangle = jl.SearchRectangle(*map(jnp.asarray, (0.30, 0.08, 0.08, 0.5, 0.0)))
    extent = jl.extent_of(0.38, 0.08, resort=0.2, resolution=GRID.resolution)
    return jl.paper_a(gait, rectangle, extent, jl.CogRule(jnp.asarray(0.5)), speed, np.deg2rad(least_bend))


def plan(robot: jl.Robot, some: jl.Planner, site: jl.Site, cycles: int = 2):
    """The choices of a walk of so many cycles, and the walk."""
    stations = some.route.stations(some.gait, None, 2 * cycles + 2)
    choices, _ = jl.choose(some, robot, site, stations, 4 * cycles)
    return choices, jl.build_walk(some, robot, site, stations, choices)


def main(robot: str = "configs/robots/pegasus.toml", seed: int = 0) -> None:
    """Plan two cycles and say what they cost and whether every step can be made."""
    pegasus = jl.load_robot(robot)
    some, sizes = planner(pegasus), jl.Sizes.of(pegasus)

    @jax.jit
    def run(terrain):
        site = jl.site_of(jl.FootingRule(), sizes, GRID.resolution, terrain)
        _, walk = plan(pegasus, some, site)
        return walk, jl.evaluate(pegasus, walk), jl.check_steps(some, pegasus, site.obstacles, walk)

    walk, seen, steps = run(jl.rough(GRID, jax.random.key(seed), 0.05, 0.25))
    energy = jl.electrical(jax.tree.map(jnp.sum, seen.energy), "positive") / seen.distance
    print(f"{int(walk.count)} steps, {float(walk.way):.2f} m in {float(seen.time):.1f} s: {float(energy):.0f} J/m")
    print(f"least margin {float(seen.checks.margin):.3f} m, knee bend {np.rad2deg(float(seen.checks.knee_bend)):.0f} deg")
    print("steps:", ", ".join(jl.Status(int(status)).name for status in steps))


if __name__ == "__main__":
    tyro.cli(main)
