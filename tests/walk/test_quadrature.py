"""The integral of power over phases, against scipy's of the same torques and speeds."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from jaxleg.gait.order import SHIFT
from jaxleg.leg.energy import Power
from jaxleg.walk.data import Walk
from jaxleg.walk.quadrature import energy_of, nodes_of, pieces_of
from jaxleg.walk.reference import Instant

LEGS = (SHIFT, 3, 1, SHIFT)
DURATION = np.array([1.5, 0.7, 0.9, 1.1])
LIFT, LOAD = np.array([0.0, 0.05, 0.2, 0.0]), 0.1
USED = np.array([True, True, True, False])


def walk_of(**numbers):
    """A walk of which nothing is known but these."""
    walk = object.__new__(Walk)
    for name, value in numbers.items():
        object.__setattr__(walk, name, value)
    return walk


WALK = walk_of(
    legs=LEGS,
    load_share=jnp.asarray(LOAD),
    used=jnp.asarray(USED),
    phases=SimpleNamespace(duration=jnp.asarray(DURATION), flight=SimpleNamespace(lift=jnp.asarray(LIFT))),
)


def torque(share):
    return 20.0 + 9.0 * np.sin(3.0 * share)


def speed(share):
    """Turns round in each phase."""
    return 0.8 * np.cos(4.0 * share + 0.4)


def integral(power):
    return sum(d * quad(lambda s: power(torque(s), speed(s)), 0.0, 1.0, limit=200)[0] for d in DURATION[USED])


@pytest.fixture(scope="module")
def found(pegasus):
    pieces = pieces_of(WALK)
    share = jnp.concatenate([nodes_of(some) for some in pieces])
    values = (jnp.tile(f(share), (4, 3, 1)) for f in (torque, speed))
    at = Instant(**dict.fromkeys(Instant._fields))._replace(**dict(zip(("torque", "velocity"), values)))
    return energy_of(pegasus, WALK, pieces, at)


def test_energy_is_scipys_integral_of_power_kinks_and_all(found):
    by_hand = Power(
        integral(lambda t, v: t * v),
        integral(lambda t, v: max(t * v, 0.0)),
        integral(lambda t, v: (t / (0.217 * 44.5)) ** 2 * 2.28),
    )
    for seen, wanted in zip(found, by_hand):
        assert_allclose(seen, np.full((4, 3), wanted), rtol=1e-3)


def test_pieces_fill_each_phase_and_end_where_its_motion_changes():
    """A swing's: load off until a tenth of it, straight up for a fifth of the rest, and the same in reverse."""
    pieces = pieces_of(WALK)
    for phase, inner in enumerate(([0.5], [0.1, 0.14, 0.5, 0.86, 0.9], [0.1, 0.26, 0.5, 0.74, 0.9], [0.5])):
        spans = [
            (float(s), float(s + w))
            for some in pieces
            for p, s, w in zip(some.phase, some.start, some.width, strict=True)
            if p == phase
        ]
        assert_allclose(sorted(spans), list(zip([0.0, *inner], [*inner, 1.0])), atol=1e-12)
