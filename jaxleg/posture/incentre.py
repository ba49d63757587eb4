"""The trunk over the in-centre of the support triangles, pitched with the ground, lowered to what the legs reach.

Paper A, IV.C (readings A12, A16, A17). One pose for both swings of a side; a trunk pose is (x, y, z, pitch, roll, yaw).
"""

from typing import Literal

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEG_END
from jaxleg.gait.params import GaitParams
from jaxleg.gait.support import CogRule, cog_point
from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.numerics import dot, sqrt_safe
from jaxleg.posture.body import com_offset, feet_in_trunk
from jaxleg.pytree import pytree, static
from jaxleg.robot import Robot
from jaxleg.rotations import to_heading, trunk_rotation, turned

Lowering = Literal["way-point", "none"]


@pytree
class Incentre:
    """How way-points of the centre of gravity are placed (paper A, IV.C; C, (21))."""

    cog: CogRule
    height_threshold: Float[Array, "*batch"]  # a smaller change of a way-point's height is suppressed [m]
    lowering: Lowering = static("way-point")  # each as far as reach and knee bend demand, or not at all

    shared = True  # one pose for both swings of a side

    def swing(self, robot: Robot, gait: GaitParams, before, after, leg, adjust, yaw) -> Float[Array, "6"]:
        """Trunk pose for a side's two swings; see `waypoint`. `adjust` is added: height [m], pitch and roll [rad]."""
        pose = waypoint(robot, gait, self.cog, before, after, leg, yaw)
        return pose.at[2:5].add(adjust)

    def sketch(self, gait: GaitParams, before, after, leg, yaw) -> Float[Array, "6"]:
        """The pose of `swing` but for the trunk's place across, which takes the legs' masses to know."""
        return _beside(gait, cog_point(self.cog, before, after, leg), 0.5 * (before + after), yaw)(jnp.zeros_like(yaw))

    def stand(self, robot: Robot, gait: GaitParams, feet, yaw) -> Float[Array, "6"]:
        """Trunk pose of standing on four feet: over their middle."""
        return over(robot, gait, jnp.mean(feet[:, :2], axis=0), feet, yaw)

    def settle(self, poses: Float[Array, "pose 6"]) -> Float[Array, "pose 6"]:
        """The poses of a walk without the small changes of height."""
        return poses.at[:, 2].set(held_heights(poses[:, 2], self.height_threshold))


def waypoint(
    robot: Robot,
    gait: GaitParams,
    cog: CogRule,
    before: Float[Array, "leg 3"],
    after: Float[Array, "leg 3"],
    leg: Int[Array, ""],
    yaw: Float[Array, ""],
) -> Float[Array, "6"]:
    """Trunk pose in which a side's two swings happen (paper A, IV.C; reading A12), heading by `yaw` [rad].

    `before`, `after` are the feet before and after the two swings; `leg` is one that swings. Across, the centre of mass (legs
    included, averaged over the swings) stands over the in-centre of the two support triangles' overlap, or over a point on its
    median. Fore and aft the hips' centre stands `-foot_offset` ahead of that point, so the feet are behind the hips by as much:
    A16, the margin lost is reported. Height: mean foot height + H_COG; pitch: with the line from hind to front feet (A17).
    """
    return over(robot, gait, cog_point(cog, before, after, leg), 0.5 * (before + after), yaw)


def over(
    robot: Robot, gait: GaitParams, centre: Float[Array, "2"], feet: Float[Array, "leg 3"], yaw: Float[Array, ""]
) -> Float[Array, "6"]:
    """The pose over a point (x, y) [m]: fore and aft the hips' centre, across the centre of mass."""
    at = _beside(gait, centre, feet, yaw)

    def centred(_, aside):
        return -to_heading(com_offset(robot, at(aside), feet)[:2], yaw)[1]

    aside = jax.lax.fori_loop(0, 2, centred, jnp.zeros_like(yaw))
    return at(aside)  # the legs trail the sway by a fifth: two passes leave under 1 mm


def _beside(gait: GaitParams, centre: Float[Array, "2"], feet: Float[Array, "leg 3"], yaw: Float[Array, ""]):
    """The pose over a point, as a function of how far to the left of it [m]."""
    height, level = jnp.mean(feet[:, 2]) + gait.workspace.high, jnp.zeros_like(yaw)
    turn = jnp.stack([_ground_pitch(feet, yaw), level, yaw])

    def at(aside: Float[Array, ""]) -> Float[Array, "6"]:
        xy = centre + turned(jnp.stack([-gait.foot_offset, aside]), yaw)
        return jnp.concatenate([xy, height[None], turn])

    return at


def held_heights(heights: Float[Array, "n"], threshold: Float[ArrayLike, ""]) -> Float[Array, "n"]:
    """Way-point heights [m] without the small changes: each stays where the last one was unless it differs by more than
    the threshold [m] (paper A, IV.C, against fluctuation of the trunk)."""

    def hold(last, wanted):
        height = jnp.where(jnp.abs(wanted - last) > threshold, wanted, last)
        return height, height

    return jax.lax.scan(hold, heights[0], heights)[1]


def _ground_pitch(feet: Float[Array, "leg 3"], yaw: Float[Array, ""]) -> Float[Array, ""]:
    ahead = 0.5 * jnp.asarray(LEG_END, feet.dtype)
    along = jnp.sum(ahead[:, None] * feet, axis=0)
    return jnp.arctan2(along[2], to_heading(along[:2], yaw)[0])


def lowering_needed(
    robot: Robot, pose: Float[Array, "6"], feet: Float[Array, "leg 3"], bend: Float[ArrayLike, ""]
) -> tuple[Float[Array, "leg"], Float[Array, "leg"]]:
    """How far the trunk must come down [m] so that each leg keeps at least the knee bend [rad] (A17), else 0.

    Exact: the foot must lie within a sphere about the hip joint, so the lowering solves a quadratic (the hip link may have a
    fore-aft and a lateral part, no vertical one). The second value is its
    discriminant [m^2]; negative means that no lowering helps.
    """
    rotation = trunk_rotation(pose[3:])
    link = robot.link_offset[:, 0]
    lateral = jnp.sum(robot.link_offset[..., 1], axis=-1)
    ahead = jnp.stack([link[:, 0], jnp.zeros_like(lateral), jnp.zeros_like(lateral)], axis=-1)
    foot = feet_in_trunk(pose, feet) - robot.hip_position - ahead
    reach = jax.vmap(reach_for_bend, in_axes=(0, None))(robot.link_offset, bend)
    up = dot(foot, rotation[2])
    discriminant = up**2 - dot(foot, foot) + reach**2 + lateral**2
    return jax.nn.relu(-up - sqrt_safe(discriminant)), discriminant
