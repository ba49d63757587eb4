"""The pictures of the foothold planner: what is drawn is the data."""

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxleg.plan import FootholdStatus
from jaxleg.planning.planner import Choice, Site
from jaxleg.terrain import Grid, flat
from jaxleg.viz import footholds
from jaxleg.viz.footholds import Cascade, draw_cascade, draw_footholds

CELL = 0.06
GRID = Grid(25, 13, CELL, (-12 * CELL, -6 * CELL))
FEET = np.array([[5, 3], [4, -3], [-5, 3], [-6, -3]]) * CELL


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    figures: list[Figure] = []
    keep = footholds.save
    monkeypatch.setattr(footholds, "save", lambda figure, path: (figures.append(figure), keep(figure, path)))
    return figures, tmp_path / "figure.png"


def test_common_cells_are_numbered_by_preference_and_the_chosen_stance_is_drawn(drawn):
    figures, path = drawn
    valid = np.ones((25, 13), bool)
    i, j = np.round((FEET[0] - GRID.origin) / CELL).astype(int)
    valid[i, j] = False  # the nominal cell of one leg: no longer common
    rank = np.arange(9)[::-1].reshape(3, 3)
    case = Cascade(FootholdStatus.NOMINAL, valid, GRID, np.ones((3, 3), bool), rank, np.array([CELL, CELL]))
    draw_cascade([case], FEET, CELL, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    _, forming, chosen = figures[0].axes
    assert sorted(int(text.get_text()) for text in forming.texts) == sorted(list(range(1, 9)) * 4)
    np.testing.assert_allclose(chosen.lines[-1].get_xydata(), FEET + CELL)
    assert "[m]" in chosen.get_xlabel()


def test_footholds_are_drawn_where_they_are_with_their_status(drawn):
    figures, path = drawn
    status = np.array([[0, 1, 2, 3]])
    offset = np.arange(8.0).reshape(1, 4, 2) / 100.0
    site = Site(flat(GRID), jnp.ones((25, 13), bool))
    draw_footholds(site, FEET[None], Choice(jnp.asarray(offset), jnp.asarray(status, jnp.int32)), 0.3, 0.08, path)
    placed = figures[0].axes[0].lines[1::2]
    np.testing.assert_allclose([line.get_xydata()[0] for line in placed], FEET + offset[0])
    assert [line.get_marker() for line in placed] == ["o", "s", "^", "x"]
