"""The figure of the gait region: a panel a height, its border where the solver has it."""

import numpy as np
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from jaxleg.viz import stance


def test_gait_regions(pegasus, monkeypatch, tmp_path):
    saved, write = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *args, **options: (saved.append(self), write(self, *args, **options)))
    path = tmp_path / "new" / "region.png"
    stance.gait_regions(pegasus, [0.5, 0.56], (0.2, 0.3), path)
    assert path.read_bytes().startswith(b"\x89PNG")
    axes = saved[0].axes
    assert len(axes) == 2
    assert "[m]" in axes[0].get_ylabel()
    for ax, half in zip(axes, np.sqrt(0.36 - np.array([0.5, 0.56]) ** 2)):
        assert "[m]" in ax.get_xlabel()
        border, star = (line.get_xydata() for line in ax.lines)
        np.testing.assert_allclose(border.max(axis=0), [half, 1.6 * half], rtol=5e-3)
        np.testing.assert_allclose(star, [[0.2, 0.3]])


def test_the_colour_at_a_point_is_its_constraint(pegasus, monkeypatch, tmp_path):
    saved, write = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *args, **options: (saved.append(self), write(self, *args, **options)))
    stance.gait_regions(pegasus, [0.5], (0.2, 0.3), tmp_path / "region.png")
    mesh = saved[0].axes[0].collections[0]
    values = np.ma.filled(mesh.get_array(), np.nan)
    steps, searches = np.linspace(0.0, 1, stance.CELLS), np.linspace(0.0, 1, stance.CELLS)
    widest = 1.08 * np.sqrt(0.11)

    def colour(step, search):
        i, j = np.abs(steps * widest - step).argmin(), np.abs(searches * 1.6 * widest - search).argmin()
        return mesh.cmap(mesh.norm(values[j, i]))[:3] if np.isfinite(values[j, i]) else None

    for binding, point in enumerate([(0.1, 0.15), (0.31, 0.2), (0.3, 0.5)]):
        assert colour(*point) == to_rgba(stance.COLOUR[binding])[:3]
    assert colour(0.1, 0.25) is colour(0.34, 0.1) is None
