"""Feet under their hips: where they stand in the workspace while a leg swings, and how far inside it. Paper A, IV.B.3.

A foot's support begins in the pose that it lands in. The other side's swings follow in the next pose, half a cycle later, and
in the one after that the foot lifts. Two readings (A5, A11): `stance` asks of the first two, between which the feet's stance
carries the trunk, that the foot is inside; `sweep` of all, lifting included. A foot sweeps one step length in all of its
support, so that under `sweep` a workspace as long as the step, as the paper's is, allows no foot to step further than that.

A foot is a disc (A9), and inside while the disc reaches in: the paper's own gait lands its feet right on the bound, where on
rough ground a millimetre would decide. L_F2H is each foot's own. H_COG is the trunk's, the hips above the mean foot height, as
the planner of the centre of gravity has it: four feet on rough ground often differ by more than a workspace is high.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxleg.gait.nominal import nominal_stances
from jaxleg.gait.params import GaitParams
from jaxleg.numerics import matvec
from jaxleg.posture.incentre import Incentre
from jaxleg.posture.plane import Plane
from jaxleg.robot import Robot
from jaxleg.rotations import to_heading, trunk_rotation
from jaxleg.route.stations import Straight

ROUNDING = 1e-4  # a foot is inside down to this much beyond [m]


class Stood(NamedTuple):
    """Where feet stand under their hips in the pose that a leg swings in: before the swing, and after it."""

    ahead: Float[Array, "when leg"]  # L_F2H [m]
    above: Float[Array, ""]  # H_COG [m]
    asked: Bool[Array, "when leg"]  # whether the reading asks it to be inside


def stood(
    robot: Robot, gait: GaitParams, pose: Float[Array, "6"], before: Float[Array, "leg 3"], after: Float[Array, "leg 3"], leg
) -> Stood:
    """The feet before and after (in W) [m] the swing of `leg`: horizontally ahead of their thigh joints along the trunk's
    heading, the hips' roll left out; and the hips' mean height above the feet's."""
    turn, feet = trunk_rotation(pose[3:]), jnp.stack([before, after])
    hips = pose[None, :3] + matvec(turn, robot.hip_position)
    joint = hips + robot.link_offset[:, 0, :1] * turn[None, :, 0]
    legs = jnp.arange(4)
    swings, other, none = legs == leg, legs % 2 != leg % 2, jnp.zeros(4, bool)
    asked = (swings, ~none) if gait.support == "sweep" else (none, swings | other)
    ahead = to_heading((feet - joint[None])[..., :2], pose[5])[..., 0]
    return Stood(ahead, jnp.mean(hips[:, 2]) - jnp.mean(feet[..., 2]), jnp.stack(asked))


def room(robot: Robot, gait: GaitParams, seen: Stood) -> Float[Array, "when leg"]:
    """How far the disc of each foot reaches into the workspace [m]; negative: outside. Infinite where nothing binds it."""
    space = gait.workspace
    own = jnp.minimum(seen.ahead - space.behind, space.ahead - seen.ahead) + robot.foot_radius
    return jnp.where(seen.asked, jnp.minimum(own, seen.above - space.low), jnp.inf)


def inside(room: Float[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether a foot with such a `room` [m] is inside."""
    return room >= -ROUNDING


def stance_rooms(
    robot: Robot,
    gait: GaitParams,
    posture: Incentre | Plane,
    before: Float[Array, "leg 3"],
    feet: Float[Array, "leg 3"],
    yaw: Float[Array, "side"],
) -> Float[Array, "place"]:
    """Every `room` [m] of the feet of a stance that is stepped to from another's side by side, in both sides' poses.

    `before`, `feet` are the two stances, foot centres in W [m]; `yaw` [rad] is the trunk's heading in the right and in the left
    legs' swings. Poses are the posture's `sketch`.
    """
    right = jnp.arange(4)[:, None] % 2 == 1
    half = jnp.where(right, feet, before)

    def of_side(hind, before, after, yaw):
        """The same of the pose in which a hind leg swings, and with it the front one of its side."""
        pose = posture.sketch(gait, before, after, hind, yaw)
        return jax.vmap(lambda leg: room(robot, gait, stood(robot, gait, pose, before, after, leg)))(
            jnp.stack([hind, hind - 2])
        )

    return jax.vmap(of_side)(jnp.array([3, 2]), jnp.stack([before, half]), jnp.stack([half, feet]), yaw).reshape(-1)


def nominal_rooms(robot: Robot, gait: GaitParams, posture: Incentre | Plane) -> Float[Array, "place"]:
    """`stance_rooms` [m] of the nominal stance on level ground, stepped to from the one before. With a negative one the gait
    cannot keep to its workspace, whatever the ground."""
    stations = Straight(jnp.zeros_like(gait.step_length)).stations(gait, None, 4)
    xy, _ = nominal_stances(gait, stations, 2)
    before, feet = jnp.concatenate([xy, jnp.zeros_like(xy[..., :1])], axis=-1)
    return stance_rooms(robot, gait, posture, before, feet, jnp.zeros(2, feet.dtype))
