"""The planner's continuous parameters."""

from typing import Literal

from jaxtyping import Array, Float

from jaxleg.leg.workspace import Workspace
from jaxleg.pytree import pytree, static

Support = Literal["stance", "sweep"]  # when a foot must be inside the workspace: see `posture.workspace`


@pytree
class GaitParams:
    """The planner's continuous parameters. Paper A's letter is given where it has one; lengths in metres.

    `phase` shares: each half cycle is a body shift, the hind leg's swing and the front leg's.
    """

    workspace: Workspace  # where a foot may stand under its hip; the hips are as high above the feet as it and the legs allow
    foot_offset: Float[Array, "*batch"]  # L_F2H centre: feet ahead (+) or behind (-) the hips
    skew: Float[Array, "*batch"]  # L_Skew: left feet ahead of the right ones before the right legs swing
    step_length: Float[Array, "*batch"]  # L_Step
    stance_length: Float[Array, "*batch"]  # L_Stance: front to hind foot of a side
    stance_width: Float[Array, "*batch"]  # W_Stance: left to right foot
    swing_height: Float[Array, "*batch"]  # H of the compound cycloid (B3), above the higher end
    shift_share: Float[Array, "*batch"]  # body shift's part of a half cycle
    hind_share: Float[Array, "*batch"]  # hind swing's part of the rest
    lift_share: Float[Array, "*batch"]  # part of a swing at either end in which the foot moves only up or down
    support: Support = static("stance")
