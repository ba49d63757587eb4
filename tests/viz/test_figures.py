"""Figures: each writes one PNG, every axis has a name and a unit, and what is drawn is the data."""

import csv
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxleg.gait.params import GaitParams
from jaxleg.posture.body import joint_angles
from jaxleg.robot import load_robot
from jaxleg.terrain.generators import Grid, flat, stairs
from jaxleg.viz.gait import gait
from jaxleg.viz.results import energy
from jaxleg.viz.search import history, parameters
from jaxleg.viz.torque import torque_maps
from jaxleg.walk.data import Reference
from tests.crawls import crawl, settings, up_to

ROBOT = Path(__file__).parents[2] / "configs/robots/pegasus.toml"
GRID = Grid(56, 26, 0.04, (-0.9, -0.5))
STAGES = ("best_i", "best_ii", "best")
ENERGY = dict(traditional=500.0, implied=450.0, paper=400.0, best_i=380.0, best_ii=330.0, best=250.0)
SPANS = {"workspace.high": [0.4, 0.6], "shift_share": [0.3, 0.6]}
NONE = {"mean": None, "ci95": None}


@pytest.fixture(scope="module")
def robot():
    return load_robot(ROBOT)


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved."""
    saved, write = [], Figure.savefig

    def record(self, *args, **options):
        saved.append(self)
        write(self, *args, **options)

    monkeypatch.setattr(Figure, "savefig", record)
    return saved


def panels(drawn, path: Path) -> list:
    """The axes of the only figure drawn, whose PNG lies at `path`; axes of a colour bar come last."""
    (figure,) = drawn
    assert path.read_bytes().startswith(b"\x89PNG")
    return figure.axes


def has_unit(text: str) -> bool:
    return re.search(r"\[(m|J/m|N m|-)\]", text) is not None


def texts(ax) -> list[str]:
    return [text.get_text() for text in ax.texts]


def result() -> dict:
    """The parts of a result.json that are drawn, for two kinds; `implied` fails on all stairs."""
    table = {
        who: {
            kind: {
                "params": {"workspace.high": 0.55, "shift_share": 0.3},
                "energy_per_metre": {
                    name: {"mean": scale * value, "ci95": [0.9 * scale * value, 1.1 * scale * value]}
                    for name, scale in dict(net=0.9, positive=1.0, absolute=1.2).items()
                },
                "lanes": 8,
                "falls": 0,
                "infeasible": 0,
            }
            for kind in ("flat", "stairs")
        }
        for who, value in ENERGY.items()
    }
    table["implied"]["stairs"]["energy_per_metre"] = dict.fromkeys(("net", "positive", "absolute"), NONE)
    table["implied"]["stairs"]["infeasible"] = 8
    table["best_i"]["flat"]["falls"] = 3
    saving = {"flat": {"positive": {"mean": 0.24, "ci95": [0.2, 0.28]}}, "stairs": {"positive": NONE}}
    return table | {
        "power": "positive",
        "saving": {"simulation": dict.fromkeys(STAGES, saving)},
        "bounds": {"flat": SPANS, "stairs": SPANS},
        "terrains": {"by_kind": {"held_out": {"flat": 8, "stairs": 8}}},
        "active_constraints": {who: {"flat": ["knee_bend"], "stairs": []} for who in STAGES},
    }


def test_torque_maps(robot, drawn, tmp_path):
    path = tmp_path / "new" / "torque.png"
    before = dict({"workspace.high": 0.48}, foot_offset=0.0, step_length=0.2)
    after = dict({"workspace.high": 0.55}, foot_offset=-0.05, step_length=0.12)
    torque_maps(robot, before, after, path)
    *maps, bar = panels(drawn, path)
    assert len(maps) == 3
    assert has_unit(bar.get_ylabel())
    assert has_unit(maps[0].get_ylabel())
    for ax in maps:
        assert has_unit(ax.get_xlabel())
        sweeps = [line.get_xydata() for line in ax.lines if line.get_color() != "white"][-2:]
        np.testing.assert_allclose(sweeps[0], [[-0.1, 0.48], [0.1, 0.48]], atol=1e-6)
        np.testing.assert_allclose(sweeps[1], [[-0.11, 0.55], [0.01, 0.55]], atol=1e-6)


def test_energy(drawn, tmp_path):
    path = tmp_path / "energy.png"
    energy(result(), path)
    flat_ax, stairs_ax = panels(drawn, path)
    assert [bar.get_width() for bar in flat_ax.patches] == list(ENERGY.values())
    assert all(bar.get_x() == 0.0 for bar in flat_ax.patches)
    assert flat_ax.get_xlim()[0] == 0.0
    assert len(stairs_ax.patches) == len(ENERGY) - 1
    assert "infeasible" in texts(stairs_ax)
    assert "saves 24.0 %\n(20.0 to 28.0)\n3 of 8 failed" in texts(flat_ax)
    assert not any("saves" in text for text in texts(stairs_ax))
    assert all(has_unit(ax.get_xlabel()) for ax in (flat_ax, stairs_ax))


def test_energy_interval_of_equal_lanes(drawn, tmp_path):
    """On equal lanes the mean may lie outside its interval by rounding."""
    data = result()
    data["best"]["flat"]["energy_per_metre"]["positive"] = {"mean": 250.0, "ci95": [250.0 + 1e-9] * 2}
    energy(data, tmp_path / "energy.png")
    assert drawn


def test_a_single_terrain_has_no_interval(drawn, tmp_path):
    data, path = result(), tmp_path / "energy.png"
    data["terrains"]["by_kind"]["held_out"]["flat"] = 1
    for row in data["best"]["flat"]["energy_per_metre"].values():
        row["ci95"] = None
    data["saving"]["simulation"] = {who: {"flat": {"positive": {"mean": 0.24, "ci95": None}}} for who in STAGES}
    energy(data, path)
    flat_ax, stairs_ax = panels(drawn, path)
    assert flat_ax.get_title() == "flat, 1 terrain, no interval"
    assert stairs_ax.get_title() == "stairs, 8 terrains"
    assert "saves 24.0 %" in texts(flat_ax)


def test_history(drawn, tmp_path):
    path, table = tmp_path / "history.png", tmp_path / "history.csv"
    rows = [
        dict(kind=kind, stage=stage, step=step, terrains=4, best=1.0 - 0.1 * step, mean=2.0 if step else "", seconds=1.0)
        for kind in ("flat", "stairs")
        for stage in STAGES
        for step in range(4)
    ]
    with table.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    history(table, path)
    axes = panels(drawn, path)
    assert [ax.get_title() for ax in axes] == ["flat", "stairs"]
    assert has_unit(axes[0].get_ylabel())
    for ax in axes:
        assert has_unit(ax.get_xlabel())
        assert len(ax.lines) == 2 * len(STAGES) + 2  # one and only number of terrains
        np.testing.assert_allclose(ax.lines[0].get_ydata(), [1.0, 0.9, 0.8, 0.7])
        assert np.isnan(ax.lines[1].get_ydata()[0])


def test_parameters(drawn, tmp_path):
    path = tmp_path / "parameters.png"
    parameters(result(), path)
    axes = panels(drawn, path)
    assert [label.get_text() for label in axes[0].get_yticklabels()] == ["workspace.high [m]", "shift share"]
    assert "knee bend" in axes[0].get_xlabel()
    assert "nothing" in axes[1].get_xlabel()
    for ax in axes:
        assert texts(ax) == ["0.4", "0.6", "0.3", "0.6"]
        places = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 1]
        np.testing.assert_allclose(places, [0.75] * 5 + [0.0] * 5, atol=1e-9)


def scalar(value: float) -> jax.Array:
    return jnp.asarray(value, float)


def phase_starts(robot, walk) -> Reference:
    """The reference where each phase begins, without torques: slow to compile and not drawn."""
    phases = walk.phases
    angles, _ = jax.vmap(joint_angles, in_axes=(None, 0, 0))(robot, phases.trunk_from, phases.feet_from)
    half, zero = 0.5 * phases.trunk_from[:, 3], jnp.zeros_like(phases.start)
    quaternion = jnp.stack([jnp.cos(half), zero, -jnp.sin(half), zero], axis=-1)
    none, still = jnp.zeros_like(angles), jnp.zeros((len(half), 6), half.dtype)
    trunk, feet = phases.trunk_from[:, :3], phases.feet_from
    return Reference(phases.start, angles, none, none, trunk, quaternion, still, feet, 1.0 - phases.swings)


@pytest.fixture(scope="module")
def planned(robot):
    params = GaitParams(up_to(scalar(0.47)), *map(scalar, (-0.1, 0.1, 0.2, 0.6, 0.36, 0.08, 0.45, 0.5, 0.1)))
    options = settings(threshold=0.01)
    offsets, status = jnp.zeros((2, 4, 2), float), jnp.zeros((2, 4), jnp.int32)

    @jax.jit
    def plan(terrain):
        walk = crawl(robot, params, options, terrain, offsets, status)
        return walk, phase_starts(robot, walk)

    return plan


@pytest.mark.parametrize("make", [flat, lambda grid: stairs(grid, 0.08, 0.3, 0.1)], ids=["flat", "stairs"])
def test_gait(robot, planned, make, drawn, tmp_path):
    path, terrain = tmp_path / "gait.png", jax.jit(make, static_argnums=0)(GRID)
    walk, sampled = planned(terrain)
    gait(robot, walk, sampled, terrain, path)
    side, top, *bar = panels(drawn, path)
    level = not np.ptp(np.asarray(terrain.elevation))
    assert len(bar) == len(top.images) == (0 if level else 1)
    assert all(has_unit(text) for ax in (side, top) for text in (ax.get_xlabel(), ax.get_ylabel()))
    assert len(top.patches) == 4  # support triangles
    feet = [line.get_xydata() for line in top.lines[-4:]]
    np.testing.assert_allclose(feet, np.moveaxis(np.asarray(walk.footholds)[..., :2], 1, 0), atol=1e-6)
    legs = [line.get_xydata() for line in side.lines if len(line.get_xydata()) == 3]
    assert len(legs) == 6 * 4
    np.testing.assert_allclose([leg[-1] for leg in legs[:4]], np.asarray(walk.footholds)[0][:, ::2], atol=1e-4)
