"""The cost map that paths are searched on: the ground under the body and under the feet. Paper C, (16).

`CostSettings` (TOML) holds `Windows`, which are static, and what `cost_weights` makes values of that may be traced.
`total_cost` takes both.
"""

import dataclasses
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.conventions import InputError
from jaxleg.settings import setting
from jaxleg.terrain.body_cost import BodySettings, BodyWeights, body_cost, body_features
from jaxleg.terrain.foothold_cost import FeetSettings, FootWeights, LegWeights, Stance, feet_cost
from jaxleg.terrain.foothold_features import FootholdFeatures, FootholdSettings
from jaxleg.terrain.heightmap import HeightMap

ROUNDING = 1e-3  # of a sum that must be 1, as it may be written in a file; the sum is then made 1


class CostMap(NamedTuple):
    """Costs of the body's centre on each cell: in [0, 1], infinite where it cannot be. Headings in order of `HEADINGS`."""

    total: Float[Array, "heading nx ny"]
    body: Float[Array, "nx ny"]
    feet: Float[Array, "heading nx ny"]


class CostWeights(NamedTuple):
    """Every value that is not a window; all may be traced."""

    body: BodyWeights
    feet: FootWeights
    body_share: Float[ArrayLike, ""]  # lambda_body; lambda_feet = 1 - lambda_body


@dataclasses.dataclass(frozen=True)
class Windows:
    """Windows and readings; static."""

    body: BodySettings = setting(BodySettings())
    foothold: FootholdSettings = setting(FootholdSettings())
    feet: FeetSettings = setting(FeetSettings())
    combine: Literal["norm", "linear"] = setting("norm", help="how the body's features make a cost")


@dataclasses.dataclass(frozen=True)
class CostSettings:
    """All there is to set of a cost map, as a table of a TOML file. Raises `InputError` for weights that do not sum to 1."""

    windows: Windows = setting(Windows())
    body_weights: tuple[float, float, float] = setting(
        (2 / 3, 2 / 3, 1 / 3), min=0.0, max=1.0, help="of slope, roughness, step height; their squares sum to 1"
    )
    slope_limit: float = setting(0.6, above=0.0, below=1.57, unit="rad", help="s_max: costs no more beyond")
    roughness_limit: float = setting(0.15, above=0.0, max=10.0, unit="m", help="r_max")
    step_limit: float = setting(0.20, above=0.0, max=10.0, unit="m", help="h_max")
    step_threshold: float = setting(0.20, above=0.0, max=10.0, unit="m", help="a greater step height cannot be traversed")
    least_seen: float = setting(0.6, min=0.0, max=1.0, help="share of the body's disc that must have been seen")
    foot_weights: LegWeights = setting(LegWeights(), help="of each leg's foothold features")
    foot_limits: tuple[float, float, float, float] = setting(
        (0.1, 0.6, 0.4, 0.6), above=0.0, max=10.0, help="critical curvature, slope, concavity and uphill angle [rad]"
    )
    lambda_body: float = setting(0.5, min=0.0, max=1.0, help="of the ground under the body")
    lambda_feet: float = setting(0.5, min=0.0, max=1.0, help="of the ground under the feet")

    def __post_init__(self) -> None:
        squares = sum(w * w for w in self.body_weights)
        if abs(squares - 1.0) > ROUNDING:
            weights = list(self.body_weights)
            raise InputError(f"the squares of body_weights, {weights}, sum to {squares:.4g}, but must sum to 1")
        if abs(self.lambda_body + self.lambda_feet - 1.0) > ROUNDING:
            raise InputError(f"lambda_body and lambda_feet, {self.lambda_body:g} and {self.lambda_feet:g}, must sum to 1")


def cost_weights(settings: CostSettings) -> CostWeights:
    """The values of the settings; weights are made to sum to 1 exactly."""
    weight = np.array(settings.body_weights) / np.linalg.norm(settings.body_weights)
    limit = (settings.slope_limit, settings.roughness_limit, settings.step_limit)
    body = BodyWeights(*(jnp.asarray(x, float) for x in (weight, limit, settings.step_threshold, settings.least_seen)))
    feet = FootWeights(settings.foot_weights.table(), jnp.asarray(settings.foot_limits, float))
    share = settings.lambda_body / (settings.lambda_body + settings.lambda_feet)
    return CostWeights(body, feet, jnp.asarray(share, float))


def total_cost(
    terrain: HeightMap,
    footholds: FootholdFeatures,
    resolution: float,
    windows: Windows,
    stance: Stance,
    weights: CostWeights,
    softness: Float[ArrayLike, ""] | None = None,
) -> CostMap:
    """Cost of the body's centre on each cell for each heading of travel: lambda_body c_body + lambda_feet c_feet.

    Infinite, whatever the shares, where the body cannot be or a foot has seen no ground. `footholds` are the map's
    `foothold_features`, at the radii of `windows.foothold`. `resolution` is the map's
    [m per cell], static as `windows` and the `stance` are; `softness` that of `body_features`, exact without.
    """
    body = body_cost(body_features(terrain, resolution, windows.body, softness), weights.body, windows.combine)
    feet = feet_cost(footholds, resolution, windows.feet, stance, weights.feet)
    return CostMap(combined(body, feet, weights.body_share), body, feet)


def combined(
    body: Float[Array, "nx ny"], feet: Float[Array, "heading nx ny"], share: Float[ArrayLike, ""]
) -> Float[Array, "heading nx ny"]:
    """share * body + (1 - share) * feet where both are finite, else infinite. Paper C, (16)."""
    body = body[None]
    possible = jnp.isfinite(body) & jnp.isfinite(feet)
    total = share * jnp.where(possible, body, 0.0) + (1.0 - share) * jnp.where(possible, feet, 0.0)
    return jnp.where(possible, total, jnp.inf)
