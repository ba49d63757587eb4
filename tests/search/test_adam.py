"""Adam: bounds, gradients through them, minibatches in turn, lanes that cannot be used, and that it goes down."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from numpy.testing import assert_allclose

from jaxleg.numerics import foreign
from jaxleg.search.adam import Adam, bounded, descend, free_gradient, make_optimiser, start, unbounded
from jaxleg.search.lanes import Setting
from jaxleg.search.training import Lanes
from tests.stand_ins import StandInLab

BOUNDS = np.array([[0.4, 0.6], [-0.2, 0.1], [0.3, 0.3]])  # the last one is held
TARGET = np.array([0.45, 0.0, 0.0])


class Bowl(StandInLab):
    """A lab whose objective is a bowl round `TARGET`, tilted by the terrain's number; lane 3 cannot be judged."""

    def __init__(self):
        super().__init__(seen=[])

    def proxy_gradients(self, vectors, site, setting):
        self.seen.append(np.asarray(site).tolist())
        spread = np.asarray(vectors) - TARGET
        gradient = 2.0 * spread + np.asarray(site)[:, None]
        gradient[np.asarray(site) == 3] = np.nan
        return SimpleNamespace(objective=np.sum(spread**2, axis=1) + np.asarray(site)), gradient


def lanes(number):
    return Lanes(np.arange(number), Setting(*(np.ones(number) for _ in range(3))))


def test_bounds_hold_and_come_back():
    free = np.array([[-50.0, 0.0, 7.0], [0.7, -1.3, 0.0]])
    inside = np.asarray(bounded(free, np.tile(BOUNDS, (2, 1, 1))))
    low, high = BOUNDS.T
    assert np.all((inside >= low) & (inside <= high))
    assert_allclose(inside[0], [0.4, -0.05, 0.3])
    assert_allclose(inside[1, 0], 0.4 + 0.2 / (1.0 + np.exp(-0.7)))
    assert_allclose(unbounded(inside[1], BOUNDS), [0.7, -1.3, 0.0], rtol=1e-9)


def test_a_start_near_a_bound_is_moved_off_it():
    at_the_edge = np.array([0.4, 0.1, 0.3])
    assert_allclose(bounded(unbounded(at_the_edge, BOUNDS), BOUNDS), [0.41, 0.085, 0.3])
    assert_allclose(bounded(unbounded(at_the_edge, BOUNDS, least=1e-3), BOUNDS), [0.4002, 0.0997, 0.3])


def test_the_gradient_passes_through_the_bounds():
    free = np.array([0.4, -2.0, 1.0])
    value = lambda x: jnp.sum(jnp.sin(5.0 * x))  # noqa: E731
    wanted = np.asarray(jax.jit(jax.grad(lambda f: value(bounded(f, BOUNDS))))(free))
    slope = jax.jit(jax.grad(value))(bounded(free, BOUNDS))
    assert_allclose(free_gradient(free, BOUNDS, slope), wanted, rtol=1e-12)
    assert wanted[2] == 0.0


def test_searches_start_at_what_is_known():
    """Two searches with three starts each: the known sets come first in either, the third is drawn."""
    known = np.array([[0.5, 0.0, 0.3], [0.55, -0.1, 0.3]])
    narrow = np.concatenate([[[0.48, 0.52]], BOUNDS[1:]])
    spans = np.concatenate([np.tile(BOUNDS, (3, 1, 1)), np.tile(narrow, (3, 1, 1))])
    state = start(jax.random.key(0), known, spans, 3, optax.adam(0.1))
    points = np.asarray(bounded(state.free, spans))
    assert_allclose(points[[0, 1]], known, atol=1e-12)
    assert_allclose(points[[3, 4]], [[0.5, 0.0, 0.3], [0.518, -0.1, 0.3]], atol=1e-12)  # as far as the band allows
    assert abs(points[2, 1] - points[5, 1]) > 1e-3  # each draws its own
    assert int(state.step) == 0


def test_terrains_are_seen_in_turn_by_every_run():
    bowl, spans, optimiser = Bowl(), jnp.asarray(np.tile(BOUNDS, (2, 1, 1))), make_optimiser(0.1, 10)
    state = start(jax.random.key(0), np.zeros((0, 3)), spans, 2, optimiser)
    for _ in range(3):
        state, _ = descend(bowl, lanes(5), spans, state, 2, optimiser)
    assert bowl.seen == [[0, 1, 0, 1], [2, 3, 2, 3], [4, 0, 4, 0]]
    bowl.seen.clear()
    descend(bowl, lanes(2), spans, state, 16, optimiser)
    assert [len(row) for row in bowl.seen] == [4]  # no more lanes than there are terrains


def test_a_step_is_adams_on_the_mean_over_the_lanes_that_can_be_used():
    """Adam's first step is the rate against the gradient's sign, whatever its size; the mean objective says what is lost."""
    bowl, spans, optimiser = Bowl(), jnp.asarray(BOUNDS[None]), make_optimiser(0.1, 10)
    free = np.array([[0.5, -1.0, 0.2]])
    begin = Adam(free, jax.jit(optimiser.init)(free), np.array(1, np.int32))
    after, objective = descend(bowl, lanes(4), spans, begin, 2, optimiser)
    assert bowl.seen == [[2, 3]]
    assert_allclose(np.subtract(after.free, begin.free), [[-0.1, -0.1, 0.0]], atol=1e-6)
    assert objective == np.inf
    assert int(after.step) == 2
    here = np.asarray(bounded(begin.free, spans))[0]
    begin = begin._replace(step=np.array(0, np.int32))
    _, objective = descend(bowl, lanes(4), spans, begin, 2, optimiser)
    assert_allclose(objective, [np.sum((here - TARGET) ** 2) + 0.5])
    mean = (2.0 * (here - TARGET) + 0.5)[None]
    slope = free_gradient(begin.free, spans, mean)
    with foreign():
        update, _ = jax.jit(optimiser.update)(slope, begin.moments)
    assert_allclose(update, [[-0.1, -0.1, 0.0]], atol=1e-6)


def test_it_finds_the_bottom_and_its_rate_falls_to_a_tenth():
    spans, optimiser = jnp.asarray(np.tile(BOUNDS, (3, 1, 1))), make_optimiser(0.2, 200)
    state = start(jax.random.key(1), np.zeros((0, 3)), spans, 3, optimiser)
    moved = []
    for _ in range(200):
        before = state.free
        state, _ = descend(Bowl(), lanes(1), spans, state, 1, optimiser)
        moved.append(np.max(np.abs(np.subtract(state.free, before))))
    assert_allclose(np.asarray(bounded(state.free, spans))[:, :2], np.tile(TARGET[:2], (3, 1)), atol=2e-3)
    assert moved[0] == pytest.approx(0.2, rel=1e-3)
    schedule = optax.cosine_decay_schedule(0.2, 200, 0.1)
    assert_allclose(jax.jit(schedule)(np.array([0.0, 100.0, 200.0])), [0.2, 0.11, 0.02], rtol=1e-6)
