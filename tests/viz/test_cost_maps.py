"""The figure of a cost map: its panels with units, what is drawn where, maps of one height or none."""

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxleg.terrain import HeightMap
from jaxleg.terrain.body_cost import BodyFeatures
from jaxleg.terrain.cost_map import CostMap
from jaxleg.viz.cost_maps import cost_maps

WAY = np.array([[0.1, 0.0], [0.2, 0.1], [0.4, 0.1]])


@pytest.mark.parametrize("shape", [(12, 6), (6, 12)], ids=["wide", "high"])
def test_panels(shape, monkeypatch, tmp_path):
    saved, write = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *args, **options: (saved.append(self), write(self, *args, **options)))
    elevation = np.full(shape, 0.3)
    elevation[2, 1] = np.nan
    terrain = HeightMap(jnp.asarray(elevation), jnp.array([1.0, -1.0]), jnp.array(0.1))
    body = jnp.asarray(np.random.default_rng(0).uniform(size=shape)).at[3, 3].set(jnp.inf)
    total = body[None] * jnp.linspace(0.1, 1.0, 8)[:, None, None]
    features = BodyFeatures(*(jnp.full(shape, jnp.nan),) * 3, seen=jnp.zeros(shape))
    cost_maps(
        terrain, features, CostMap(total, body, total), 3, tmp_path / "new" / "map.png", [("near", WAY), ("far", WAY + 0.1)]
    )
    assert (tmp_path / "new" / "map.png").read_bytes().startswith(b"\x89PNG")
    panels = [ax for ax in saved[0].axes if ax.images]
    assert [ax.get_title()[:3] for ax in panels] == ["(a)", "(b)", "(c)", "(d)", "(e)", "(f)"]
    assert [ax.get_title().partition(" [")[2] for ax in panels] == ["m]", "rad]", "m]", "m]", "", ""]
    assert all(ax.child_axes for ax in panels)  # their colour bars
    assert "135 deg" in panels[5].get_title()
    drawn = panels[5].images[0].get_array()
    assert drawn.mask.T[3, 3]
    np.testing.assert_allclose(np.ma.filled(drawn, np.inf).T, total[3])
    np.testing.assert_allclose(panels[0].images[0].get_extent()[:2], (0.95, 0.95 + 0.1 * shape[0]))
    assert [len(ax.lines) for ax in panels] == [6, 0, 0, 0, 0, 6]
    np.testing.assert_allclose(panels[5].lines[1].get_xydata(), WAY)
    assert [text.get_text() for text in saved[0].legends[0].get_texts()] == ["near", "far"]
