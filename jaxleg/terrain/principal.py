"""Principal component analysis of points in space: their normal and how much they vary along it."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.numerics import cross, dot, matvec, norm_safe

TINY = 1e-6  # of the trace's square: where two axes are as short as each other, a normal has no derivative


def normal_and_variation(
    covariance: Float[Array, "3 3"],
) -> tuple[Float[Array, "3"], Float[Array, ""]]:
    """Unit eigenvector (upward) of the least eigenvalue l0, and the surface variation l0 / (l0 + l1 + l2), of a covariance.

    The eigenvector comes from closed form without a gradient and is then corrected twice by a Newton step, which has the
    exact first derivative: `eigh` has none (NaN) where the other two eigenvalues agree, as on level ground. Where l0 and l1
    agree any vector of their plane is right; its gradient is 0. No points or all in one: NaN-free, of no meaning.
    """
    trace = jnp.trace(covariance)
    scaled = covariance / jnp.where(trace > 0.0, trace, 1.0)
    normal = _corrected(scaled, jax.lax.stop_gradient(_corrected(scaled, _closed_form(jax.lax.stop_gradient(scaled)))))
    normal = jnp.where(normal[2] < 0.0, -normal, normal)
    return normal, jnp.maximum(dot(normal, matvec(scaled, normal)), 0.0)


def _closed_form(a: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Eigenvector of the least eigenvalue of a symmetric matrix of trace 1.

    By the cubic's root that stands apart from the other two, the least or the greatest, whose axis alone is well defined; from
    the greatest's axis on, by the 2x2 problem in the plane square to it.
    """
    identity = jnp.eye(3, dtype=a.dtype)
    deviation = a - identity / 3.0
    p = jnp.sqrt(jnp.sum(deviation**2) / 6.0)
    b = deviation / jnp.where(p > 0.0, p, 1.0)
    half = jnp.clip(0.5 * dot(b[0], cross(b[1], b[2])), -1.0, 1.0)
    greatest = half >= 0.0
    root = 2.0 * p * jnp.cos(jnp.arccos(half) / 3.0 + jnp.where(greatest, 0.0, 2.0 * jnp.pi / 3.0))
    axis = _kernel(deviation - root * identity)
    along, across = _square_to(axis)
    image = matvec(a, along)
    turn = 0.5 * jnp.arctan2(2.0 * dot(across, image), dot(along, image) - dot(across, matvec(a, across)))
    return jnp.where(greatest, jnp.cos(turn) * across - jnp.sin(turn) * along, axis)


def _kernel(a: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Unit vector that a symmetric matrix of rank 2 takes to 0: the longest cross product of its rows; up if all are 0."""
    vectors = jnp.stack([cross(a[0], a[1]), cross(a[1], a[2]), cross(a[2], a[0])])
    squares = jnp.sum(vectors**2, axis=1)
    vector = jnp.where(squares[0] >= jnp.maximum(squares[1], squares[2]), vectors[0], vectors[2])
    vector = jnp.where(squares[1] > jnp.maximum(squares[0], squares[2]), vectors[1], vector)
    length = norm_safe(vector)
    return jnp.where(length > 0.0, vector / jnp.where(length > 0.0, length, 1.0), jnp.array([0.0, 0.0, 1.0], a.dtype))


def _corrected(a: Float[Array, "3 3"], vector: Float[Array, "3"]) -> Float[Array, "3"]:
    """A Newton step of a unit vector towards the eigenvector near it, within the plane square to it."""
    along, across = _square_to(vector)
    image = matvec(a, vector)
    value = dot(vector, image)
    aa, bb = dot(along, matvec(a, along)) - value, dot(across, matvec(a, across)) - value
    ab = dot(along, matvec(a, across))
    determinant = aa * bb - ab * ab
    defined = determinant > TINY
    determinant = jnp.where(defined, determinant, 1.0)
    u, v = dot(along, image), dot(across, image)
    step = ((bb * u - ab * v) * along + (aa * v - ab * u) * across) / determinant
    moved = vector - jnp.where(defined, step, 0.0)
    return moved / norm_safe(moved)


def _square_to(vector: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
    """Two unit vectors square to a unit vector and to each other (Duff et al. 2017)."""
    x, y, z = vector
    sign = jnp.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return jnp.stack([1.0 + sign * x * x * a, sign * b, -sign * x]), jnp.stack([b, sign + y * y * a, -y])
