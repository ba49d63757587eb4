"""The data a plan is made of: gait parameters, the walk (footholds, way-points, phases) and its sampled reference."""

from typing import NamedTuple

from jaxtyping import Array, Bool, Float, Int

from jaxleg.gait.params import GaitParams
from jaxleg.numerics import Code


class PlanStatus(Code):
    """Outcome of planning one lane; anything but `OK` is infeasible and is counted, never averaged over."""

    OK = 0
    NO_FOOTHOLD = 1
    OUT_OF_REACH = 2  # even lowered, a foot is out of reach or the hip at or below the thigh's length over the feet
    NOT_FINITE = 3  # e.g. the walk leaves the seen part of the map


class Phases(NamedTuple):
    """The phases of a walk, six a cycle: shift, hind swing, front swing for the right side, then for the left.

    Trunk poses are (x, y, z, pitch, roll, yaw): B's origin in W [m] and its turn [rad], see `posture.trunk_rotation`.
    """

    start: Float[Array, "phase"]  # time at which the phase begins [s]
    duration: Float[Array, "phase"]  # [s]
    trunk_from: Float[Array, "phase 6"]
    trunk_to: Float[Array, "phase 6"]
    feet_from: Float[Array, "phase leg 3"]  # foot centres in W [m]
    feet_to: Float[Array, "phase leg 3"]
    apex: Float[Array, "phase leg"]  # swing apex above the higher end [m], 0 for standing legs
    swings: Float[Array, "phase leg"]  # 1 for the leg that swings in this phase


class Walk(NamedTuple):
    """A planned walk of whole cycles; everything continuous is differentiable in the gait parameters and the map."""

    params: GaitParams
    footholds: Float[Array, "stance leg 3"]  # foot centres in W; stance 0 is where the walk begins
    foothold_status: Int[Array, "stance leg"]
    waypoints: Float[Array, "waypoint 6"]  # trunk pose before the first shift and after each
    cycle_time: Float[Array, "cycle"]  # [s]
    lowering: Float[Array, ""]  # how far the trunk was lowered below H_COG to fit the legs (A17) [m]
    phases: Phases


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
    status: Int[Array, ""]  # PlanStatus


class Plan(NamedTuple):
    """A walk and its reference."""

    walk: Walk
    reference: Reference
    status: Int[Array, ""]  # PlanStatus


def feasible(status: Int[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether a `PlanStatus` says the plan can be walked."""
    return status == PlanStatus.OK
