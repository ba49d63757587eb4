"""Where a study lets a foot be placed: its settings reach the terrain's features."""

import dataclasses

import jax
import numpy as np
import pytest

from jaxleg.search.config import Kind, Study, Terrains
from jaxleg.search.sites import first_of_each, footing_rule, make_sites
from jaxleg.terrain import Grid, stairs
from jaxleg.terrain.footing import footing

TERRAIN = jax.jit(stairs, static_argnums=0)(Grid(45, 12, 0.02, (0.0, 0.0)), 0.08, 0.30)
TREAD = slice(15, 30)  # the cells of one tread: 0.30 m at 0.02 m


@pytest.mark.parametrize(
    ("changes", "cells"),
    [({}, 11), ({"least_traversability": 0.7}, 9), ({"least_traversability": 0.0, "edge_height": 0.5}, 15)],
)
def test_a_tread_keeps_the_cells_that_the_settings_allow(changes, cells):
    """Of 15: two go at either riser; 0.7 takes one more on either side; without edges and features none goes, because the
    sampled surface is level at the last cell of a tread (the harmonic mean of a slope and 0)."""
    maps = dataclasses.replace(Terrains(), **changes)
    found = jax.jit(footing, static_argnums=(0, 1, 2))(footing_rule(maps), 0.02, 0.02, TERRAIN)
    valid = np.asarray(found)[TREAD, 6]
    assert valid.sum() == cells
    assert np.array_equal(valid, valid[::-1])


def test_copies_of_one_ground_count_once(pegasus):
    """Flat ground is one terrain; rough ground never repeats. Stairs differ by where they begin: the three cells of
    a tread cut its depth into four parts, within which all stairs are the same."""
    kinds = {"flat": Kind(), "rough": Kind("rough"), "stairs": Kind("stairs", run=0.12)}
    study = Study(kinds=kinds, terrains=Terrains(train=60, held_out=9, cells=(24, 12), resolution=0.04))
    maps = {kind: np.asarray(make_sites(study, pegasus, kind, held_out=False).terrain.elevation) for kind in kinds}
    assert [len(maps[kind]) for kind in kinds] == [1, 20, 4]
    assert all(len(np.unique(rows, axis=0)) == len(rows) for rows in maps.values())


def test_grounds_that_differ_by_the_sign_of_zero_alone_are_one():
    """Rough ground of no roughness: noise of either sign times nothing."""
    rows = np.zeros((3, 4, 5))
    rows[1] = -0.0
    rows[2, 1, 1] = 0.01
    assert first_of_each(rows).tolist() == [0, 2]
