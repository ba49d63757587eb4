"""The data a plan is made of: the walk (footholds, poses, phases) and its sampled reference."""

from typing import NamedTuple

from jaxtyping import Array, Bool, Float, Int

from jaxleg.gait.order import SHIFT
from jaxleg.gait.params import GaitParams
from jaxleg.gait.phases import Phases
from jaxleg.leg.workspace import Workspace
from jaxleg.pytree import pytree, static


@pytree
class Walk:
    """A planned walk; everything continuous is differentiable in the planner's numbers and the map.

    A walk that was planned for `legs` may end before: after `count` steps everything stands, and `used` is false.
    """

    gait: GaitParams
    footholds: Float[Array, "stance leg 3"]  # foot centres in W; stance 0 is where the walk begins
    found: Int[Array, "stance leg"]  # FootholdStatus
    poses: Float[Array, "pose 6"]  # of the trunk before the first step, then in each step's swing, then at the end
    feet: Float[Array, "pose leg 3"]  # before each step, and at the end
    count: Int[Array, ""]  # steps
    way: Float[Array, ""]  # of the walk [m]
    lowering: Float[Array, ""]  # how far the trunk was lowered below H_COG to fit the legs, at most (A17) [m]
    phases: Phases
    used: Bool[Array, "phase"]
    load_share: Float[Array, ""]  # part of a swing at either end in which the load is transferred
    status: Int[Array, ""]  # Status
    legs: tuple[int, ...] = static()  # that swings in each phase, or `SHIFT`

    @property
    def steps(self) -> int:
        """Swings that the phases have room for."""
        return sum(leg != SHIFT for leg in self.legs)


class Reference(NamedTuple):
    """A walk sampled in time: what the joint controllers follow. A fixed number of samples a phase, both ends included."""

    time: Float[Array, "t"]
    joint_pos: Float[Array, "t leg joint"]
    joint_vel: Float[Array, "t leg joint"]
    joint_torque: Float[Array, "t leg joint"]  # feed-forward: full inverse dynamics of the reference [N m]
    trunk_pos: Float[Array, "t 3"]
    trunk_quat: Float[Array, "t 4"]
    trunk_vel: Float[Array, "t 6"]  # linear in W [m/s], angular in B [rad/s]
    foot_pos: Float[Array, "t leg 3"]
    contact: Float[Array, "t leg"]  # 1 standing, 0 in the air, between: load being transferred


class PlanChecks(NamedTuple):
    """What constrains a plan, as numbers over the whole walk."""

    knee_bend: Float[Array, ""]  # least [rad]
    margin: Float[Array, ""]  # least planned stability margin [m]
    torque_ratio: Float[Array, ""]  # greatest |torque| over its limit
    load: Float[Array, ""]  # least vertical force of a standing foot over a quarter of the weight: at 0 it lifts off
    joint_room: Float[Array, ""]  # least distance of a joint to the end of its range [rad]; negative: beyond it
    lowering: Float[Array, ""]  # [m]
    used: Workspace  # the smallest that the feet stood in wherever they are asked to be inside theirs
    inside: Float[Array, ""]  # share of these places that are
    found: Float[Array, "status"]  # share of the footholds found so, by `FootholdStatus`
    status: Int[Array, ""]  # Status
