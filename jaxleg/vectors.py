"""Vectors by their components, each an array of any shape.

What is worked out at many instants at once is written with these: every operation then runs along the instants, which lie
last and without a gap, while arrays with an innermost axis of three leave a processor's vector units empty.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxleg.pytree import pytree


@pytree
class Vector:
    """A vector (x, y, z), or as many as the components' shape says."""

    x: Float[Array, "*n"]
    y: Float[Array, "*n"]
    z: Float[Array, "*n"]

    def __add__(self, other: "Vector") -> "Vector":
        return Vector(self.x + other.x, self.y + other.y, self.z + other.z)

    def __sub__(self, other: "Vector") -> "Vector":
        return Vector(self.x - other.x, self.y - other.y, self.z - other.z)

    def __mul__(self, factor: Float[Array, "*n"]) -> "Vector":
        return Vector(self.x * factor, self.y * factor, self.z * factor)

    def dot(self, other: "Vector") -> Float[Array, "*n"]:
        """Inner product."""
        return self.x * other.x + self.y * other.y + self.z * other.z

    def cross(self, other: "Vector") -> "Vector":
        """Cross product, this vector first."""
        return Vector(
            self.y * other.z - self.z * other.y, self.z * other.x - self.x * other.z, self.x * other.y - self.y * other.x
        )

    def array(self) -> Float[Array, "3 *n"]:
        """The components along a first axis."""
        return jnp.stack([self.x, self.y, self.z])


@pytree
class Rows:
    """A matrix of three rows, or as many; a rotation's turned round is its inverse."""

    x: Vector
    y: Vector
    z: Vector

    def times(self, vector: Vector) -> Vector:
        """The matrix times a vector."""
        return Vector(self.x.dot(vector), self.y.dot(vector), self.z.dot(vector))

    def turned_round_times(self, vector: Vector) -> Vector:
        """The transposed matrix times a vector."""
        return self.x * vector.x + self.y * vector.y + self.z * vector.z


def parts(x: Float[Array, "k *n"]) -> list[Float[Array, "*n"]]:
    """The entries of the first axis; the gradient puts them together again in one piece."""
    return [jnp.squeeze(part, 0) for part in jnp.split(x, x.shape[0])]


def vector(x: Float[Array, "3 *n"]) -> Vector:
    """A vector of its components along a first axis."""
    return Vector(*parts(x))


def summed(vectors: Vector) -> Vector:
    """Sum over the first axis."""
    return jax.tree.map(lambda x: jnp.sum(x, axis=0), vectors)


def vectors(x: Float[Array, "k 3 *n"]) -> list[Vector]:
    """The vectors along the first axis, their components along the second."""
    return [vector(row) for row in parts(x)]
