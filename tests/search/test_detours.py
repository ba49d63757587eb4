"""Detours: what ground is closed round a dead end, and which lanes take another path."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxleg.robot import Robot
from jaxleg.search.config import Gait, Kind, Study
from jaxleg.search.navigate import navigate, navigator_of
from jaxleg.status import Status
from jaxleg.terrain import Grid, HeightMap, flat
from jaxleg.walk.config import Navigation, PathSettings
from jaxleg.walk.navigation import Navigator, Survey, Walked

GRID = Grid(40, 30, 0.05, (0.3, -0.4))
DETOURS = 3


class StandIn(Navigator):
    """Plans by the goal alone: how many detours until there is a walk (x), and whether there is any path at all by then (y)."""

    def walk(self, survey, start, goal, closed):
        count = jnp.sum(closed).astype(goal.dtype)
        lost = jnp.where((goal[1] > 0.0) & (count > 0), Status.NO_PATH, Status.DEAD_END)
        nothing = jnp.zeros(())
        return Walked(jnp.where(count >= goal[0], Status.OK, lost), *[nothing] * 4, jnp.sum(closed), nothing, nothing)  # ty: ignore

    def detour(self, terrain, walked, closed):
        return closed.reshape(-1).at[walked.visited].set(True).reshape(closed.shape)


class Ground(NamedTuple):
    """A site's part that is looked at."""

    terrain: HeightMap
    valid: np.ndarray


def stuck_at(xy) -> Any:
    """A walk of which only where it was stuck is looked at."""
    return Walked(*[None] * 7, xy)  # ty: ignore


def made(kind: Any, robot: Robot, **path: Any) -> Any:
    """A navigator with these settings of its path."""
    study = Study(kinds={"flat": Kind()}, navigation=Navigation(path=PathSettings(**path)))
    return kind(**vars(navigator_of(study, robot, Gait(), GRID.resolution)))


@pytest.fixture(scope="module")
def level():
    return jax.jit(flat, static_argnums=0)(GRID)


def test_the_ground_round_a_dead_end_is_closed(level, pegasus):
    """All cells whose centre lies within the radius of where the walk was stuck, and those that were closed before."""
    stuck, radius = np.array([1.12, 0.31]), 0.3
    closed = np.zeros((40, 30), bool)
    closed[0, 0] = True
    navigator = made(Navigator, pegasus, detour_radius=radius)
    lane = jax.jit(lambda at, closed: navigator.detour(level, stuck_at(at), closed))
    x, y = 0.3 + 0.05 * np.arange(40)[:, None], -0.4 + 0.05 * np.arange(30)[None]
    wanted = np.hypot(x - stuck[0], y - stuck[1]) < radius
    wanted[0, 0] = True
    assert 100 < wanted.sum() < 130
    np.testing.assert_array_equal(lane(stuck, closed), wanted)


def test_lanes_at_a_dead_end_take_another_path_until_there_is_none(level, pegasus):
    """At once, after two detours, after more than are allowed, and where the first detour leaves no path at all."""
    goal = np.array([[0.0, 0.0], [2.0, 0.0], [1e9, 0.0], [1e9, 1.0]])
    maps: Any = Ground(jax.tree.map(lambda x: np.stack([np.asarray(x)] * 4), level), np.ones((4, 40, 30), bool))
    costs: Any = None
    walked, detours = navigate(made(StandIn, pegasus, detours=DETOURS), Survey(maps, costs), np.zeros((4, 2)), goal)
    assert [Status(x) for x in walked.status] == [Status.OK, Status.OK, Status.DEAD_END, Status.DEAD_END]
    assert detours.tolist() == [0, 2, DETOURS, 0]
