"""One plan of a file in simulation, by MJX or by the referee: the same figures, and pictures of the walk.

Figures are plain floats, NaN where there is nothing to tell. Energy per metre and cost of transport are told of a way of a
foot's diameter at least: a map cannot tell shorter ones apart, and a robot that stands would have any.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxleg.gait.order import STEP_LEGS
from jaxleg.leg.energy import CONVENTIONS, Power, cost_of_transport, electrical
from jaxleg.sim.contact import Ground
from jaxleg.sim.engine import mjx_engine
from jaxleg.sim.follow import film, landing_errors
from jaxleg.sim.referee_feedback import follow_all
from jaxleg.walk.plan_file import PlanFile

Frames = Float[np.ndarray, "frame 19"]


def replay_mjx(file: PlanFile, frame: float) -> tuple[dict[str, Any], Frames]:
    """Follow a plan in MJX; the configuration every `frame` [s]."""
    engine, ground = mjx_engine(file.robot), Ground(friction=file.params["friction"])
    tick, last = jnp.asarray(file.params["tick"], float), jnp.asarray(len(file.reference.time) - 1)
    each = max(round(frame / float(tick)), 1)
    count = int(np.ceil(float(file.reference.time[-1]) / (each * float(tick)))) + 2

    @jax.jit
    def run(robot, terrain, reference):
        seen, shots = film(engine, robot, ground, terrain, reference, last, file.samples, tick, (count, each))
        return seen, shots, landing_errors(reference, seen, file.samples, STEP_LEGS)

    seen, shots, landing = jax.tree.map(np.asarray, run(file.robot, file.terrain, file.reference))
    meters, end = seen.meters, shots[-1, :2]
    energy = Power(*(jnp.asarray(np.sum(x)) for x in meters.energy))
    made = min(int(file.params["steps"]), int(seen.reached) // file.samples)
    result = {
        "engine": "mjx",
        **_figures(file, energy, _way(end, file), meters.time, meters.margin, np.mean(meters.slip)),
        "fell": bool(meters.fell),
        "finished": bool(seen.finished),
        "left": float(np.linalg.norm(end - file.goal)),
        "landing_worst": float(np.max(landing[:made])) if made else float("nan"),
        "penetration": float(meters.penetration),
    }
    return result, shots


def replay_mujoco(file: PlanFile, frame: float) -> tuple[dict[str, Any], Frames]:
    """Follow a plan in C MuJoCo."""
    seen = follow_all(file.robot, [file.terrain], [file.reference], file.params["friction"], frame)
    verdict = jax.tree.map(lambda x: x[0], seen.verdict)
    energy = Power(*(jnp.asarray(x) for x in verdict.energy))
    result = {
        "engine": "mujoco",
        **_figures(file, energy, _way(seen.trunk[0], file), verdict.time, verdict.margin, verdict.slip),
        "fell": bool(verdict.fell),
        "finished": bool(seen.over[0]) and not verdict.fell,
        "left": float(np.linalg.norm(seen.trunk[0, :2] - file.goal)),
    }
    return result, seen.shots[0]


def _way(end, file: PlanFile) -> float:
    """Horizontal distance from where the walk began [m]."""
    return float(np.linalg.norm(np.asarray(end)[:2] - np.asarray(file.reference.trunk_pos)[0, :2]))


def _figures(file: PlanFile, energy: Power, way, time, margin, slip) -> dict[str, Any]:
    """Energy per metre as the crow flies from start to end, and the rest."""
    power, far = file.params["power"], way >= 2.0 * float(file.robot.foot_radius)
    per_metre = {name: float(electrical(energy, name)) / way if far else float("nan") for name in CONVENTIONS}
    return {
        "energy_per_metre": per_metre,
        "power": power,
        "cost_of_transport": float(cost_of_transport(per_metre[power], file.robot.mass)),
        "distance": way,
        "time": float(time),
        "margin": float(margin) if np.isfinite(margin) else float("nan"),
        "slip": float(slip),
    }
