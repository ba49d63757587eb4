"""Body pose over the feet. Paper C, 3.1: equation (21) and Fig. 4 (C10, C11)."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEG_END
from jaxleg.gait.support import overlap_incentre, overlap_median
from jaxleg.numerics import inverse3_safe, matvec, norm_safe, sqrt_safe
from jaxleg.posture.body import com_offset
from jaxleg.posture.incentre import CogPlan
from jaxleg.robot import Robot

PEAK = 5.7735  # greatest acceleration of a minimum-jerk move of length 1 in time 1


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PosePlan:
    """How the trunk is held over the feet; every field but the rule a leaf."""

    cog: CogPlan
    # Weight of the flying foot's target in the plane that the trunk is parallel to: 0 is paper C's three standing feet. On
    # rough ground these tilt the trunk to and fro with every step, the plane of all four (1) does not.
    target_weight: Float[Array, "*batch"]
    levelling: Float[Array, "*batch"]  # part of the plane's tilt that the trunk does not follow; 0 is paper C's


def support_plane(feet: Float[Array, "leg 3"], weight: Float[Array, "leg"]) -> Float[Array, "3"]:
    """Plane z = p[0] + p[1] x + p[2] y through feet in W by weighted least squares; exact with three positive weights."""
    centre = jnp.sum(weight[:, None] * feet[:, :2], axis=0) / jnp.sum(weight)
    row = jnp.concatenate([jnp.ones_like(feet[:, :1]), feet[:, :2] - centre[None]], axis=1)
    normal = jnp.sum(weight[:, None, None] * row[:, :, None] * row[:, None, :], axis=0)
    plane = matvec(inverse3_safe(normal, 1e-9), jnp.sum((weight * feet[:, 2])[:, None] * row, axis=0))
    return plane.at[0].add(-jnp.sum(plane[1:] * centre))


def plane_height(plane: Float[Array, "3"], xy: Float[Array, "2"]) -> Float[Array, ""]:
    """Height of a plane at xy in W [m]."""
    return plane[0] + plane[1] * xy[0] + plane[2] * xy[1]


def plane_turn(plane: Float[Array, "3"], yaw: Float[Array, ""]) -> Float[Array, "2"]:
    """Pitch and roll [rad] of a trunk of this yaw whose z axis is the plane's normal."""
    c, s = jnp.cos(yaw), jnp.sin(yaw)
    ahead, aside = c * plane[1] + s * plane[2], c * plane[2] - s * plane[1]
    return jnp.stack([jnp.arctan(ahead), jnp.arctan2(aside, jnp.sqrt(1.0 + ahead**2))])


def feet_yaw(feet: Float[Array, "leg 3"], near: Float[Array, ""]) -> Float[Array, ""]:
    """Yaw [rad] from the middle of the hind feet to the middle of the front ones (C, Fig. 4), within a half turn of `near`."""
    ahead = jnp.sum(jnp.asarray(LEG_END, feet.dtype)[:, None] * feet[:, :2], axis=0)
    c, s = jnp.cos(near), jnp.sin(near)
    return near + jnp.arctan2(c * ahead[1] - s * ahead[0], c * ahead[0] + s * ahead[1])


def cog_point(
    cog: CogPlan, before: Float[Array, "leg 3"], after: Float[Array, "leg 3"], leg: Int[Array, ""]
) -> Float[Array, "2"]:
    """Where the centre of gravity stands while `leg` swings from `before` to `after`. Paper C, (21); A12.

    On the overlap of the two support triangles of its side's swings: the hind foot has reached its target in both, the front
    foot is still where it stood. So the point is the same for both swings of a side.
    """
    left, hind = leg % 2 == 0, leg >= 2
    front_leg, hind_leg = jnp.where(left, 0, 1), jnp.where(left, 2, 3)
    other_front, other_hind = jnp.where(left, 1, 0), jnp.where(left, 3, 2)
    landed = jnp.where(hind, after[hind_leg, :2], before[hind_leg, :2])
    corners = (before[other_front, :2], before[other_hind, :2], before[front_leg, :2], landed)
    return overlap_incentre(*corners) if cog.rule == "overlap" else overlap_median(*corners, cog.median_ratio)


def swing_pose(
    robot: Robot,
    plan: PosePlan,
    before: Float[Array, "leg 3"],
    after: Float[Array, "leg 3"],
    leg: Int[Array, ""],
    adjust: Float[Array, "3"],
    yaw: Float[Array, ""],
) -> Float[Array, "6"]:
    """Trunk pose for a swing of `leg`; `adjust` is its height over the plane [m], then pitch and roll beyond the plane's [rad].

    `yaw` [rad] is the one before: the pose's is within a half turn of it.

    Paper C's five steps: plane of the feet, point of the centre of gravity, height over it, yaw from the feet with the target,
    roll and pitch with the plane. The point is that of the centre of mass, legs included (reading, as A12).
    """
    flying = jnp.arange(4) == leg
    plane = support_plane(after, jnp.where(flying, plan.target_weight, 1.0))
    return pose_over(robot, plan, after, plane, cog_point(plan.cog, before, after, leg), adjust, yaw)


def stand_pose(
    robot: Robot, plan: PosePlan, feet: Float[Array, "leg 3"], adjust: Float[Array, "3"], yaw: Float[Array, ""]
) -> Float[Array, "6"]:
    """Trunk pose of standing on four feet, the centre of mass over their middle; arguments as in `swing_pose`."""
    plane = support_plane(feet, jnp.ones(4, feet.dtype))
    return pose_over(robot, plan, feet, plane, jnp.mean(feet[:, :2], axis=0), adjust, yaw)


def pose_over(robot, plan: PosePlan, feet, plane, point, adjust, near) -> Float[Array, "6"]:
    """The pose with its centre of mass over a point (x, y) [m]: two passes, because the legs' masses move with the trunk."""
    yaw = feet_yaw(feet, near)
    turn = jnp.append((1.0 - plan.levelling) * plane_turn(plane, yaw) + adjust[1:], yaw)

    def over(xy):
        return jnp.concatenate([xy, (plane_height(plane, xy) + adjust[0])[None], turn])

    pose = over(point)
    for _ in range(2):
        pose = over(point - com_offset(robot, pose, feet)[:2])
    return pose


def shift_time(start: Float[Array, "6"], end: Float[Array, "6"], acceleration: Float[Array, ""]) -> Float[Array, ""]:
    """Time [s] of a minimum-jerk shift in which neither the trunk's centre nor a point 0.4 m off accelerates more [m/s^2]."""
    way = norm_safe(end[:3] - start[:3]) + 0.4 * norm_safe(end[3:] - start[3:])
    return sqrt_safe(PEAK * way / acceleration)
