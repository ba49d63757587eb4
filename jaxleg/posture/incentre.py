"""Trunk poses: way-points from the support triangles, pitch with the ground, lowering to what the legs reach.

Paper A, IV.C (readings A12, A16, A17). A trunk pose is (x, y, z, pitch, roll, yaw): B's origin in W [m], its turn [rad].
Paper A's crawl only pitches.
"""

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEG_END
from jaxleg.gait.params import GaitParams
from jaxleg.gait.support import overlap_incentre, overlap_median
from jaxleg.leg.kinematics import reach_for_bend
from jaxleg.numerics import dot, sqrt_safe
from jaxleg.posture.body import com_offset, feet_in_trunk
from jaxleg.robot import Robot
from jaxleg.rotations import trunk_rotation

CogRule = Literal["overlap", "median"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class CogPlan:
    """How way-points of the centre of gravity are placed (paper A, IV.C; C, (21))."""

    median_ratio: Float[Array, "*batch"]  # place on the median, used by the rule "median" only
    height_threshold: Float[Array, "*batch"]  # a smaller change of a way-point's height is suppressed [m]
    rule: CogRule = dataclasses.field(default="overlap", metadata={"static": True})


def waypoint(
    robot: Robot,
    params: GaitParams,
    cog: CogPlan,
    before: Float[Array, "leg 3"],
    after: Float[Array, "leg 3"],
    standing: Int[Array, "2"],
    swinging: Int[Array, "2"],
) -> Float[Array, "6"]:
    """Trunk pose in which a side's two swings happen (paper A, IV.C; reading A12).

    `before`, `after` are the feet before and after the two swings; `standing`, `swinging` the (front, hind) legs. Across, the
    centre of mass (legs included, averaged over the swings) stands over the in-centre of the two support triangles' overlap,
    or over a point on its median (rule "median"). Fore and aft the hips' centre stands `foot_offset` ahead of that point, so
    the feet are behind the hips by as much: A16, the margin lost is reported. Height: mean foot height + H_COG; pitch: with
    the line from hind to front feet (A17).
    """
    stand = before[standing, :2]
    corners = (stand[0], stand[1], before[swinging[0], :2], after[swinging[1], :2])
    centre = overlap_incentre(*corners) if cog.rule == "overlap" else overlap_median(*corners, cog.median_ratio)
    feet = 0.5 * (before + after)
    pitch = _ground_pitch(feet)
    height = jnp.mean(feet[:, 2]) + params.hip_height
    level = jnp.zeros_like(pitch)
    pose = jnp.stack([centre[0] - params.foot_offset, centre[1], height, pitch, level, level])

    def centred(_, pose):
        return pose.at[1].set(centre[1] - com_offset(robot, pose, feet)[1])

    return jax.lax.fori_loop(0, 2, centred, pose)  # the legs trail the sway by a fifth: two passes leave under 1 mm


def held_heights(heights: Float[Array, "n"], threshold: Float[ArrayLike, ""]) -> Float[Array, "n"]:
    """Way-point heights [m] without the small changes: each stays where the last one was unless it differs by more than
    the threshold [m] (paper A, IV.C, against fluctuation of the trunk)."""

    def hold(last, wanted):
        height = jnp.where(jnp.abs(wanted - last) > threshold, wanted, last)
        return height, height

    return jax.lax.scan(hold, heights[0], heights)[1]


def _ground_pitch(feet: Float[Array, "leg 3"]) -> Float[Array, ""]:
    ahead = 0.5 * jnp.asarray(LEG_END, feet.dtype)
    along = jnp.sum(ahead[:, None] * feet, axis=0)
    return jnp.arctan2(along[2], along[0])


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
