"""Which gear ratio reproduces the paper's flat-ground power? The one calibrated number of this project.

`traditional` on flat ground at 0.012 m/s under "net" power is to draw 35.4 W (paper A, Table I). The energy is that of the
plan's inverse dynamics, which simulation follows within about 1 %. The reflected rotor inertia changes with the gear.

    python -m experiments.calibrate_gear
"""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import tyro

from experiments.common import setup, training, write
from jaxleg.leg.energy import CONVENTIONS
from jaxleg.robot import Robot, RobotFile, build_robot
from jaxleg.search.contestants import baseline
from jaxleg.settings import load
from jaxleg.walk.choices import no_choice

POWER, SPEED = 35.4, 0.012  # [W], [m/s]
ROBOT = Path(__file__).parent.parent / "configs" / "robots" / "pegasus.toml"


def main(out: Path | None = None, quick: bool = False) -> float:
    """Bisect on the gear ratio; prints it. `quick` changes nothing, it takes seconds anyway."""
    del quick
    study, lab = setup()
    study = dataclasses.replace(study, speed=SPEED)
    lanes = jax.tree.map(jnp.asarray, training(study, lab, "flat").take(0))  # a constant of what is compiled
    vector = jnp.asarray(baseline(study, "flat", "traditional"), float)
    file = load(RobotFile, ROBOT)

    @jax.jit
    def power(robot: Robot) -> jax.Array:
        score = dataclasses.replace(lab, robot=robot).proxy(vector, lanes.site, no_choice(2, vector.dtype), lanes.setting)
        return score.energy[CONVENTIONS.index("net")] * SPEED

    low, high = 20.0, 100.0
    for _ in range(25):
        middle = 0.5 * (low + high)
        robot = build_robot(dataclasses.replace(file, motor=dataclasses.replace(file.motor, gear_ratio=middle)))
        low, high = (middle, high) if power(robot) > POWER else (low, middle)
    print(f"gear ratio {middle:.2f} draws {POWER} W at {SPEED} m/s; the robot's file has {file.motor.gear_ratio:g}")
    write("calibrate_gear", out, {"gear_ratio": middle, "power_w": POWER, "speed": SPEED})
    return middle


if __name__ == "__main__":
    tyro.cli(main)
