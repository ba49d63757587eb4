"""The cascade of paper A, IV.B, against a plain search over all cells."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.plan import FootholdStatus
from jaxleg.planning.footholds import SearchRectangle, choose, feasible_score, soft_offset
from jaxleg.terrain import Grid, flat

CELLS, SIZE = (9, 2), 0.02
GRID = Grid(80, 50, SIZE, (-0.8, -0.5))
TERRAIN = flat(GRID)
NOMINAL = jnp.array([[0.34, 0.18], [0.24, -0.18], [-0.26, 0.18], [-0.36, -0.18]])


def rectangle(heading=0.0, w1=0.5):
    return SearchRectangle(*map(jnp.asarray, (0.30, 0.08, 0.08, w1, heading)))


@jax.jit
def chosen(valid, box):
    return choose(NOMINAL, valid, TERRAIN, box, CELLS)


def plain_cascade(valid, w1):
    """Brute force: every lattice cell in the order of preference, integers only."""
    cells = [(i, j) for i in range(-CELLS[0], CELLS[0] + 1) for j in range(-CELLS[1], CELLS[1] + 1)]
    cells.sort(key=lambda c: (-c[0], abs(c[1]), -c[1]))
    start = np.round((np.asarray(NOMINAL) - np.array(GRID.origin)) / SIZE).astype(int)

    def free(leg, cell):
        i, j = start[leg] + cell
        return valid[i, j]

    for half, length, status in ((7, 0.30, FootholdStatus.NOMINAL), (9, 0.38, FootholdStatus.WIDENED)):
        found = [c for c in cells if abs(c[0]) <= half and all(free(leg, c) for leg in range(4))]

        def score(c, length=length):
            manhattan = (abs(c[0]) + abs(c[1])) * SIZE / ((length + 0.08) / 2)
            return round(1 - w1 * manhattan - (1 - w1) * abs(c[1]) * SIZE / 0.04, 5)

        if found:
            best = max(found, key=score)  # max keeps the first of equals
            return [best] * 4, [status] * 4
    places, states = [], []
    for leg in range(4):
        found = [c for c in cells if free(leg, c)]
        places.append(min(found, key=lambda c: c[0] ** 2 + c[1] ** 2) if found else None)
        states.append(FootholdStatus.NEAREST if found else FootholdStatus.NONE)
    return places, states


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.6, 0.9])
def test_the_cascade_is_the_plain_search(share):
    rng = np.random.default_rng(int(100 * share))
    seen = set()
    for _ in range(60):
        valid, w1 = rng.random((GRID.nx, GRID.ny)) < share, rng.choice([0.3, 0.5, 0.8])
        ours = chosen(jnp.array(valid), rectangle(w1=w1))
        places, states = plain_cascade(valid, w1)
        assert list(np.asarray(ours.status)) == states
        for leg, place in enumerate(places):
            if place is not None:
                assert tuple(np.round(np.asarray(ours.offset[leg]) / SIZE).astype(int)) == place
        seen |= {int(s) for s in states}
    assert share or seen == {FootholdStatus.NONE}


@pytest.mark.parametrize(
    ("cells", "best"),
    [([(2, 0), (-2, 0)], (2, 0)), ([(0, 1), (0, -1)], (0, 1)), ([(1, 1), (2, 0)], (2, 0)), ([(0, 0), (1, 0)], (0, 0))],
)
def test_ties_go_forward_then_to_the_centre_line_then_left(cells, best):
    start = np.round((np.asarray(NOMINAL) - np.array(GRID.origin)) / SIZE).astype(int)
    valid = np.zeros((GRID.nx, GRID.ny), bool)
    for i, j in cells:
        for a, b in start:
            valid[a + i, b + j] = True
    ours = chosen(jnp.array(valid), rectangle())
    assert tuple(np.round(np.asarray(ours.offset[0]) / SIZE).astype(int)) == best


def test_the_rectangle_turns_with_the_heading():
    valid = jnp.array(np.random.default_rng(3).random((GRID.nx, GRID.ny)) < 0.7)
    offset = np.asarray(chosen(valid, rectangle(np.pi / 2)).offset[0])
    assert abs(offset[0]) <= 0.04 + 1e-9  # across the heading lies x now
    assert abs(offset[1]) <= 0.19 + 1e-9


def test_the_score_is_one_at_nominal_and_stays_in_the_unit_interval():
    box = rectangle()
    corner = feasible_score(jnp.array([0.15, 0.04]), box, 0.30)
    assert feasible_score(jnp.zeros(2), box, 0.30) == 1.0
    assert abs(corner) < 1e-12  # both distances at their largest: f = 0


def soft(weight, temperature, valid):
    return soft_offset(NOMINAL, valid, TERRAIN, rectangle(w1=weight), CELLS, temperature)


def test_the_soft_choice_tends_to_the_exact_one_and_has_a_true_gradient():
    valid = jnp.array(np.random.default_rng(5).random((GRID.nx, GRID.ny)) < 0.8)
    exact = chosen(valid, rectangle(w1=0.45))
    assert exact.status[0] == FootholdStatus.NOMINAL
    np.testing.assert_allclose(soft(0.45, 1e-5, valid), exact.offset[0], atol=1e-6)
    slope = jax.jacfwd(soft)(0.45, 0.1, valid)
    difference = (soft(0.45 + 1e-5, 0.1, valid) - soft(0.45 - 1e-5, 0.1, valid)) / 2e-5
    np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-9)
