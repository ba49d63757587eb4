import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxleg import numerics

RNG = np.random.default_rng(0)


def spd(n, *batch):
    a = RNG.normal(size=(*batch, n, n))
    return a @ np.swapaxes(a, -1, -2) + np.eye(n)


@pytest.mark.parametrize("x", [-1.0, 0.0, 4.0])
def test_sqrt_safe_and_its_gradient(x):
    value, slope = jax.jit(jax.value_and_grad(numerics.sqrt_safe))(x)
    assert_allclose((value, slope), (2.0, 0.25) if x > 0 else (0.0, 0.0))


def test_norm_safe_has_zero_gradient_at_the_origin():
    assert_allclose(jax.jit(jax.grad(numerics.norm_safe))(np.zeros(3)), 0.0)
    x = RNG.normal(size=(5, 3))
    assert_allclose(jax.jit(numerics.norm_safe)(x), np.linalg.norm(x, axis=-1))


@pytest.mark.parametrize(("count", "wanted"), [(2, [3, 1]), (4, [3, 1, 0, 2]), (6, [3, 1, 0, 2, 0, 0])])
def test_the_highest_come_first_and_where_there_are_fewer_none_fills_up(count, wanted):
    values = jnp.array([0.5, 2.0, -1.0, 7.0])
    best, index = numerics.highest(values, count)
    assert index.tolist() == wanted
    assert_allclose(best, [*np.sort(values)[::-1][:count], *[-np.inf] * (count - 4)])


def test_smoothstep_rests_at_both_ends():
    step = jax.jit(numerics.smoothstep)
    assert_allclose(step(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])), [0.0, 0.0, 0.5, 1.0, 1.0])
    slope = jax.grad(numerics.smoothstep)
    for derivative in (jax.jit(slope), jax.jit(jax.grad(slope))):
        assert_allclose([derivative(1e-9), derivative(1.0 - 1e-9)], 0.0, atol=1e-6)
    assert np.all(np.diff(step(np.linspace(0.0, 1.0, 50))) > 0)


@pytest.mark.parametrize(
    ("ours", "numpys", "shapes"),
    [
        (numerics.cross, np.cross, [(7, 3), (7, 3)]),
        (numerics.cross, np.cross, [(3,), (3,)]),
        (numerics.dot, lambda a, b: np.einsum("...i,...i", a, b), [(7, 4), (4,)]),
        (numerics.matvec, lambda a, x: np.einsum("...ij,...j->...i", a, x), [(4, 6, 3), (3,)]),
        (numerics.matmul, np.matmul, [(4, 6, 3), (4, 3, 2)]),
        (numerics.inverse3, np.linalg.inv, [(7, 3, 3)]),
        (numerics.inverse3_safe, np.linalg.inv, [(7, 3, 3)]),
    ],
)
def test_small_linear_algebra_is_numpys(ours, numpys, shapes):
    arrays = [RNG.normal(size=shape) for shape in shapes]
    assert_allclose(jax.jit(ours)(*arrays), numpys(*arrays), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("scale", [0.0, 1e-4, -1e-4])
def test_inverse3_safe_is_finite_with_gradient_where_singular(scale):
    a = np.diag([1.0, 1.0, scale])
    inverse = np.asarray(jax.jit(numerics.inverse3_safe)(a))
    assert np.all(np.isfinite(inverse))
    assert np.all(np.isfinite(jax.jit(jax.jacobian(numerics.inverse3_safe))(a)))
    if scale:
        assert_allclose(inverse, np.linalg.inv(a))


def test_solve_spd6_is_numpys():
    a, b = spd(6), RNG.normal(size=6)
    assert_allclose(jax.jit(numerics.solve_spd6)(a, b), np.linalg.solve(a, b), rtol=1e-9)


def test_solve_block_arrow_is_the_dense_solution():
    dense, rhs = spd(18), RNG.normal(size=18)
    for i in range(4):
        for j in set(range(4)) - {i}:
            dense[6 + 3 * i : 9 + 3 * i, 6 + 3 * j : 9 + 3 * j] = 0.0
    dense += 20.0 * np.eye(18)
    legs = np.stack([dense[k : k + 3, k : k + 3] for k in (6, 9, 12, 15)])
    coupling = dense[:6, 6:].reshape(6, 4, 3).swapaxes(0, 1)
    parts = (dense[:6, :6], coupling, legs, rhs[:6], rhs[6:].reshape(4, 3))
    x, y = jax.jit(numerics.solve_block_arrow)(*parts)
    assert_allclose(np.concatenate([x, np.ravel(y)]), np.linalg.solve(dense, rhs), rtol=1e-9)


def test_a_sum_of_many_ticks_in_single_precision_loses_no_time():
    """Against the exact product; a plain float32 sum of these ticks is 1491 s."""
    tick, count = jnp.float32(0.0025), 600_000

    def onward(_, sums):
        return numerics.add_exactly(*sums, {"time": tick, "power": jnp.float32([0.1, 40.0])})

    none = {"time": jnp.float32(0.0), "power": jnp.zeros(2, jnp.float32)}
    total, _ = jax.jit(lambda: jax.lax.fori_loop(0, count, onward, (none, none)))()
    assert_allclose(total["time"], 1500.0, rtol=1e-7)
    assert_allclose(total["power"], np.float64(np.float32([0.1, 40.0])) * count, rtol=1e-7)
    plain = jax.jit(lambda: jax.lax.fori_loop(0, count, lambda _, t: t + tick, jnp.float32(0.0)))()
    assert plain < 1492.0


def test_the_gradient_of_an_exact_sum_is_a_plain_sums():
    def total(x):
        return jax.lax.scan(lambda sums, y: (numerics.add_exactly(*sums, y**2), None), (0.0 * x[0], 0.0 * x[0]), x)[0][0]

    x = RNG.normal(size=8)
    assert_allclose(jax.jit(jax.grad(total))(x), 2.0 * x, rtol=1e-12)


def test_a_part_computes_and_differentiates_as_the_function_itself():
    def function(x):
        part = jnp.sin(x) * x
        return part, jnp.cos(part)

    def slope(f):
        return jax.jit(jax.vmap(jax.grad(lambda x: jnp.sum(f(x)[0] * f(x)[1]))))

    x = np.linspace(0.1, 2.0, 6).reshape(2, 3)
    assert_allclose(slope(numerics.apart(function))(x), slope(function)(x), rtol=1e-12)
    compiled = jax.jit(numerics.apart(function)).lower(x).compile().as_text()
    assert " call(" in compiled or jax.default_backend() != "cpu"
