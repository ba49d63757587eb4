"""A plan file in simulation, and a film of it: what `jaxleg plan` wrote, in ten lines.

jaxleg plan configs/quickstart.toml --terrain fractal --start 1 1 --goal 2.5 1.2 --out runs/plan.npz
python -m experiments.examples.replay_and_film runs/plan.npz
"""

from pathlib import Path

import tyro

from jaxleg.sim.replay import replay_mjx
from jaxleg.viz.animation import animate
from jaxleg.walk.plan_file import load_plan

FRAME = 0.5  # [s]


def main(plan: tyro.conf.Positional[Path], film: Path = Path("runs/walk.gif")) -> None:
    """Follow the plan in MJX with feedback on the trunk's place, print its figures, write a GIF."""
    file = load_plan(plan)
    result, frames = replay_mjx(file, FRAME)
    print({name: value for name, value in result.items() if not isinstance(value, dict)})
    animate(film, file.terrain, frames, file.robot, FRAME, speed=4.0, goal=file.goal)
    print(f"written: {film}")


if __name__ == "__main__":
    tyro.cli(main)
