"""The lander's walk over a course of 300 (paper B, IV.B, Fig. 10): feeling its way alone, and with a map that is wrong.

Readings where the paper leaves gaps (B16, B17). The leg's map is that of the tables, 7.5 high with the foot at 3, and one of
its units is 2.5 of the course: a step of 8 is 20, so that feet 60 apart still reach with a level body on a slope of 10 deg.
The course is flat, a slope of 10 deg from 60 to 120, flat, a step of 5 at 180, flat; the robot is told 5 deg and 3, and
knows where its foot stands. Legs 1 LF, 2 RF, 3 RH, 4 LH swing in the order 1, 3, 2, 4, each to its place under a body that
has moved on by a step, which keeps 50 over the mean of its feet. The course is the same for both sides, so that another
direction changes nothing; after a return the leg tries a shorter step (6, 4, 2), then the body rises by 1, at most 3 times.
Swings that come back are flown in vain: their way counts.

    python -m experiments.lander_walk [--quick]
"""

import functools
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import write
from jaxleg.cli import configure_jax
from jaxleg.swing.blind import blind_swing
from jaxleg.swing.informed import informed_swing
from jaxleg.swing.localmap import LocalMap, sampled
from jaxleg.swing.machine import Machine, Mode, Step, extended, printed
from jaxleg.swing.planner import RoutePlanner, cautious, shortest
from jaxleg.swing.profile import Profile, height, hermite
from jaxleg.swing.trace import Trace, blind_trace, informed_trace
from jaxleg.viz.swing import draw_course

UNIT = 2.5  # of the course to one of the leg's map; all below is in units of the map
LENGTH, STRIDE, HALF, SPACING = 300.0 / UNIT, 8.0, 30.0 / UNIT, 0.1
SLOPE_FROM, SLOPE_TO, STEP_AT = 60.0 / UNIT, 120.0 / UNIT, 180.0 / UNIT
BELOW, ABOVE = 3.0, 4.5  # of the map, from the mean of the feet
COURSES = {  # slope [deg] and step, true and told
    "paper's": ((10.0, 5.0), (5.0, 3.0)),
    "told right": ((10.0, 5.0), (10.0, 5.0)),
    "step of 12": ((10.0, 12.0), (5.0, 3.0)),  # the legs only reach it with the body raised
}
LEGS = {"1 LF": HALF, "3 RH": -HALF, "2 RF": HALF, "4 LH": -HALF}  # in the order they swing: place before the centroid
SHORTER, LIFTS = (6.0, 4.0, 2.0), 3
MACHINES = {"printed": printed, "extended": functools.partial(extended, 17)}


class Strategy(NamedTuple):
    """How a foot swings."""

    name: str
    planner: Any  # of an informed swing; None: blind


STRATEGIES = (Strategy("blind", None), Strategy("informed", shortest), Strategy("informed, cautious", cautious))


def main(out: Path | None = None, quick: bool = False) -> None:
    """Walk all courses with all strategies and machines; `quick` walks two fifths of each."""
    jax.config.update("jax_enable_x64", True)
    configure_jax()
    ways, rows = {}, []
    length = 0.4 * LENGTH if quick else LENGTH
    print(
        "course      strategy            machine   after a return   finished  reached  swings  returns  collisions  foot path"
    )
    for name, (true, believed) in COURSES.items():
        ground = course(*true), course(*believed)
        for machine in MACHINES:
            for strategy in STRATEGIES:
                for answers in (True, False):
                    row, ways[name, machine, strategy.name, answers] = walk(machine, strategy, answers, length, ground)
                    rows.append({"course": name} | row)
                    show(rows[-1])
    write("lander_walk", out, {"rows": rows, "course": {"length": UNIT * length, "unit": UNIT} | COURSES})
    shown = {}
    for row in rows:
        if (row["course"], row["machine"], row["tries_again"]) == ("paper's", "extended", True):
            title = f"{row['strategy']}: total path of all feet {row['foot_path']:.0f} (drawn: the left front foot)"
            shown[title] = ways["paper's", "extended", row["strategy"], True]
    x = np.linspace(-15.0, length + 20.0, 3000)
    true, believed = (np.asarray(height(course(*kind), jnp.asarray(x))) for kind in COURSES["paper's"])
    draw_course(x, {"true": true, "told": believed}, shown, (out or Path("runs") / "lander_walk") / "course.png")


def show(row: dict[str, Any]) -> None:
    """One line."""
    again = "tries again" if row["tries_again"] else "stops"
    numbers = f"{row['reached']:8.0f}{row['swings']:8d}{row['returns']:9d}{row['collisions']:12d}{row['foot_path']:11.1f}"
    print(f"{row['course']:12s}{row['strategy']:20s}{row['machine']:10s}{again:15s}{row['finished']!s:>10s}{numbers}")


def course(slope: float, step: float) -> Profile:
    """Heights and slopes of the course at its knots; corners are rounded over a knot, the step's riser is as wide as one."""
    x = np.arange(-300, 10 * (LENGTH + 3 * STRIDE)) * SPACING
    ramp = np.tan(np.deg2rad(slope)) * np.clip(x - SLOPE_FROM, 0.0, SLOPE_TO - SLOPE_FROM)
    heights = ramp + np.where(x > STEP_AT, step / UNIT, 0.0)
    return hermite(jnp.asarray(heights), jnp.asarray(np.gradient(ramp, SPACING)), x[0], SPACING)


@jax.jit
def _blind(machine: Machine, step: Step, ground: tuple[Profile, Profile], planner: None) -> Any:
    return blind_swing(machine, step, ground[0])


@jax.jit
def _informed(machine: Machine, step: Step, ground: tuple[Profile, Profile], planner: RoutePlanner) -> Any:
    return informed_swing(machine, planner, step, ground[0], told(step, ground[1])).swing


def told(step: Step, ground: Profile) -> LocalMap:
    """The wrong map of a step, shifted so that it is right where the foot stands."""
    local = sampled(ground, step.start[0] - 0.5, step.start[0] + STRIDE + 3.5, 241)
    return local._replace(ground=local.ground + step.start[1] - height(ground, step.start[0]))


def walk(
    machine: str, strategy: Strategy, answers: bool, length: float, ground: tuple[Profile, Profile]
) -> tuple[dict[str, Any], list[Trace]]:
    """Walk a course, true and as told; the numbers, and the paths of the left front foot."""
    lander = Lander(machine, strategy.planner and strategy.planner(), ground)
    body, finished = 0.0, True
    while body < length and finished:
        finished = all(lander.place(leg, body + LEGS[leg], answers) for leg in LEGS)
        body += STRIDE if finished else 0.0
    about = {"strategy": strategy.name, "machine": machine, "tries_again": answers}
    return about | {"finished": finished, "reached": UNIT * body} | lander.tally, lander.traces


class Lander:
    """The feet of a walk and what it has cost so far."""

    def __init__(self, machine: str, planner: RoutePlanner | None, ground: tuple[Profile, Profile]) -> None:
        self.make, self.planner, self.ground = MACHINES[machine], planner, ground
        self.feet = {leg: np.array([place, 0.0]) for leg, place in LEGS.items()}
        self.tally = {"swings": 0, "returns": 0, "collisions": 0, "adjustments": 0, "foot_path": 0.0, "time": 0.0}
        self.traces: list[Trace] = []

    def place(self, leg: str, nominal: float, answers: bool) -> bool:
        """Swing a foot to its place a step ahead of `nominal`, or to where it can; whether it found a support."""
        for stride, lift in attempts(answers):
            seen = self.swing(leg, nominal + stride, lift)
            if int(seen.exit) == Mode.SUPPORTED:
                self.feet[leg] = np.asarray(seen.point)
                return True
            self.tally["returns"] += 1
        return False

    def swing(self, leg: str, target: float, lift: float) -> Any:
        """One swing under a body raised by `lift`."""
        mean = float(np.mean([foot[1] for foot in self.feet.values()])) + lift
        machine = self.make(low=mean - BELOW, high=mean + ABOVE)
        step = Step(jnp.asarray(self.feet[leg]), jnp.asarray([target, self.feet[leg][1]]))
        seen = (_informed if self.planner else _blind)(machine, step, self.ground, self.planner)
        more = {"swings": 1, "collisions": int(seen.collisions), "adjustments": int(seen.adjustments)}
        more |= {"foot_path": UNIT * float(seen.length), "time": UNIT * float(seen.time)}
        self.tally |= {name: self.tally[name] + number for name, number in more.items()}
        if leg == "1 LF":
            self.traces.append(traced(machine, step, self.ground, self.planner))
        return seen


def attempts(answers: bool) -> list[tuple[float, float]]:
    """Strides and lifts of the body in the order they are tried."""
    more = [(stride, lift) for lift in np.arange(LIFTS + 1.0) for stride in (STRIDE, *SHORTER)]
    return more if answers else more[:1]


def traced(machine: Machine, step: Step, ground: tuple[Profile, Profile], planner: RoutePlanner | None) -> Trace:
    """The path of one swing."""
    if planner:
        return informed_trace(machine, planner, step, ground[0], told(step, ground[1]))
    return blind_trace(machine, step, ground[0])


if __name__ == "__main__":
    tyro.cli(main)
