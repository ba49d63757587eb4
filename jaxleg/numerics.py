"""Gradient-safe numerics and the small linear algebra that the dynamics needs.

Everything here is elementwise on small arrays, so that a `vmap` over thousands of lanes stays vectorised: XLA's batched
LAPACK calls on 3x3 and 6x6 systems are several times slower. Functions with a `_safe` suffix have finite gradients at
their singular point (the double-`where` idiom); each has a test there.
"""

import contextlib
import enum
import functools
from collections.abc import Callable, Generator
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int, Shaped

Tree = TypeVar("Tree")


class Code(enum.IntEnum):
    """A code held by int32 arrays. JAX takes a member of a plain `IntEnum` for an int64; these take the array's width."""

    def __jax_array__(self) -> Array:
        return jnp.asarray(int(self))


@contextlib.contextmanager
def foreign() -> Generator[None, None, None]:
    """Context for others' code (MJX, optax), which promotes ranks and dtypes silently as it likes; ours says what it does."""
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        yield


def apart(function: Callable[..., Tree]) -> Callable[..., Tree]:
    """The function as a part that XLA compiles by itself, whatever is mapped over it or differentiates it.

    On a processor XLA fuses what has many users into each of them: a chain of small operations is worked out, and compiled,
    again for every result. Other devices' compilers weigh that themselves, and may know no calls.
    """
    part = jax.jit(function)

    def call(*arguments):
        if jax.default_backend() != "cpu":
            return function(*arguments)
        with set_xla_metadata(inlineable="false"):
            return part(*arguments)

    return functools.wraps(function)(call)


def select(yes: Bool[Array, ""], new: Tree, old: Tree) -> Tree:
    """One of two trees of arrays, leaf by leaf; both are computed."""
    return jax.tree.map(lambda a, b: jnp.where(yes, a, b), new, old)


def highest(values: Float[Array, "n"], count: int) -> tuple[Float[Array, "k"], Int[Array, "k"]]:
    """The `count` highest values, best first, and their indices; where there are fewer, -inf at index 0 fills up."""
    kept = min(count, values.shape[0])
    best, index = jax.lax.top_k(values, kept)
    return jnp.pad(best, (0, count - kept), constant_values=-jnp.inf), jnp.pad(index, (0, count - kept))


def sqrt_safe(x: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Square root of max(x, 0), with gradient 0 instead of infinity where x <= 0."""
    positive = x > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, x, 1.0)), 0.0)


def norm_safe(x: Float[Array, "*n k"], axis: int = -1) -> Float[Array, "*m"]:
    """Euclidean norm over an axis, with gradient 0 at the origin."""
    return sqrt_safe(jnp.sum(x * x, axis=axis))


def smoothstep(x: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """Quintic step from 0 (x <= 0) to 1 (x >= 1) with zero first and second derivative at both ends (minimum jerk)."""
    x = jnp.clip(x, 0.0, 1.0)
    return x * x * x * (10.0 + x * (-15.0 + 6.0 * x))


def smooth_ramp(x: Float[ArrayLike, "*n"], width: Float[ArrayLike, "*n"]) -> Float[Array, "*n"]:
    """max(x, 0) with its corner rounded between -width and width: the integral of `smoothstep`, exact beyond."""
    x = jnp.asarray(x)
    share = jnp.clip(0.5 * (x / width + 1.0), 0.0, 1.0)
    return jnp.maximum(x - width, 0.0) + 2.0 * width * share**4 * (2.5 + share * (share - 3.0))


def add_exactly(total: Tree, lost: Tree, amount: Tree) -> tuple[Tree, Tree]:
    """Running sums and what rounding has added to them, with amounts more (Kahan 1965); the gradient is a plain sum's.

    Without it a small amount that comes again and again is rounded the same way every time: 600,000 ticks of 2.5 ms in
    single precision are 1491 s.
    """
    amount = jax.tree.map(jnp.subtract, amount, lost)
    after = jax.tree.map(jnp.add, total, amount)
    rounded = jax.tree.map(lambda new, old, more: jax.lax.stop_gradient((new - old) - more), after, total, amount)
    return after, rounded


def cross(a: Float[Array, "*n 3"], b: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """Cross product over the last axis, from turned components: half the operations of writing it out."""
    return _next(a * _next(b) - _next(a) * b)


def cross_matrix(a: Float[Array, "*n 3"]) -> Float[Array, "*n 3 3"]:
    """The matrix whose product with b is a x b."""
    shape = (*a.shape, 3)
    return cross(jnp.broadcast_to(jnp.eye(3, dtype=a.dtype), shape), jnp.broadcast_to(a[..., None, :], shape))


def _next(x, axis=-1):
    """Components 1, 2, 0 of three."""
    first, later = jnp.split(x, [1], axis=axis)
    return jnp.concatenate([later, first], axis=axis)


def of_one_rank(a: Shaped[Array, "*n"], b: Shaped[Array, "*m"]) -> tuple[Shaped[Array, "*n2"], Shaped[Array, "*m2"]]:
    """Both with as many axes: leading ones of length 1 for the one that has fewer, which NumPy would add silently."""
    rank = max(a.ndim, b.ndim)
    return jax.lax.broadcast_to_rank(a, rank), jax.lax.broadcast_to_rank(b, rank)


def dot(a: Float[Array, "*n k"], b: Float[Array, "*m k"]) -> Float[Array, "*o"]:
    """Inner product over the last axis."""
    a, b = of_one_rank(a, b)
    return jnp.sum(a * b, axis=-1)


def matvec(a: Float[Array, "*n i k"], x: Float[Array, "*m k"]) -> Float[Array, "*o i"]:
    """Matrix times vector over the last axes, as products and sums."""
    a, x = of_one_rank(a, x[..., None, :])
    return jnp.sum(a * x, axis=-1)


def matmul(a: Float[Array, "*n i k"], b: Float[Array, "*m k j"]) -> Float[Array, "*o i j"]:
    """Matrix product over the last axes, as products and sums."""
    a, b = of_one_rank(a[..., :, :, None], b[..., None, :, :])
    return jnp.sum(a * b, axis=-2)


def inverse3(a: Float[Array, "*n 3 3"]) -> Float[Array, "*n 3 3"]:
    """Inverse of a 3x3 matrix by cofactors. Not finite for a singular matrix."""
    adjugate, determinant = _cofactors(a)
    return adjugate / determinant


def inverse3_safe(a: Float[Array, "*n 3 3"], least: float = 1e-6) -> Float[Array, "*n 3 3"]:
    """`inverse3` with the determinant kept at or beyond +-`least`: large but finite for a singular matrix."""
    adjugate, determinant = _cofactors(a)
    return adjugate / away_from_zero(determinant, least)


def away_from_zero(x: Float[Array, "*n"], least: float = 1e-6) -> Float[Array, "*n"]:
    """A divisor, kept at or beyond +-`least`."""
    floor = jnp.where(x < 0.0, -least, least).astype(x.dtype)
    return jnp.where(jnp.abs(x) < least, floor, x)


def _cofactors(a):
    following = _next(a, axis=-2)
    rows = cross(following, _next(following, axis=-2))
    return jnp.swapaxes(rows, -1, -2), dot(a[..., 0, :], rows[..., 0, :])[..., None, None]


def solve_spd6(a: Float[Array, "6 6"], b: Float[Array, "6"]) -> Float[Array, "6"]:
    """Solve a x = b for a symmetric positive definite 6x6 matrix by elimination of its upper 3x3 block.

    A tenth of the operations of an unrolled Cholesky factorisation, which is what compilation time counts.
    """
    inverse = inverse3(a[:3, :3])
    gain = matmul(inverse, a[:3, 3:])
    schur = a[3:, 3:] - matmul(a[3:, :3], gain)
    lower = matvec(inverse3(schur), b[3:] - matvec(gain.T, b[:3]))
    return jnp.concatenate([matvec(inverse, b[:3]) - matvec(gain, lower), lower])


def solve_block_arrow(
    trunk: Float[Array, "6 6"],
    coupling: Float[Array, "leg 6 3"],
    legs: Float[Array, "leg 3 3"],
    trunk_rhs: Float[Array, "6"],
    leg_rhs: Float[Array, "leg 3"],
) -> tuple[Float[Array, "6"], Float[Array, "leg 3"]]:
    """Solve the arrow-shaped system of a floating trunk with legs that couple only through it.

    [ trunk   C_1 ... C_n ] [x]   [ trunk_rhs ]
    [ C_i^T   L_i         ] [y] = [ leg_rhs_i ]

    by the Schur complement S = trunk - sum_i C_i L_i^-1 C_i^T: one 3x3 inverse a leg and one 6x6 factorisation.
    """
    gain = matmul(coupling, inverse3(legs))
    schur = trunk - jnp.sum(matmul(gain, jnp.swapaxes(coupling, -1, -2)), axis=0)
    x = solve_spd6(schur, trunk_rhs - jnp.sum(matvec(gain, leg_rhs), axis=0))
    return x, matvec(inverse3(legs), leg_rhs - matvec(jnp.swapaxes(coupling, -1, -2), x))
