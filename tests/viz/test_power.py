"""Power, currents and the grid of baselines as pictures: what is drawn is the data."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxleg.viz import baselines, power
from jaxleg.viz.baselines import draw_baselines
from jaxleg.viz.power import draw_currents, draw_power, draw_up_down, smoothed

PNG = b"\x89PNG\r\n\x1a\n"
times = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.03, 1000))


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Keep the figures that are saved."""
    figures: list[Figure] = []
    for module in (power, baselines):
        keep = module.save
        monkeypatch.setattr(module, "save", lambda figure, path, keep=keep: (figures.append(figure), keep(figure, path)))
    return figures, tmp_path / "figure.png"


def named(figure: Figure) -> bool:
    """Whether every panel that has an outer axis says what it shows and in which unit."""
    labels = [ax.get_xlabel() + ax.get_ylabel() for ax in figure.axes]
    return any("[" in text for text in labels)


def test_smoothing_keeps_the_energy_and_a_constant():
    values = np.sin(times) + 2.0
    assert np.allclose(smoothed(times, np.full_like(times, 3.0)), 3.0)
    middle = np.searchsorted(times, 10.0)
    fine = np.linspace(times[middle] - 0.25, times[middle] + 0.25, 100_001)
    held = values[np.searchsorted(times, fine)]  # a value holds over the step that ends at its time
    assert abs(smoothed(times, values)[middle] - held.mean()) < 1e-4


def test_power_names_each_contestant_with_its_mean_while_walking(drawn):
    figures, path = drawn
    stand = 5.0
    values = {name: np.where(times > stand, mean, 1.0) for name, mean in (("traditional", 30.0), ("ours", 20.0))}
    draw_power(np.stack([times, times]), values, stand, "on stairs", path)
    assert path.read_bytes().startswith(PNG)
    text = " ".join(figures[0].axes[0].get_legend_handles_labels()[1])
    for words in ("traditional, walking 30.0 W", "ours, walking 20.0 W", "standing"):
        assert words in text
    assert named(figures[0])
    assert figures[0].axes[0].get_title() == "on stairs"


def test_currents_show_one_leg_and_all_sums(drawn):
    figures, path = drawn
    current = np.random.default_rng(1).uniform(0.0, 2.0, (len(times), 4, 3))
    draw_currents(times, current, current[..., 0] > 1.5, 3, path)
    assert path.read_bytes().startswith(PNG)
    above, below = figures[0].axes
    np.testing.assert_array_equal(above.lines[2].get_ydata(), current[:, 3, 2])
    np.testing.assert_array_equal(below.lines[1].get_ydata(), current[:, 1].sum(axis=1))
    assert named(figures[0])


def test_up_down_is_drawn_against_time_and_height(drawn):
    figures, path = drawn
    current, height = np.random.default_rng(2).uniform(0.0, 2.0, (len(times), 3)), 0.3 + 0.1 * np.sin(times)
    draw_up_down(times, height, current, path)
    assert path.read_bytes().startswith(PNG)
    np.testing.assert_array_equal(figures[0].axes[1].lines[2].get_xdata(), height)
    assert named(figures[0])


def test_the_grid_shows_each_baseline_and_leaves_out_what_cannot_be_walked(drawn):
    figures, path = drawn
    rows = [
        {"mass": mass, "skew": "no skew", "hip_height": h, "foot_offset": x}
        | {kind: {"saving": {"paper": None if h > 0.47 and x > 0.0 else 100.0 * (h - x)}} for kind in ("flat", "stairs")}
        for mass in ("midway", "0.1 m behind")
        for h in (0.44, 0.46, 0.48)
        for x in (-0.1, 0.0, 0.1)
    ]
    cell = {"mass": "midway", "skew": "no skew", "hip_height": 0.46, "foot_offset": 0.0}
    draw_baselines(rows, "paper", {"sums": {"as it is": cell, "with a constant loss": cell}}, path)
    assert path.read_bytes().startswith(PNG)
    panel = figures[0].axes[0].collections[0].get_array()
    assert np.ma.count_masked(np.ma.masked_invalid(panel)) == 1
    assert np.isclose(panel.reshape(3, 3)[1, 2], 36.0)
