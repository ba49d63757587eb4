"""Settings of paper C's planner: from a map to a walk (`jaxleg plan`)."""

import dataclasses

from jaxleg.gait.support import CogPoint
from jaxleg.series.kinds import Order
from jaxleg.settings import setting
from jaxleg.terrain.cost_map import CostSettings

ROUNDING = 1e-6  # of a sum that must be 1


@dataclasses.dataclass(frozen=True)
class PathSettings:
    """Body path (C9) and how the stance follows it (C10b)."""

    mu_distance: float = setting(0.4, above=0.0, max=1.0, help="mu_1, of the way in metres; at 0 a path may circle")
    mu_cost: float = setting(0.6, min=0.0, max=1.0, help="mu_2, of the cost; the two sum to 1")
    smoothing: float = setting(0.5, min=0.0, max=5.0, unit="m", help="window that the path is averaged over")
    turn_deg: float = setting(15.0, above=0.0, max=90.0, unit="deg", help="most that the stance turns in a cycle")
    cells: int = setting(600, min=2, max=100000, help="most cells of a path")
    steps: int = setting(240, min=4, max=100000, help="most steps of a walk")
    detours: int = setting(6, min=0, max=100, help="other paths tried where no gait leads along one")
    detour_radius: float = setting(0.3, above=0.0, max=5.0, unit="m", help="ground closed round a dead end for the next path")

    def __post_init__(self) -> None:
        if abs(self.mu_distance + self.mu_cost - 1.0) > ROUNDING:
            raise ValueError(f"mu_distance and mu_cost, {self.mu_distance:g} and {self.mu_cost:g}, must sum to 1")


@dataclasses.dataclass(frozen=True)
class TreeSettings:
    """Candidate states and their search (C13, C14)."""

    depth: int = setting(4, min=1, max=64, help="steps that must stand before the first is settled; four to a cycle")
    budget: int = setting(3000, min=1, max=10**9, help="most candidates tried on a walk")
    footholds: int = setting(12, min=1, max=200, help="candidates a step")
    heights: int = setting(5, min=1, max=21, help="candidate heights")
    pitches: int = setting(3, min=1, max=21, help="candidate pitches")
    rolls: int = setting(3, min=1, max=21, help="candidate rolls")
    height_step: float = setting(0.03, above=0.0, max=0.5, unit="m", help="between candidate heights")
    pitch_step_deg: float = setting(6.0, above=0.0, max=45.0, unit="deg", help="between candidate pitches")
    roll_step_deg: float = setting(6.0, above=0.0, max=45.0, unit="deg", help="between candidate rolls")
    search_length: float = setting(0.28, above=0.0, max=2.0, unit="m", help="of the rectangle round a default foothold")
    search_width: float = setting(0.20, above=0.0, max=2.0, unit="m", help="across the heading")
    order: Order = setting("paper", help="of the candidates: paper C's, or by foothold cost plus energy of the step")
    cost_weight: float = setting(1.0, min=0.0, max=100.0, help="of a foothold's cost in the order of footholds")
    distance_weight: float = setting(0.3, min=0.0, max=100.0, help="of its distance to the default one")
    energy_weight: float = setting(1.0, min=0.0, max=100.0, help="of a step's energy over `energy` (order = energy)")
    energy: float = setting(50.0, above=0.0, max=1e6, unit="J", help="of a step, that counts as much as the dearest foothold")
    prune: bool = setting(True, help="the paper's three rules")


@dataclasses.dataclass(frozen=True)
class PoseSettings:
    """Trunk over the feet (C10, C11), and what a state must keep."""

    rule: CogPoint = setting("median", help="centre of gravity on the median (21), or in-centre of the triangles' overlap")
    median_ratio: float = setting(0.5, min=0.0, max=1.0, help="k of (21): 0 the diagonals' crossing, 1 the standing side")
    target_weight: float = setting(1.0, min=0.0, max=1.0, help="of the flying foot's target in the trunk's plane; 0 as printed")
    levelling: float = setting(0.0, min=0.0, max=1.0, help="part of the plane's tilt that the trunk does not follow")
    least_knee_bend_deg: float = setting(20.0, min=0.0, max=120.0, unit="deg", help="of every knee")
    least_margin: float = setting(0.03, min=0.0, max=0.5, unit="m", help="stability margin")


@dataclasses.dataclass(frozen=True)
class PaceSettings:
    """How fast a walk is, and how finely it is sampled and simulated."""

    acceleration: float = setting(1.0, above=0.0, max=10.0, unit="m/s^2", help="most of the trunk in a shift")
    reserve: float = setting(0.03, min=0.0, max=0.5, unit="m", help="of the zero moment point to the feet's hull in a shift")
    foot_speed: float = setting(1.6, above=0.0, max=10.0, unit="m/s", help="most of a swinging foot")
    least_shift: float = setting(0.12, above=0.0, max=10.0, unit="s", help="of a shift")
    least_swing: float = setting(0.35, above=0.0, max=10.0, unit="s", help="of a swing")
    lift_share: float = setting(0.2, min=0.0, max=0.4, help="part of a swing at either end straight up or down")
    shift_samples: int = setting(16, min=4, max=1000, help="reference samples a shift")
    swing_samples: int = setting(24, min=4, max=1000, help="reference samples a swing")
    tick: float = setting(0.0025, min=0.0005, max=0.004, unit="s", help="step of the simulation")

    def __post_init__(self) -> None:
        for least, samples in (("least_shift", "shift_samples"), ("least_swing", "swing_samples")):
            apart = getattr(self, least) / getattr(self, samples)
            if apart < self.tick:
                raise ValueError(
                    f"{samples} is {getattr(self, samples)}, {apart:.3g} s apart in {least}, but they must be at least a tick,"
                    f" {self.tick:g} s, apart"
                )


@dataclasses.dataclass(frozen=True)
class FootingSettings:
    """Where a foot may be placed (A9)."""

    # a foot slides beyond atan(friction), 39 deg for the default: half of its tangent is kept in reserve
    slope_limit_deg: float = setting(22.0, above=0.0, below=90.0, unit="deg", help="steepest valid foothold")
    side_slope_limit_deg: float = setting(28.0, above=0.0, below=90.0, unit="deg", help="of the ground to any neighbour")
    edge_height: float = setting(0.03, above=0.0, max=1.0, unit="m", help="a jump between cells that counts as an edge")
    least_traversability: float = setting(0.6, min=0.0, max=1.0, help="of every cell under a foot, 1 = easy")
    least_share: float = setting(0.1, min=0.0, max=1.0, help="of valid cells round each default foothold along a path")


@dataclasses.dataclass(frozen=True)
class Navigation:
    """From a map, a start and a goal to a walk. Paper C."""

    cost: CostSettings = setting(CostSettings())
    footing: FootingSettings = setting(FootingSettings())
    path: PathSettings = setting(PathSettings())
    tree: TreeSettings = setting(TreeSettings())
    pose: PoseSettings = setting(PoseSettings())
    pace: PaceSettings = setting(PaceSettings())
