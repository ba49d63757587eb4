"""Gradients of a swing with its branches held: forward, reverse and central differences of the exact machine."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.swing.blind import blind_swing
from jaxleg.swing.machine import Mode, Step, printed
from jaxleg.swing.profile import natural_spline
from jaxleg.swing.replay import course_of, replay

SEGMENTS, LANES = 12, 40


def of(vector, heights):
    """Machine, step and terrain from gamma_H, l_back, the target's x and four knots."""
    machine = dataclasses.replace(printed(), height_share=vector[0], back=vector[1])
    step = Step(jnp.array([0.0, 3.0]), jnp.stack([vector[2], jnp.asarray(3.0)]))
    return machine, step, natural_spline(heights.at[5:9].add(vector[3:]))


@pytest.mark.slow  # long to compile
def test_forward_reverse_and_central_differences_agree():
    heights = jnp.asarray(np.random.default_rng(3).uniform(2.2, 4.6, (LANES, 15))).at[:, 0].set(3.0)
    vector = jnp.array([0.3, 0.5, 8.0, 0.0, 0.0, 0.0, 0.0])
    courses = jax.jit(jax.vmap(lambda h: course_of(*of(vector, h), SEGMENTS)))(heights)

    def length(x, h, course):
        return replay(*of(x, h), course)[0]

    forward = jax.jit(jax.vmap(jax.jacfwd(length), in_axes=(None, 0, 0)))(vector, heights, courses)
    reverse = jax.jit(jax.vmap(jax.grad(length), in_axes=(None, 0, 0)))(vector, heights, courses)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-9)

    swings = jax.jit(jax.vmap(lambda x, h: blind_swing(*of(x, h)), in_axes=(None, 0)))
    same = jax.jit(jax.vmap(lambda x, h: course_of(*of(x, h), SEGMENTS), in_axes=(None, 0)))
    now, replayed = swings(vector, heights), jax.vmap(lambda h, c: length(vector, h, c))(heights, courses)
    np.testing.assert_allclose(replayed, now.length, rtol=1e-6)
    assert np.sum(now.adjustments > 0) > 10

    nudge = 1e-5 * np.eye(len(vector))
    along = jax.jit(jax.vmap(lambda x: jax.vmap(lambda h, c: length(x, h, c))(heights, courses)))
    held = (along(vector[None] + nudge) - along(vector[None] - nudge)).T / 2e-5
    np.testing.assert_allclose(forward, held, rtol=1e-6, atol=1e-6)

    checked, step = 0, 1e-4  # and the exact machine, whose contacts are good to 1e-7, as long as its branches stay
    for k, unit in enumerate(np.eye(len(vector))):
        up, down = (swings(vector + sign * step * unit, heights) for sign in (1, -1))
        fixed = np.ones(LANES, bool)
        for sign in (1, -1):
            moved = same(vector + sign * step * unit, heights)
            fixed &= np.all((moved.mode == courses.mode) & (moved.hit == courses.hit), axis=1)
        difference = (up.length - down.length) / (2 * step)
        np.testing.assert_allclose(forward[fixed, k], difference[fixed], rtol=2e-3, atol=2e-2)
        checked += int(np.sum(fixed))
    assert checked > 0.9 * LANES * len(vector)
    assert np.all(now.exit != Mode.STALLED)


def test_gradients_are_finite_where_a_foot_stands_level():
    def gradient(x):
        course = course_of(*of(x, jnp.full(15, 3.0)), SEGMENTS)
        return jax.grad(lambda x: replay(*of(x, jnp.full(15, 3.0)), course)[0])(x)

    assert np.all(np.isfinite(jax.jit(gradient)(jnp.array([0.3, 0.5, 8.0, 0.0, 0.0, 0.0, 0.0]))))
