"""How a plan ended, and why a step cannot be made: one status for every planner."""

from jaxleg.numerics import Code


class Status(Code):
    """Outcome of planning one lane; anything but `OK` is counted, never averaged over.

    From `NO_FOOTHOLD` to `WORKSPACE` it is also why a candidate step cannot be made.
    """

    OK = 0
    NO_FOOTHOLD = 1  # no valid cell, or fewer footholds than candidates
    KINEMATICS = 2  # out of reach, knee too straight or out of a joint's range
    STABILITY = 3  # centre of mass too near to the support triangle's edge
    HIND_LEG = 4  # touches the ground
    LEFT_LEG = 5  # the left front one
    COLLISION = 6  # right front leg or trunk
    NOT_FINITE = 7  # e.g. unseen ground on the way
    TORQUE = 8  # more than a motor gives
    LOAD = 9  # a standing foot would have to pull
    WORKSPACE = 10  # a foot outside of where it may stand under its hip
    NO_PATH = 11
    START_BLOCKED = 12
    GOAL_BLOCKED = 13
    TOO_LONG = 14  # more cells or steps than allowed
    NO_STANCE = 15  # no valid cell for some foot at the start
    DEAD_END = 16  # no state leads on
    BUDGET = 17  # as many candidates tried as allowed
