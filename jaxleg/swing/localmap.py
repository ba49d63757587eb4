"""What the swing planner believes about the ground in the plane of a step. Paper B, III.A and C.

Every obstacle of the paper is a set of columns below a curve, so known terrain, preset and predicted obstacles (13)-(16)
join into one curve by a maximum: a map of fixed size, whatever the foot has felt.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.numerics import sqrt_safe
from jaxleg.swing.profile import Profile, height


class LocalMap(NamedTuple):
    """Believed height of the ground at equally spaced points of the step; NaN = unseen."""

    ground: Float[Array, "*batch point"]
    start: Float[Array, "*batch"]  # x of the first point
    spacing: Float[Array, "*batch"]


def points(local: LocalMap) -> Float[Array, "point"]:
    """x of the map's points."""
    return local.start + local.spacing * jnp.arange(local.ground.shape[-1], dtype=local.ground.dtype)


def sampled(profile: Profile, start: Float[ArrayLike, ""], end: Float[ArrayLike, ""], count: int) -> LocalMap:
    """The map of a known terrain profile."""
    dtype = profile.coefficients.dtype
    start, end = jnp.asarray(start, dtype), jnp.asarray(end, dtype)
    local = LocalMap(jnp.zeros(count, dtype), start, (end - start) / (count - 1))
    return local._replace(ground=height(profile, points(local)))


def believed_height(local: LocalMap, x: Float[ArrayLike, ""]) -> Float[Array, ""]:
    """Believed height at x, linear between the points."""
    return jnp.interp(jnp.asarray(x), points(local), local.ground)


def with_block(local: LocalMap, left: Float[ArrayLike, ""], right: Float[ArrayLike, ""], top: Float[ArrayLike, ""]) -> LocalMap:
    """A block of all columns between two places joined in: T_init (B, (13)), which keeps a swing off level ground."""
    x = points(local)
    return _joined(local, jnp.where((x >= left) & (x <= right), top, -jnp.inf))


def with_flat_patch(local: LocalMap, at: Float[Array, "2"], half_width: Float[ArrayLike, ""]) -> LocalMap:
    """T_pre of case 3 (B, (14), (15)): as high as the collision round about it; the column below it is closed."""
    return _joined(local, jnp.where(_round(local, at, half_width), at[1], -jnp.inf))


def with_ramp(local: LocalMap, at: Float[Array, "2"], half_width: Float[ArrayLike, ""], ramp: Float[ArrayLike, ""]) -> LocalMap:
    """T_pre of case 4 (B, (16), (15)) with slope `ramp` = tan(theta_pre), its sign that of the felt slope.

    The printed z <= tan(theta_pre) x - x_c + z_c is a misprint for tan(theta_pre) (x - x_c) + z_c.
    """
    return _joined(local, jnp.where(_round(local, at, half_width), at[1] + ramp * (points(local) - at[0]), -jnp.inf))


def with_felt_error(local: LocalMap, at: Float[Array, "2"], reach: Float[ArrayLike, ""]) -> LocalMap:
    """The map raised to what was felt: by all of the error at the collision, by ever less up to `reach` from it (not in B)."""
    error = jnp.maximum(at[1] - believed_height(local, at[0]), 0.0)
    share = jnp.clip(1.0 - jnp.abs(points(local) - at[0]) / reach, 0.0, 1.0)
    return local._replace(ground=local.ground + error * share)


def widened(local: LocalMap, distance: Float[ArrayLike, ""], window: int) -> Float[Array, "point"]:
    """Least height at each point that keeps `distance` from the map's points, at most `window` of them to either side; those
    unseen ask for none, -inf where there are no others."""
    offset = jnp.arange(-window, window + 1, dtype=local.spacing.dtype) * local.spacing
    rise = distance**2 - offset**2
    lift = jnp.where(rise >= 0.0, sqrt_safe(jnp.asarray(rise)), -jnp.inf)
    seen = jnp.where(jnp.isnan(local.ground), -jnp.inf, local.ground)
    near = jnp.pad(seen, window, constant_values=-jnp.inf)
    shifted = [jax.lax.slice_in_dim(near, k, k + local.ground.shape[0]) for k in range(2 * window + 1)]
    return jnp.max(jnp.stack(shifted) + lift[:, None], axis=0)


def _round(local, at, half_width):
    nearest = jnp.maximum(half_width, 0.5 * local.spacing)  # at least the column of the collision
    return jnp.abs(points(local) - at[0]) <= nearest


def _joined(local, obstacle):
    return local._replace(ground=jnp.maximum(local.ground, obstacle))
