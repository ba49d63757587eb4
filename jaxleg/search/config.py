"""The configuration of a study: one TOML file, read into frozen dataclasses (checked as a whole in `checks`)."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jaxleg.gait.params import Support
from jaxleg.gait.support import CogPoint
from jaxleg.leg.energy import Convention
from jaxleg.settings import setting
from jaxleg.walk.config import Navigation

Span = tuple[float, float]
EngineName = Literal["legged", "mjx"]
MOVE: dict[str, Span] = {  # what a search moves if it is told nothing else, and within which bounds
    "gait.workspace.high": (0.40, 0.58),
    "gait.foot_offset": (-0.20, 0.10),
    "gait.skew": (0.0, 0.20),
    "gait.step_length": (0.12, 0.30),
    "gait.stance_length": (0.50, 0.80),
    "gait.stance_width": (0.30, 0.50),
    "gait.swing_height": (0.04, 0.12),
    "gait.shift_share": (0.30, 0.60),
    "gait.hind_share": (0.40, 0.60),
    "gait.lift_share": (0.02, 0.25),
}
WORKSPACE: dict[str, Span] = {
    "gait.workspace.behind": (-0.40, 0.0),
    "gait.workspace.ahead": (0.0, 0.40),
    "gait.workspace.low": (0.30, 0.58),
}
BOUNDS = MOVE | WORKSPACE


@dataclasses.dataclass(frozen=True)
class Workspace:
    """Where a foot may stand under its hip (paper A, IV.B.3); a bound that is not given does not bind."""

    behind: float | None = setting(None, min=-2.0, max=2.0, unit="m", help="least L_F2H")
    ahead: float | None = setting(None, min=-2.0, max=2.0, unit="m", help="greatest L_F2H")
    low: float | None = setting(None, min=0.0, max=2.0, unit="m", help="least H_COG")
    high: float = setting(0.48, above=0.0, max=2.0, unit="m", help="greatest H_COG, kept where the legs' reach allows")

    def __post_init__(self) -> None:
        for lower, upper in (("behind", "ahead"), ("low", "high")):
            low, high = getattr(self, lower), getattr(self, upper)
            if low is not None and high is not None and low > high:
                raise ValueError(f"{lower} is {low:g}, but must not exceed {upper}, {high:g}")


@dataclasses.dataclass(frozen=True)
class Gait:
    """Gait parameters, paper A's letters in `jaxleg.gait.params.GaitParams`."""

    workspace: Workspace = setting(Workspace())
    foot_offset: float = setting(0.0, min=-1.0, max=1.0, unit="m", help="L_F2H centre, feet behind the hips: negative")
    skew: float = setting(0.0, min=-1.0, max=1.0, unit="m", help="L_Skew")
    step_length: float = setting(0.2, above=0.0, max=2.0, unit="m", help="L_Step")
    stance_length: float = setting(0.6, above=0.0, max=3.0, unit="m", help="L_Stance")
    stance_width: float = setting(0.36, above=0.0, max=2.0, unit="m", help="W_Stance")
    swing_height: float = setting(0.08, above=0.0, max=1.0, unit="m", help="apex of a swing")
    shift_share: float = setting(0.45, above=0.0, below=1.0, help="body shift's part of a half cycle")
    hind_share: float = setting(0.5, above=0.0, below=1.0, help="hind swing's part of the rest")
    lift_share: float = setting(0.05, min=0.0, max=0.4, help="part of a swing, at either end, straight up or down")


@dataclasses.dataclass(frozen=True)
class Stance:
    """What sets one published parameter set (a contestant) apart; the rest of its gait is the kind's."""

    workspace: Workspace
    foot_offset: float = setting(min=-1.0, max=1.0, unit="m")
    skew: float = setting(min=-1.0, max=1.0, unit="m")
    step_length: float = setting(0.2, above=0.0, max=2.0, unit="m")


@dataclasses.dataclass(frozen=True)
class Contestants:
    """Parameter sets to compare with: two readings of the paper's "traditional" (A15) and the paper's own."""

    traditional: Stance = setting(Stance(Workspace(high=0.48), 0.0, 0.0))
    implied: Stance = setting(Stance(Workspace(high=0.47), -0.10, 0.10))
    paper: Stance = setting(Stance(Workspace(-0.20, 0.0, 0.48, 0.52), -0.10, 0.10))


@dataclasses.dataclass(frozen=True)
class Kind:
    """One kind of terrain, and what every contestant has in common on it."""

    generator: str = setting("flat", help="terrain generator")
    least_knee_bend_deg: float = setting(20.0, min=0.0, max=120.0, unit="deg", help="binds every contestant")
    rise: float = setting(0.08, min=0.0, max=0.5, unit="m", help="stairs: height of a step at difficulty 1")
    run: float = setting(0.30, above=0.05, max=5.0, unit="m", help="stairs: depth of a tread")
    amplitude: float = setting(0.05, min=0.0, max=1.0, unit="m", help="rough: amplitude at difficulty 1")
    heading: float = setting(0.0, min=-np.pi, max=np.pi, unit="rad", help="stairs: direction of ascent")
    correlation_length: float = setting(0.25, above=0.02, max=10.0, unit="m", help="rough: size of its features")
    cuboid: float = setting(0.30, above=0.02, max=10.0, unit="m", help="cuboids: length and width")
    cuboid_height: float = setting(0.10, min=0.0, max=1.0, unit="m", help="cuboids: greatest height, up and down")
    deviation: float = setting(0.12, min=0.0, max=2.0, unit="m", help="fractal: standard deviation at difficulty 1")
    longest_wave: float = setting(4.0, above=0.1, max=100.0, unit="m", help="fractal")
    difficulty: Span = setting((1.0, 1.0), min=0.0, max=1.0, help="range over the terrains")
    gait: Gait = setting(Gait(), help="shared gait parameters")
    leaves: dict[str, float] = setting({}, help="other numbers of the planner by name, instead of the study's")


@dataclasses.dataclass(frozen=True)
class Terrains:
    """How many terrains, and how large their maps are; their numbers stay below `sites.HELD_OUT`."""

    train: int = setting(264, min=1, max=1_000_000, help="training terrains, over all kinds")
    held_out: int = setting(96, min=1, max=1_000_000, help="held-out terrains, over all kinds")
    cells: tuple[int, int] = setting((112, 52), min=8, max=4096, help="map size along x and y")
    resolution: float = setting(0.02, min=0.005, max=0.2, unit="m", help="size of a cell")
    # 0.7, the first author's later choice, narrows a 0.30 m tread of 15 cells from 11 to 9 (tests/search/test_sites.py)
    least_traversability: float = setting(0.6, min=0.0, max=1.0, help="of every cell under a foot, 1 = easy")
    slope_limit_deg: float = setting(35.0, above=0.0, below=90.0, unit="deg", help="steepest valid foothold")
    edge_height: float = setting(0.03, above=0.0, max=1.0, unit="m", help="a jump between cells that counts as an edge")


@dataclasses.dataclass(frozen=True)
class Rectangle:
    """Foothold search (paper A, IV.B)."""

    search_length: float = setting(0.30, above=0.0, max=2.0, unit="m", help="L_Search")
    search_width: float = setting(0.08, above=0.0, max=2.0, unit="m", help="W_Search")
    longer: float = setting(0.08, min=0.0, max=2.0, unit="m", help="added to the length in the second run")
    nominal_weight: float = setting(0.5, min=0.0, max=1.0, help="w1 of the feasible score; w2 = 1 - w1")
    support: Support = setting("stance", help="a foot is inside its workspace landing and half a cycle on, or all the time")


@dataclasses.dataclass(frozen=True)
class Cog:
    """Way-points of the centre of gravity (paper A, IV.C; C, (21))."""

    rule: CogPoint = setting("overlap", help="in-centre of the support triangles' overlap, or a point on its median")
    median_ratio: float = setting(0.5, min=0.0, max=1.0, help="of the rule median: 0 the diagonals' crossing, 1 the side")
    height_threshold: float = setting(0.01, min=0.0, max=0.5, unit="m", help="smaller changes of height are suppressed")


@dataclasses.dataclass(frozen=True)
class Search:
    """The descents on the proxy, and the polish in simulation."""

    move: tuple[str, ...] = setting(tuple(MOVE), help="numbers of the planner by name: what `best` moves within its bounds")
    starts: int = setting(4, min=1, max=10_000, help="starts of each of the three searches")
    lanes: int = setting(4, min=1, max=1_000_000, help="terrains of the first round; four times as many in each later one")
    steps: int = setting(10, min=1, max=1_000_000, help="most steps of a round")
    polish_steps: int = setting(0, min=0, max=5, help="gradients in simulation")
    polish_lanes: int = setting(16, min=1, max=32, help="terrains a gradient in simulation sees")
    polish_rate: float = setting(0.1, above=0.0, max=10.0, help="length of a polishing step")
    counted: Span = setting(
        (0.0, 1.0),
        min=0.0,
        max=1.0,
        help="shares of the terrains, from the cheapest on, whose mean is minimised: [0.9, 1] the dearest tenth (CVaR),"
        " [0, 0.99] lets one in a hundred fail",
    )
    margin_reserve: float = setting(0.003, min=0.0, max=0.1, unit="m", help="stability margin kept above the baseline's")
    proxy_gaits: int = setting(32, min=4, max=1_000_000, help="random gaits on which proxy and simulation are compared")
    referee_terrains: int = setting(24, min=0, max=1_000_000, help="held-out terrains replayed in C MuJoCo")
    resamples: int = setting(2000, min=100, max=100_000, help="bootstrap resamples")


@dataclasses.dataclass(frozen=True)
class Simulation:
    """Resolution of plan and rollout. A walk has two cycles, both metered."""

    shift_samples: int = setting(60, min=8, max=1000, help="reference samples a body shift")
    swing_samples: int = setting(50, min=8, max=1000, help="reference samples a swing")
    steps: int = setting(3, min=1, max=100, help="simulation steps between samples")
    load_share: float = setting(0.1, min=0.02, max=0.3, help="part of a swing phase, at either end, for load transfer")
    clearance: float = setting(0.02, min=0.0, max=0.2, unit="m", help="foot over the ground in mid-swing")
    friction: float = setting(0.8, min=0.1, max=2.0)
    engine: EngineName = setting("legged", help="rigid-body terms: written out for four legs, or MJX's, equal and slower")
    chunk: int = setting(16, min=1, max=4096, help="lanes that a device simulates at once; thousands on a GPU")


@dataclasses.dataclass(frozen=True)
class Randomise:
    """Held-out lanes once more, each with a robot and a ground of its own that its planner does not know: uniform, up or down
    by as much as stands here."""

    lanes: int = setting(0, min=0, max=1_000_000, help="randomised lanes, over all kinds; 0: none")
    mass: float = setting(0.05, min=0.0, below=1.0, help="share, one factor for all masses and inertias")
    com: float = setting(0.02, min=0.0, max=0.5, unit="m", help="the trunk's centre of mass along each axis")
    friction: Span = setting((0.5, 1.0), min=0.1, max=2.0)
    gains: float = setting(0.10, min=0.0, below=1.0, help="share, one factor for all stiffness, one for all velocity_gain")
    map_noise: float = setting(0.01, min=0.0, max=0.5, unit="m", help="each cell of the map that planners see, by itself")
    map_filter: float = setting(2.0, min=0.0, max=10.0, help="radius of the median that planners take of it, in foot radii")


@dataclasses.dataclass(frozen=True)
class Study:
    """A search for energy-saving planner parameters: `jaxleg search CONFIG`."""

    kinds: dict[str, Kind] = setting(help="terrain kinds by name")
    robot: str = setting("robots/pegasus.toml", help="robot file, relative to the config file")
    seed: int = setting(0, min=0, max=2**32 - 1)  # JAX's keys take no more: it would drop higher bits
    speed: float = setting(0.05, above=0.0, max=1.0, unit="m/s", help="forward speed, the same for all")
    power: Convention = setting("positive", help="power convention that the search minimises")
    one_for_all: bool = setting(False, help="one parameter set for all kinds of terrain; what it holds is the first one's")
    contestants: Contestants = setting(Contestants())
    bounds: dict[str, Span] = setting(BOUNDS, help="of what a search moves; unit and limits are those of its key")
    band: Span = setting((0.48, 0.52), above=0.0, max=2.0, unit="m", help="H_COG of the search `best_i`")
    terrains: Terrains = setting(Terrains())
    rectangle: Rectangle = setting(Rectangle())
    cog: Cog = setting(Cog())
    search: Search = setting(Search())
    simulation: Simulation = setting(Simulation())
    randomise: Randomise = setting(Randomise())
    navigation: Navigation = setting(Navigation(), help="paper C's planner: `jaxleg plan`")

    def __post_init__(self) -> None:
        for name in self.kinds:  # it becomes part of file names
            if not re.fullmatch("[A-Za-z0-9_-]{1,40}", name):
                raise ValueError(f"kinds.{name!r} must be named by 1 to 40 letters, digits, _ or -")
        object.__setattr__(self, "bounds", BOUNDS | self.bounds)  # those that are not given stay


def _rule(table: Any, key: str) -> Mapping[str, Any]:
    return table.__dataclass_fields__[key].metadata


_BEND = {"min": 0.0, "max": np.deg2rad(120.0), "unit": "rad"}
RULES: dict[str, Mapping[str, Any]] = {  # of what a study may move: those of the key that it comes from
    **{f"gait.workspace.{field.name}": field.metadata for field in dataclasses.fields(Workspace)},
    **{f"gait.{field.name}": field.metadata for field in dataclasses.fields(Gait) if field.name != "workspace"},
    "foothold.rectangle.length": _rule(Rectangle, "search_length"),
    "foothold.rectangle.width": _rule(Rectangle, "search_width"),
    "foothold.rectangle.longer": _rule(Rectangle, "longer"),
    "foothold.rectangle.nominal_weight": _rule(Rectangle, "nominal_weight"),
    "foothold.least_bend": _BEND,
    "posture.cog.ratio": _rule(Cog, "median_ratio"),
    "posture.height_threshold": _rule(Cog, "height_threshold"),
    "timing.speed": _rule(Study, "speed"),
    "swing.clearance": _rule(Simulation, "clearance"),
    "swing.load_share": _rule(Simulation, "load_share"),
    "limits.knee_bend": _BEND,
    "limits.margin": {"min": 0.0, "max": 0.5, "unit": "m"},
}


def robot_path(study: Study, source: str | Path) -> Path:
    """The robot file named in a study, relative to the config file it was read from."""
    return Path(source).parent / study.robot
