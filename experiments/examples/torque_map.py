"""Where does a standing leg need the least torque? Paper A, Fig. 4, with a gradient.

python -m experiments.examples.torque_map
"""

import jax
import jax.numpy as jnp
import tyro

import jaxleg as jl


def main(robot: str = "configs/robots/pegasus.toml", load: float = 86.2) -> None:
    """Print the best place of the foot under a load [N] on it, and how the knee's torque goes with the hip's height."""
    pegasus = jl.load_robot(robot)
    behind, height = jnp.linspace(-0.3, 0.3, 61), jnp.linspace(0.3, 0.5, 61)
    torque = jax.jit(jl.torque_map)(pegasus, behind, height, load)
    total = jnp.where(torque.reachable, abs(torque.thigh) + abs(torque.knee), jnp.inf)
    i, j = jnp.unravel_index(jnp.argmin(total), total.shape)
    print(f"least torque {total[i, j]:.1f} N m with the foot at {behind[i]:.2f} m, hip at {height[j]:.2f} m")
    slope = jax.grad(lambda h: jl.torque_map(pegasus, jnp.zeros(1), h[None], load).knee.sum())(jnp.asarray(0.5))
    print(f"the knee's torque changes by {slope:.0f} N m per metre of the hip's height at 0.5 m")


if __name__ == "__main__":
    tyro.cli(main)
