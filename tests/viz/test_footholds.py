"""The pictures of the foothold planner: what is drawn is the planner's answer, and maps that cannot serve are refused."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from experiments import footholds as experiment
from jaxleg.conventions import InputError
from jaxleg.foothold.cascade import Reachable
from jaxleg.foothold.contract import Footholds, FootholdStatus
from jaxleg.foothold.rectangle import SearchRectangle
from jaxleg.search.config import Rectangle
from jaxleg.terrain import Grid, HeightMap
from jaxleg.terrain.files import MapFile, save_map
from jaxleg.terrain.site import Site
from jaxleg.viz import footholds
from jaxleg.viz.footholds import Planned, draw_cascade, draw_footholds, search_cells
from jaxleg.viz.ground import LEAST_RANGE
from jaxleg.viz.style import LEG_COLOUR, RED

NOMINAL, WIDENED = FootholdStatus.NOMINAL, FootholdStatus.WIDENED
FEET = np.array([[0.2, 0.15], [0.1, -0.15], [-0.2, 0.15], [-0.3, -0.15]])
GRID = Grid(60, 40, 0.02, (-0.59, -0.39))
DATA = Path(__file__).parents[3] / "shared" / "data"


@pytest.fixture(autouse=True)
def configured(monkeypatch):
    monkeypatch.setattr("experiments.common.configure_jax", lambda: None)  # the session's configuration stays


@pytest.fixture(scope="module")
def cases():
    return {wanted: experiment.example(wanted) for wanted in (NOMINAL, WIDENED)}


@pytest.fixture
def drawn(monkeypatch):
    """Figures as they would be saved; rendering them takes seconds, and the experiment's own test does it."""
    figures: list[Figure] = []
    monkeypatch.setattr(footholds, "save", lambda figure, path: figures.append(figure))
    return figures


def planned(status, offset, heading=0.0, hole=()):
    elevation = np.zeros((GRID.nx, GRID.ny))
    elevation[hole] = np.nan
    site = Site(GRID.map(jnp.asarray(elevation)), np.ones(elevation.shape, bool))
    box = SearchRectangle(*(jnp.asarray(x, float) for x in (0.3, 0.08, 0.08, 0.5, heading)))
    choice = Footholds(jnp.asarray(offset, float), jnp.asarray(status, jnp.int32))
    return Planned(site, box, np.tile(FEET, (len(status), 1, 1)), choice)


def test_the_first_number_is_the_planners_choice(cases):
    for wanted, case in cases.items():
        cells = search_cells(case, wanted == WIDENED)
        assert cells.inside.sum() == (21 if wanted == WIDENED else 15)
        np.testing.assert_allclose(cells.offset[cells.number == 1], np.asarray(case.choice.offset)[0, :1], atol=1e-9)
    assert search_cells(cases[WIDENED], False).number.max() == 0


def test_removing_the_first_choice_makes_the_second_the_first(cases):
    case = cases[NOMINAL]
    cells = search_cells(case, False)
    origin, resolution = np.asarray(case.site.terrain.origin), float(case.site.terrain.resolution)
    valid = np.array(case.site.valid)
    valid[tuple(np.round((case.chosen()[0, 2] - origin) / resolution).astype(int))] = False
    site = case.site._replace(valid=valid)
    again = experiment.plan(site, case.rectangle, jnp.asarray(case.nominal), Reachable(*map(jnp.asarray, (-0.1, 0.1, 0.1))))
    np.testing.assert_allclose(np.asarray(again.choice.offset)[0, :1], cells.offset[cells.number == 2], atol=1e-9)


def test_cascade_has_the_papers_panels_and_the_chosen_stance(cases, drawn, tmp_path):
    draw_cascade(cases[NOMINAL], cases[WIDENED], tmp_path / "cascade.png")
    axes = drawn[0].axes
    assert [ax.get_title()[:3] for ax in axes[:7]] == [f"({letter})" for letter in "abcdefg"]
    assert "NOMINAL" in axes[3].get_title()
    assert "no cells" in axes[4].get_title()
    assert "WIDENED" in axes[6].get_title()
    assert [len(ax.patches) for ax in axes[:7]] == [60] * 5 + [84] * 2
    for ax, case in ((axes[3], cases[NOMINAL]), (axes[6], cases[WIDENED])):
        feet = [line.get_xydata() for line in ax.lines if line.get_marker() == "o" and line.get_markerfacecolor() == RED]
        np.testing.assert_allclose(feet, case.chosen(), atol=1e-12)
        assert {text.get_position() for text in ax.texts if text.get_text() == "1"} == {
            tuple(foot) for foot in case.chosen()[0]
        }


def test_cells_are_coloured_by_their_validity(cases, drawn, tmp_path):
    draw_cascade(cases[NOMINAL], cases[WIDENED], tmp_path / "cascade.png")
    colours = [to_rgb(patch.get_facecolor()) for patch in drawn[0].axes[1].patches]
    cells = search_cells(cases[NOMINAL], False)
    expected = cells.valid[:, cells.inside].ravel()
    assert {colour for colour, valid in zip(colours, expected) if valid} == {footholds._paler(footholds.GREEN, 0.8)}
    assert {colour for colour, valid in zip(colours, expected) if not valid} == {footholds._paler(footholds.ORANGE, 0.8)}


def test_footholds_are_drawn_where_they_are_with_their_status(drawn, tmp_path):
    offset = np.arange(8.0).reshape(1, 4, 2) / 100.0
    offset[0, 3] = 0.0
    draw_footholds(planned([[0, 1, 2, 3]], offset), tmp_path / "map.png")
    placed = [
        line for line in drawn[0].axes[0].lines if line.get_marker() in footholds.MARKER.values() and line.get_markersize() == 8
    ]
    np.testing.assert_allclose([line.get_xydata()[0] for line in placed], FEET + offset[0])
    assert [line.get_marker() for line in placed] == ["o", "s", "^", "X"]
    assert [line.get_color() for line in placed] == list(LEG_COLOUR)


@pytest.mark.parametrize(("status", "words"), [(0, "NOMINAL"), (1, "WIDENED"), (2, "NEAREST")])
def test_a_panel_a_cycle_says_how_far_all_feet_moved(drawn, tmp_path, status, words):
    offset = np.tile(np.array([0.0, 0.04]), (2, 4, 1))
    draw_footholds(planned([[status] * 4] * 2, offset, heading=0.5 * np.pi), tmp_path / "map.png")
    titles = [ax.get_title() for ax in drawn[0].axes[:2]]
    assert all(words in title for title in titles)
    assert all(("0.04 m ahead" in title) == (status < 2) for title in titles)
    assert "[m]" in drawn[0].axes[0].get_ylabel()


def test_a_leg_without_a_foothold_is_named(drawn, tmp_path):
    draw_footholds(planned([[2, 3, 2, 2]], np.zeros((1, 4, 2))), tmp_path / "map.png")
    assert "NONE for RF" in drawn[0].axes[0].get_title()


def test_unseen_cells_are_left_out_even_if_all_are(drawn, tmp_path):
    for hole in ((30, slice(18, 21)), (slice(None), slice(None))):
        shown = planned([[3] * 4], np.zeros((1, 4, 2)), hole=hole)
        draw_footholds(shown, tmp_path / "map.png")
        left_out = np.ma.getmaskarray(drawn[-1].axes[0].images[0].get_array()).T
        np.testing.assert_array_equal(left_out, np.isnan(shown.site.terrain.elevation))


def test_what_is_out_of_view_does_not_share_out_the_colours(drawn, tmp_path):
    shown = planned([[0] * 4], np.zeros((1, 4, 2)))
    elevation = np.full((GRID.nx, GRID.ny), 0.02)
    elevation[0], elevation[30, 20] = 5.0, 0.12
    draw_footholds(shown._replace(site=shown.site._replace(terrain=GRID.map(jnp.asarray(elevation)))), tmp_path / "map.png")
    np.testing.assert_allclose(drawn[0].axes[0].images[0].get_clim(), (0.02, 0.12))
    assert drawn[0].axes[0].get_xlim()[0] > GRID.origin[0] + 0.5 * GRID.resolution


def test_level_ground_has_one_colour_and_a_scale(drawn, tmp_path):
    draw_footholds(planned([[0] * 4], np.zeros((1, 4, 2))), tmp_path / "map.png")
    assert drawn[0].axes[0].images[0].get_clim() == (0.0, LEAST_RANGE)


def saved(path, cells, resolution):
    ground = HeightMap(np.zeros(cells), np.zeros(2), np.array(resolution))
    save_map(MapFile(ground, np.zeros(3)), path)
    return path


@pytest.mark.parametrize(
    ("cells", "resolution", "heading", "words"),
    [
        ((40, 40), 0.05, 0.0, "resolution is 0.05 m, but must be at most the foot's diameter, 0.04 m"),
        ((18, 40), 0.02, 0.0, "cells along x are 18, 0.36 m, but the lengthened search rectangle needs 0.38 m"),
        ((40, 18), 0.02, 90.0, "cells along y are 18, 0.36 m, but the lengthened search rectangle needs 0.38 m"),
    ],
)
def test_maps_that_cannot_serve_are_refused_in_one_sentence(tmp_path, capsys, cells, resolution, heading, words):
    path = saved(tmp_path / "map.npz", cells, resolution)
    with pytest.raises(InputError, match="map.npz: .*" + words):
        experiment.read_map(path, Rectangle(), 0.02, np.deg2rad(heading))
    assert not capsys.readouterr().out


def test_w_search_refuses_a_map_too(tmp_path):
    with pytest.raises(InputError, match=r"at most the rectangle's search_width, 0\.03 m"):
        experiment.read_map(saved(tmp_path / "map.npz", (40, 40), 0.04), Rectangle(search_width=0.03), 0.02, 0.0)


@pytest.mark.parametrize(
    ("resolution", "cells", "read"), [(0.04, (40, 20), (40, 20)), (0.02, (19, 4), (19, 4)), (0.0025, (400, 160), (100, 40))]
)
def test_fine_maps_are_thinned_and_others_kept(tmp_path, resolution, cells, read):
    terrain = experiment.read_map(saved(tmp_path / "map.npz", cells, resolution), Rectangle(), 0.02, 0.0)
    assert terrain.elevation.shape == read
    np.testing.assert_allclose(terrain.resolution, max(resolution, 0.01))


def test_the_experiment_refuses_with_status_two(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        experiment.main(tmp_path / "out", terrain=tmp_path / "missing.npz")
    assert stop.value.code == 2
    assert capsys.readouterr().err.startswith("footholds: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_experiment_draws_and_writes(tmp_path, capsys):
    experiment.main(tmp_path)
    result = json.loads((tmp_path / "result.json").read_text())
    assert [{foot["status"] for foot in case.values()} for case in result["cases"]] == [{"NOMINAL"}, {"WIDENED"}]
    assert sum(result["count"].values()) == 12
    assert [list(cycle) for cycle in result["cycles"]] == [["LF", "RF", "LH", "RH"]] * 3
    assert {path.name for path in tmp_path.glob("*.png")} == {"cascade.png", "map.png"}
    assert "WIDENED" in capsys.readouterr().out


@pytest.mark.slow  # no default test needs what a fresh clone has not
@pytest.mark.skipif(not DATA.is_dir(), reason="the shared maps are not there")
@pytest.mark.parametrize(("name", "heading"), [("cpd_real_stairs", -90.0), ("ocs2_stepping_stones", 0.0)])
def test_shared_maps(tmp_path, name, heading):
    experiment.main(tmp_path, terrain=DATA / f"{name}.npz", heading=heading)
    result = json.loads((tmp_path / "result.json").read_text())
    assert sum(result["count"].values()) == 12
    assert result["count"]["NONE"] == 0
