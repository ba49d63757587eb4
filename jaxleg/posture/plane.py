"""The trunk parallel to the plane of the feet, its centre of mass over the triangles. Paper C, 3.1: (21), Fig. 4 (C10, C11)."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEG_END
from jaxleg.gait.params import GaitParams
from jaxleg.gait.support import CogRule, cog_point
from jaxleg.numerics import inverse3_safe, matvec
from jaxleg.posture.body import com_offset
from jaxleg.pytree import pytree
from jaxleg.robot import Robot
from jaxleg.rotations import turned


@pytree
class Plane:
    """How the trunk is held over the feet; every field but the rule's name a leaf."""

    cog: CogRule
    # Weight of the flying foot's target in the plane that the trunk is parallel to: 0 is paper C's three standing feet. On
    # rough ground these tilt the trunk to and fro with every step, the plane of all four (1) does not.
    target_weight: Float[Array, "*batch"]
    levelling: Float[Array, "*batch"]  # part of the plane's tilt that the trunk does not follow; 0 is paper C's

    shared = False  # each swing has its own pose
    lowering = "none"  # heights are chosen, not cut back

    def swing(
        self,
        robot: Robot,
        gait: GaitParams,
        before: Float[Array, "leg 3"],
        after: Float[Array, "leg 3"],
        leg: Int[Array, ""],
        adjust: Float[Array, "3"],
        yaw: Float[Array, ""],
    ) -> Float[Array, "6"]:
        """Trunk pose for a swing of `leg`; `adjust` is its height over H_COG above the plane [m], then pitch and roll beyond
        the plane's [rad]. The pose's yaw is within a half turn of `yaw` [rad].

        Paper C's five steps: plane of the feet, point of the centre of gravity, height over it, yaw from the feet with the
        target, roll and pitch with the plane. The point is that of the centre of mass, legs included (reading, as A12), less
        L_F2H along the yaw (paper A's; C has none).
        """
        plane = support_plane(after, jnp.where(jnp.arange(4) == leg, self.target_weight, 1.0))
        return self._over(robot, gait, after, plane, cog_point(self.cog, before, after, leg), adjust, yaw)

    def sketch(self, gait: GaitParams, before, after, leg, yaw) -> Float[Array, "6"]:
        """The pose of `swing`, the default's, as if the centre of mass were the trunk's centre: no legs' masses needed."""
        plane = support_plane(after, jnp.where(jnp.arange(4) == leg, self.target_weight, 1.0))
        at, point = self._at(gait, after, plane, jnp.zeros(3, after.dtype), yaw), cog_point(self.cog, before, after, leg)
        return at(point)

    def stand(self, robot: Robot, gait: GaitParams, feet: Float[Array, "leg 3"], yaw: Float[Array, ""]) -> Float[Array, "6"]:
        """Trunk pose of standing on four feet, the centre of mass over their middle."""
        plane = support_plane(feet, jnp.ones(4, feet.dtype))
        return self._over(robot, gait, feet, plane, jnp.mean(feet[:, :2], axis=0), jnp.zeros(3, feet.dtype), yaw)

    def settle(self, poses: Float[Array, "pose 6"]) -> Float[Array, "pose 6"]:
        """The poses of a walk, as they are."""
        return poses

    def _over(self, robot, gait, feet, plane, point, adjust, near) -> Float[Array, "6"]:
        """The pose with its centre of mass over a point: two passes, because the legs' masses move with the trunk."""
        at = self._at(gait, feet, plane, adjust, near)
        pose = at(point)
        for _ in range(2):
            pose = at(point - com_offset(robot, pose, feet)[:2])
        return pose

    def _at(self, gait, feet, plane, adjust, near):
        """The pose whose trunk is less L_F2H over a point, as a function of that point."""
        yaw = feet_yaw(feet, near)
        turn = jnp.append((1.0 - self.levelling) * plane_turn(plane, yaw) + adjust[1:], yaw)
        ahead = turned(jnp.stack([-gait.foot_offset, jnp.zeros_like(yaw)]), yaw)

        def at(point):
            xy = point + ahead
            height = plane_height(plane, xy) + gait.workspace.high + adjust[0]
            return jnp.concatenate([xy, height[None], turn])

        return at


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
