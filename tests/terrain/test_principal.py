"""Normal and surface variation against `eigh`; derivatives where eigenvalues agree."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.terrain.principal import normal_and_variation

compute = jax.jit(jax.vmap(normal_and_variation))


def turned(values, seed=0):
    """Covariances of given eigenvalues in random directions."""
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(len(values), 3, 3)))[0]
    return np.einsum("nij,nj,nkj->nik", q, np.asarray(values, float), q)


def plain(covariance):
    values, vectors = np.linalg.eigh(covariance)
    normal = vectors[:, :, 0] * np.sign(vectors[:, 2:, 0])
    return normal, values[:, 0] / values.sum(axis=1)


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-12), ("float32", 2e-6)])
def test_against_eigh(dtype, tolerance):
    rng = np.random.default_rng(1)
    values = np.sort(rng.uniform(size=(200, 3)), axis=1) + np.array([0.0, 0.1, 0.2])
    values[:50, 0] = 0.0  # a plane
    values[50:100, 2] = values[50:100, 1]  # as on level ground: the two long axes agree
    covariance = (turned(values) * 10.0 ** rng.uniform(-6, 6, 200)[:, None, None]).astype(dtype)
    normal, variation = plain(covariance.astype(float))
    ours = compute(covariance)
    np.testing.assert_allclose(ours[0], normal, atol=10 * tolerance)
    np.testing.assert_allclose(ours[1], variation, atol=tolerance)


def test_equal_short_axes_have_a_variation_and_some_normal_square_to_the_long_one():
    ours, variation = compute(turned([[0.1, 0.1, 0.8], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]]))
    long = np.linalg.eigh(turned([[0.1, 0.1, 0.8], [0.0, 0.0, 1.0]]))[1][:, :, 2]
    np.testing.assert_allclose(variation, [0.1, 0.0, 1 / 3, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.sum(ours[:2] * long, axis=1), 0.0, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), 1.0, atol=1e-12)


@jax.jit
def derivatives(covariance, direction):
    """Along a direction: forward and reverse mode; the gradient, the value."""

    def total(a):
        normal, variation = normal_and_variation(a)
        return jnp.sum(normal * jnp.array([0.3, -0.5, 0.7])) + 2.0 * variation

    gradient = jax.grad(total)(covariance)
    return jax.jvp(total, (covariance,), (direction,))[1], jnp.sum(gradient * direction), gradient, total(covariance)


def test_derivatives():
    square = np.random.default_rng(2).normal(size=(3, 3))
    direction, step = square + square.T, 1e-6
    level = np.diag([1.0, 1.0, 0.0])  # where `eigh` has none
    for covariance in (*turned([[0.1, 0.5, 0.9], [0.2, 0.6, 0.6]]), level + 0.01 * np.diag([0, 0, 1.0])):
        forward, reverse, _, _ = derivatives(covariance, direction)
        ends = [derivatives(covariance + s * direction, direction)[3] for s in (step, -step)]
        np.testing.assert_allclose(reverse, forward, rtol=1e-10)
        np.testing.assert_allclose((ends[0] - ends[1]) / (2 * step), forward, rtol=1e-6)
    for covariance in (level, np.eye(3), np.zeros((3, 3)), np.diag([1.0, 0, 0])):
        assert np.all(np.isfinite(derivatives(covariance, direction)[2]))
