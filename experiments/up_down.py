"""The up-down experiment (paper A, Fig. 5): all feet under the hips, the body up and down; when is the current least?

The paper: nearly folded and nearly straight; greatest in between.

    python -m experiments.up_down [--quick]
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, write
from experiments.slow_walk import currents
from jaxleg.conventions import JOINTS, LEGS
from jaxleg.search.contestants import contestant
from jaxleg.sim.rollout import record
from jaxleg.terrain import Grid, flat
from jaxleg.viz.power import draw_up_down
from jaxleg.walk.reference import reference
from jaxleg.walk.standing import up_down

LOW, HIGH, SECONDS = 0.13, 0.585, 4.0  # hip height folded and (knee bend 25 deg) nearly straight [m], each way [s]
SAMPLES, STEPS = (100, 100), 12  # 3.3 ms a step
LEG = LEGS.index("RH")
ENDS = ("folded", "greatest", "straight")


def main(out: Path | None = None, quick: bool = False) -> None:
    """Simulate it; `quick` changes nothing, it takes seconds anyway."""
    del quick
    study, lab = setup()
    ground = flat(Grid(80, 40, 0.02, (-0.8, -0.4)))
    walk = up_down(lab.robot, contestant(study, "flat", "traditional").gait, ground, LOW, HIGH, SECONDS)
    engine = lab.engine

    @jax.jit
    def run():
        track = reference(lab.robot, walk, SAMPLES)
        return record(engine, lab.robot, lab.ground, ground, track, STEPS)

    meters, kept = run()
    height = np.asarray(kept.trunk_pos[:, 2] + jnp.mean(lab.robot.hip_position[:, 2]) - walk.footholds[0, LEG, 2])
    current = currents(lab.robot, kept)[:, LEG]
    rows = profile(height, current)
    middle = max(rows, key=lambda row: row["knee"])
    claim = rows[0]["knee"] < middle["knee"] > rows[-1]["knee"]
    for row in rows[:: max(1, len(rows) // 9)]:
        print(f"hip at {row['height']:.2f} m: " + ", ".join(f"{joint} {row[joint]:.2f} A" for joint in JOINTS))
    knee = {name: {"height": r["height"], "current": r["knee"]} for name, r in zip(ENDS, (rows[0], middle, rows[-1]))}
    print("knee: " + "; ".join(f"{name} {k['current']:.2f} A at {k['height']:.2f} m" for name, k in knee.items()))
    below = ", ".join(f"{100 * (1 - knee[name]['current'] / middle['knee']):.0f} % {name}" for name in ENDS[::2])
    verdict = f"{'yes' if claim else 'no'} (below the greatest: {below})"
    print(f"least nearly folded and nearly straight, greatest between: {verdict}; falls {int(meters.fell)}")
    paper = "least nearly folded and nearly straight"
    write("up_down", out, {"paper": paper, "ours": rows, "knee": knee, "claim_holds": bool(claim), "falls": int(meters.fell)})
    draw_up_down(np.asarray(kept.time), height, current, (out or Path("runs") / "up_down") / "up_down.png")


def profile(height: np.ndarray, current: np.ndarray) -> list[dict[str, float]]:
    """Mean current [A] of each joint by hip height, in centimetres."""
    bins = np.round(height * 100.0)
    names = ("height", *JOINTS)
    return [dict(zip(names, map(float, (b / 100.0, *current[bins == b].mean(axis=0))))) for b in np.unique(bins)]


if __name__ == "__main__":
    tyro.cli(main)
