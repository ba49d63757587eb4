"""Figures of the torque maps: both branches, their limits and workspaces where they belong."""

import dataclasses

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxleg.leg.workspace import Workspace
from jaxleg.viz import torque_map

LOAD = 86.2
PAPER = Workspace(-0.20, 0.0, 0.48, 0.52)
MIRRORED = Workspace(0.0, 0.20, 0.48, 0.52)


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Draws a figure with its arguments and gives it back, after its PNG was written."""
    saved, write = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *args, **options: (saved.append(self), write(self, *args, **options)))

    def draw(function, *arguments):
        path = tmp_path / "new" / "figure.png"
        function(*arguments, path)
        assert path.read_bytes().startswith(b"\x89PNG")
        return saved[0]

    return draw


def rectangles(ax) -> list[Workspace]:
    boxes = [patch for patch in ax.patches if isinstance(patch, Rectangle)]
    return [Workspace(b.get_x(), b.get_x() + b.get_width(), b.get_y(), b.get_y() + b.get_height()) for b in boxes]


def test_half_planes(pegasus, drawn):
    branches = {"backward": pegasus, "forward": dataclasses.replace(pegasus, knee_sign=-pegasus.knee_sign)}
    figure = drawn(torque_map.half_planes, branches, LOAD, {"backward": PAPER, "forward": MIRRORED})
    *maps, bar = figure.axes
    assert len(maps) == 6
    assert "[N m]" in bar.get_ylabel()
    assert all("[m]" in ax.get_ylabel() for ax in maps[::3])
    assert all("[m]" in ax.get_xlabel() for ax in maps[3:])
    np.testing.assert_allclose(rectangles(maps[2]) + rectangles(maps[5]), [PAPER, MIRRORED])
    for ax, side in zip(maps, (-1, -1, -1, 1, 1, 1)):
        outer, inner, clear, thigh, knee = (line.get_xydata() for line in ax.lines)
        np.testing.assert_allclose(np.hypot(*outer.T), 0.6)
        np.testing.assert_allclose(np.hypot(*inner.T), 0.08)
        np.testing.assert_allclose(clear[:, 1], 0.26)
        np.testing.assert_allclose(thigh[:, 0], 0.0)
        np.testing.assert_allclose(side * knee[:, 0], np.sqrt(np.maximum(0.26**2 - (knee[:, 1] - 0.34) ** 2, 0.0)), atol=1e-7)


def test_best_workspaces(pegasus, drawn):
    best = {name: {"here": PAPER, "high": Workspace(-0.13, 0.07, 0.53, 0.57)} for name in ("total", "square")}
    start = np.linspace(-0.3, 0.0, 31)
    slides = dict.fromkeys(best, np.stack([start, 2.0 + (start + 0.17) ** 2], axis=1))
    figure = drawn(torque_map.best_workspaces, pegasus, LOAD, PAPER, best, slides, (20.0, 35.0))
    maps, curves = figure.axes[:2], figure.axes[2:4]
    assert ["[N m]" in maps[0].get_title(), "m$^2$]" in maps[1].get_title()] == [True, True]
    for ax in maps:
        np.testing.assert_allclose(rectangles(ax), [*best["total"].values(), PAPER])
        arcs = [np.hypot(*line.get_xydata().T) for line in ax.lines if line.get_color() == torque_map.GREY]
        np.testing.assert_allclose([arc.std() for arc in arcs], 0.0, atol=1e-9)
    for ax in curves:
        assert "[m]" in ax.get_xlabel()
        curve, star = (line.get_xydata() for line in ax.lines)
        assert curve[:, 1].min() == 1.0
        np.testing.assert_allclose(star, [[-0.20, (2.0 + 0.03**2) / 2.0]], rtol=1e-3)
