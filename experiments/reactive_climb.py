"""Stairs and rough ground with a map that is 3 cm wrong: a swing leg that feels its way against one that follows the clock.

Both follow the same walks, planned on the wrong map: beyond the first stance the ground of every terrain is believed 3 cm too
high in one walk, 3 cm too low in another. The reactive leg feels forces through its joint torques (paper B, reading B18),
stops at a contact, searches where it finds none (paper B's machine), and the trunk follows the feet. Falls, touch-down impulse
(normal force over the first 50 ms of contact), and what was felt beside the true contact.

    python -m experiments.reactive_climb [--quick]
"""

import dataclasses
import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.blind_swing import interval
from experiments.common import setup, write
from experiments.felt_walks import DT, react
from experiments.stairs import unseen
from jaxleg.batch import over_lanes
from jaxleg.control.swing_leg import feeling
from jaxleg.gait.nominal import nominal_stances
from jaxleg.gait.order import SHIFT, SWING_LEG
from jaxleg.planner import Planner
from jaxleg.posture.collision import Sizes
from jaxleg.search.config import Study
from jaxleg.search.contestants import contestant
from jaxleg.search.lanes import CYCLES, Lab, stations
from jaxleg.search.sites import footing_rule
from jaxleg.sim.reactive import Tick
from jaxleg.swing.machine import Mode
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.terrain.site import Site
from jaxleg.walk.build import build_walk
from jaxleg.walk.choose import choose
from jaxleg.walk.data import Walk
from jaxleg.walk.site import site_of

RUNS, ERROR = 64, 0.03
WINDOW = 0.05  # of the touch-down impulse [s]
TOUCH = 5.0  # true normal force that counts as contact [N]
SPARE = 1.8  # time given to a walk over its plan's


CONTESTANTS: dict[str, dict[str, Any]] = {  # what the leg is told; `error` 0 walks with the right map
    "clocked": {"reacts": False},
    "reactive": {},
    "reactive, feels weight only": {"inertia": 0.0},
    "reactive, sees nothing": {"sees": False},
    "clocked, right map": {"reacts": False, "error": 0.0},
    "reactive, right map": {"error": 0.0},
}


KINDS = {"stairs": tuple(CONTESTANTS), "rough": ("clocked", "reactive", "reactive, sees nothing")}


def main(out: Path | None = None, quick: bool = False) -> None:
    """Climb with all; `quick` takes 8 walks a kind."""
    study, lab = setup()
    count, kinds, climbers = 8 if quick else RUNS, {}, Climbers(study, lab)
    for kind, names in KINDS.items():
        rows = {}
        for name in names:
            rows[name] = climbers.walk(kind, count, **CONTESTANTS[name])
            show(kind, name, rows[name])
        saved = saving(rows["clocked"], rows["reactive"])
        for which, r in saved.items():
            span = f"{r['mean']:.2f} N s {np.round(r['ci95'], 2)}"
            print(f"touch-down impulse, clocked less reactive, {which}: {span} over {r['n']} walks")
        kinds[kind] = {
            "rows": {n: {k: v for k, v in r.items() if k != "lanes"} for n, r in rows.items()},
            "impulse_saved": saved,
        }
    write("reactive_climb", out, {"kinds": kinds, "map_error_m": ERROR})


class Climbers:
    """All rows' walks: planned by one compiled program and walked by another, whoever climbs."""

    def __init__(self, study: Study, lab: Lab) -> None:
        self.study, self.lab = study, lab
        self.planners = {kind: contestant(study, kind, "traditional") for kind in KINDS}
        span = max(float(planner.gait.step_length / planner.timing.speed) for planner in self.planners.values())
        self.walks = over_lanes(functools.partial(_planned, lab), lab.chunk)
        self.run = react(lab, round(SPARE * CYCLES * span / DT), lab.chunk * jax.local_device_count())

    def walk(self, kind: str, count: int, error: float = ERROR, **told: Any) -> dict[str, Any]:
        """One contestant's row on a kind of terrain: every terrain with a map that is too high and with one too low."""
        lanes, planner = unseen(self.study, self.lab, kind, count // 2), self.planners[kind]
        lanes, signs = lanes.take(np.repeat(np.arange(lanes.number), 2)), np.tile([1.0, -1.0], lanes.number)
        believed = wrong_maps(self.study, self.lab, lanes.site.terrain, planner, error * signs)
        walks = self.walks(jax.tree.map(lambda x: np.tile(x, (lanes.number, *[1] * np.ndim(x))), planner), believed)
        return row(self.run(feeling(self.lab.robot, **told), lanes.site.terrain, walks))


def _planned(lab: Lab, planner: Planner, believed: Site) -> Walk:
    way = stations(planner, CYCLES)
    choices, _ = choose(planner, lab.robot, believed, way, 4 * CYCLES)
    return build_walk(planner, lab.robot, believed, way, choices)


def saving(clocked: dict[str, Any], reactive: dict[str, Any]) -> dict[str, Any]:
    """Paired difference of the mean touch-down impulse: all walks, and those that the clocked leg made to the end."""
    difference = clocked["lanes"]["impulse"] - reactive["lanes"]["impulse"]
    both = clocked["lanes"]["alive"] & reactive["lanes"]["alive"]
    parts = {"all": difference, "those that both walked": difference[both]}
    return {name: interval(d) | {"n": len(d)} for name, d in parts.items() if len(d) > 1}


def wrong_maps(study: Study, lab: Lab, terrain: HeightMap, planner: Planner, offsets: np.ndarray) -> Site:
    """Maps raised or lowered beyond the first stance, and where they let a foot be placed."""
    sizes = Sizes.of(lab.robot)
    first, _ = nominal_stances(planner.gait, stations(planner, 0), 1)
    front = float(first[0, :, 0].max()) + 0.06

    @jax.jit
    @jax.vmap
    def wrong(true: HeightMap, offset):
        x = true.origin[0] + true.resolution * jnp.arange(true.elevation.shape[0])
        error = jnp.where(x > front, offset, 0.0)[:, None].astype(true.elevation.dtype)
        believed = dataclasses.replace(true, elevation=true.elevation + error)
        return site_of(footing_rule(study.terrains), sizes, study.terrains.resolution, believed)

    return wrong(terrain, jnp.asarray(offsets))


def row(tick: Tick) -> dict[str, Any]:
    """Falls, touch-downs, and how well contacts were felt."""
    downs = [touch_downs(Tick(*(x[k, tick.alive[k]] for x in tick))) for k in range(len(tick.alive))]
    impulse = np.array([np.mean([d["impulse"] for d in lane]) for lane in downs])
    every = [d for lane in downs for d in lane]
    late = [d["late"] for d in every if d["late"] is not None]
    return {
        "walks": len(downs),
        "falls": int(np.sum(~tick.alive[:, -1])),
        "unfinished": int(np.sum(~tick.done[:, -1])),
        "touch_downs": len(every),
        "impulse_ns": float(impulse.mean()),
        "lanes": {"impulse": impulse, "alive": tick.alive[:, -1]},
        "peak_n": float(np.mean([d["peak"] for d in every])),
        "adjustments": float(np.mean([d["adjustments"] for d in every])),
        "returned": int(sum(d["exit"] == Mode.RETURNED for d in every)),
        "contacts_felt": int(tick.contact.sum()),
        "of_these_false": int(np.sum(tick.contact & (swinging_force(tick) < TOUCH))),
        "felt_late_ms": float(1e3 * np.mean(late)) if late else np.nan,
    }


def swinging_force(tick: Tick) -> np.ndarray:
    """True normal force on the leg that swings (lane, t) [N]."""
    leg = np.maximum(np.array(SWING_LEG * CYCLES + (0,))[np.minimum(tick.phase, len(SWING_LEG) * CYCLES)], 0)
    return np.take_along_axis(tick.normal_force, leg[..., None], axis=-1)[..., 0]


def touch_downs(tick: Tick) -> list[dict[str, Any]]:
    """Each swing's first true contact after it has been in the air: its impulse, its peak, and when it was felt."""
    legs, found, window = np.array(SWING_LEG * CYCLES), [], round(WINDOW / DT)
    for phase in np.flatnonzero(legs != SHIFT):
        at = np.flatnonzero(tick.phase == phase)
        if not len(at):
            continue
        after = np.arange(at[0], min(at[-1] + 2 * window, len(tick.phase)))
        force, mode = tick.normal_force[after, legs[phase]], tick.mode[after]
        air = np.flatnonzero((force < 0.1) & (mode >= 0))
        touch = np.flatnonzero((force > TOUCH) & (np.arange(len(after)) > (air[0] if len(air) else len(after))))
        if not len(touch):
            continue
        first = touch[0]
        stopped = np.flatnonzero(tick.contact[after] & (np.arange(len(after)) >= first))
        late = (stopped[0] - first) * DT if len(stopped) else None
        found.append(
            {
                "impulse": float(force[first : first + window].sum() * DT),
                "peak": float(force[first : first + window].max()),
                "adjustments": int(tick.adjustments[at].max()),
                "exit": int(mode[mode >= 0][-1]),
                "late": late,
            }
        )
    return found


def show(kind: str, name: str, r: dict[str, Any]) -> None:
    """One line."""
    felt = f"{r['contacts_felt']} contacts felt ({r['of_these_false']} false) {r['felt_late_ms']:.1f} ms late"
    print(
        f"{kind:7s}{name:28s} falls {r['falls']}, {r['touch_downs']} touch-downs, impulse {r['impulse_ns']:.2f} N s, "
        f"peak {r['peak_n']:.0f} N, adjustments {r['adjustments']:.2f}, returned {r['returned']}, {felt}"
    )


if __name__ == "__main__":
    tyro.cli(main)
