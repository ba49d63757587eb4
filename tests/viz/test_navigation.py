"""Pictures of paper C's planner and the film of a walk: what is drawn is the data, shares and intervals are right."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from jaxleg.conventions import InputError
from jaxleg.gait.order import STEP_LEGS
from jaxleg.robot import load_robot
from jaxleg.terrain import HeightMap
from jaxleg.viz.animation import Stage, animate, film
from jaxleg.viz.navigation import Look, Trail, Trials, draw_dead_end, draw_success, draw_walk, wilson
from jaxleg.walk.feasible import Standing

ROBOT = Path(__file__).parents[2] / "configs/robots/pegasus.toml"
STANCE = np.array([[0.3, 0.2], [0.3, -0.2], [-0.3, 0.2], [-0.3, -0.2]])
ROUTE = np.array([[0.0, 0.0], [0.5, 0.1], [1.0, 0.0]])
SLOPE = 0.2


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved, in few pixels: that is fast."""
    saved, write = [], Figure.savefig

    def record(self, *args, **options):
        saved.append(self)
        write(self, *args, **options | {"dpi": 30})

    monkeypatch.setattr(Figure, "savefig", record)
    return saved


@pytest.fixture(scope="module")
def robot():
    return load_robot(ROBOT)


def hill(unseen: bool = False) -> HeightMap:
    """Ground that rises along x, 4 x 2 m from (-1, -1) on."""
    elevation = np.broadcast_to(SLOPE * (-0.95 + 0.1 * np.arange(40))[:, None], (40, 20)).copy()
    if unseen:
        elevation[:2] = np.nan
    return HeightMap(jnp.asarray(elevation), jnp.array([-0.95, -0.95]), jnp.array(0.1))


def series(steps: int) -> Standing:
    """A walk along x that swings the legs in turn by 0.1 m."""
    feet, pose = [np.append(STANCE, np.zeros((4, 1)), axis=1)], np.zeros((steps + 1, 6))
    for k in range(steps):
        moved = feet[-1].copy()
        moved[STEP_LEGS[k % 4], 0] += 0.1
        feet.append(moved)
    pose[:, 0] = 0.025 * np.arange(steps + 1)
    return Standing(np.array(feet), pose)


def lines(ax) -> list[np.ndarray]:
    return [line.get_xydata() for line in ax.lines]


def has(ax, points: np.ndarray) -> bool:
    """Whether a line goes through just these points."""
    return any(line.shape == points.shape and np.allclose(line, points) for line in lines(ax))


def test_walk(drawn, tmp_path):
    terrain, path = hill(unseen=True), tmp_path / "new" / "walk.png"
    valid = np.ones((40, 20), bool)
    valid[:5, 3] = False
    walk = Trail(ROUTE, STANCE, series(8).feet[..., :2], np.zeros(2), np.ones(2))
    draw_walk(terrain, valid, walk, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    (ax,) = (ax for ax in drawn[0].axes if ax.images)
    height, tint = (image.get_array() for image in ax.images)
    np.testing.assert_allclose(np.ma.filled(height, np.nan).T, terrain.elevation)
    np.testing.assert_array_equal(~np.ma.getmaskarray(tint).T, ~valid & np.isfinite(np.asarray(terrain.elevation)))
    np.testing.assert_allclose(ax.images[0].get_extent(), (-1.0, 3.0, -1.0, 1.0), atol=1e-6)
    assert has(ax, walk.path)
    assert has(ax, walk.trunk)
    assert all(has(ax, walk.feet[:, leg]) for leg in range(4))
    assert has(ax, walk.start[None])
    assert has(ax, walk.goal[None])
    assert "[m]" in ax.get_xlabel()


def test_walk_over_a_map_without_a_seen_cell(drawn, tmp_path):
    terrain = HeightMap(jnp.full((6, 6), jnp.nan), jnp.zeros(2), jnp.array(0.1))
    walk = Trail(np.zeros((0, 2)), np.zeros((0, 2)), STANCE[None], np.zeros(2), np.ones(2))
    draw_walk(terrain, np.zeros((6, 6), bool), walk, tmp_path / "walk.png")
    (ax,) = (ax for ax in drawn[0].axes if ax.images)
    assert np.ma.getmaskarray(ax.images[0].get_array()).all()


@pytest.mark.parametrize(("hits", "count"), [(0, 5), (5, 5), (3, 7), (19, 20)])
def test_at_the_ends_of_wilsons_interval_the_share_is_two_deviations_off(hits, count):
    """Which defines it: |share - p| = 1.96 sqrt(p (1 - p) / n)."""
    for end in np.ravel(wilson(np.array([hits]), np.array([count]))):
        np.testing.assert_allclose(abs(hits / count - end), 1.96 * np.sqrt(end * (1.0 - end) / count), atol=1e-4)


def test_success(drawn, tmp_path):
    difficulty = np.array([0.1, 0.2, 0.3, 0.4, 0.9, 1.0])
    path = np.array([1, 1, 1, 0, 1, 0], bool)
    walked = np.array([1, 1, 0, 0, 0, 0], bool)
    kinds = [Trials("cuboids", difficulty, path, walked), Trials("fractal", difficulty[:4], path[:4], walked[:4])]
    draw_success(kinds, tmp_path / "success.png", bins=2)
    cuboids, fractal = drawn[0].axes
    assert cuboids.get_title() == "cuboids: 6 maps, 4 with a path, 2 walked"
    shares = [box.lines[0].get_ydata() for box in cuboids.containers]
    np.testing.assert_allclose(shares, [[0.75, 0.5], [0.5, 0.0]])
    np.testing.assert_allclose(fractal.containers[1].lines[0].get_ydata(), [0.5])  # no map, no point
    bars = [bar.get_segments() for bar in cuboids.containers[1].lines[2]]
    np.testing.assert_allclose(bars[0][0][:, 1], np.ravel(wilson(np.array([2]), np.array([4]))))


def test_dead_end(drawn, tmp_path):
    short, long = Look(1, series(5), True), Look(4, series(20), False)
    draw_dead_end(hill(), np.ones((40, 20), bool), short, long, tmp_path / "dead.png")
    left, right = (ax for ax in drawn[0].axes if ax.images)
    assert left.get_title() == "looking 1 step ahead: stuck after step 5"
    assert right.get_title() == "looking 4 steps ahead: goes on"
    next_leg = STEP_LEGS[5 % 4]
    np.testing.assert_allclose(left.lines[-1].get_xydata(), short.states.feet[-1, next_leg, :2][None])
    assert left.lines[-1].get_marker() == "X"
    assert right.lines[-1].get_marker() == "o"
    assert len(left.patches) == 1  # the last stance
    support = right.patches[1].get_xy()[:-1]
    standing = [leg for leg in range(4) if leg != next_leg]
    np.testing.assert_allclose(sorted(support.tolist()), sorted(long.states.feet[5, standing, :2].tolist()))
    assert all(has(right, long.states.feet[:, leg, :2]) for leg in range(4))


def walk(frames: int) -> np.ndarray:
    """Configurations of a robot that glides along 30 deg to the left of x with bent legs, 0.5 m over the hill."""
    q = np.zeros((frames, 19))
    way = np.linspace(0.0, 1.0, frames)
    q[:, 0], q[:, 1] = way * np.cos(np.pi / 6), way * np.sin(np.pi / 6) - 0.2
    q[:, 2] = 0.5 + SLOPE * q[:, 0]
    q[:, 3], q[:, 6] = np.cos(np.pi / 12), np.sin(np.pi / 12)
    q[:, 7:] = np.tile([0.0, -0.5, 1.0], 4)
    return q


def test_film_shows_robot_and_ground(robot):
    q = walk(3)
    shown = film(hill(), q, robot)
    np.testing.assert_allclose(shown.track, q[:, :2])
    hips = np.asarray(robot.hip_position)
    ahead = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    np.testing.assert_allclose(shown.chain[:, 0, 0] @ ahead, q[:, :2] @ ahead + hips[0, 0], atol=1e-6)
    np.testing.assert_allclose(shown.side_chain[:, :, 0, 0], np.broadcast_to(hips[:, 0], (3, 4)), atol=1e-6)
    np.testing.assert_allclose(shown.side_chain[:, :, 0, 1], np.broadcast_to(q[:, 2:3] + hips[:, 2], (3, 4)), atol=1e-6)
    np.testing.assert_allclose(np.ptp(shown.side_deck, axis=1), np.tile(robot.trunk_size[::2], (3, 1)), atol=1e-6)
    for frame, side in ((0, 0), (2, 1)):  # under each foot the ground that is drawn is the hill
        for leg in (side, side + 2):
            seen = np.interp(shown.side_chain[frame, leg, -1, 0], shown.along, shown.side_ground[frame, side])
            np.testing.assert_allclose(seen, SLOPE * shown.chain[frame, leg, -1, 0], atol=1e-4)


def test_stage_moves_what_moves(robot):
    shown = film(hill(), walk(3), robot)
    stage = Stage(shown, hill(), 0.02, None, None)
    pictures = [np.asarray(stage.shot(frame, str(frame))) for frame in (0, 2, 0)]
    assert (pictures[0] != pictures[1]).any()
    np.testing.assert_array_equal(pictures[0], pictures[2])  # nothing is left over from another frame
    stage.shot(2, "now")
    above, side = stage.figure.axes
    assert has(above, shown.track)
    assert all(has(above, shown.chain[2, leg]) and has(side, shown.side_chain[2, leg]) for leg in range(4))
    assert stage.caption.get_text() == "now"


def test_animate(robot, tmp_path):
    path = tmp_path / "new" / "walk.gif"
    animate(path, hill(unseen=True), walk(3), robot, 0.5, speed=2.0, route=ROUTE, goal=ROUTE[-1])
    with Image.open(path) as gif:
        assert gif.format == "GIF"
        assert gif.n_frames == 3
        assert gif.info["duration"] == 250


def test_what_cannot_be_filmed(robot, tmp_path):
    with pytest.raises(InputError, match=r"walk\.mp4: the film's name must end in \.gif"):
        animate(tmp_path / "walk.mp4", hill(), walk(3), robot, 0.1)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        animate(tmp_path / "file" / "walk.gif", hill(), walk(3), robot, 0.1)
    with pytest.raises(ValueError, match=r"must be \(frame, 19\)"):
        animate(tmp_path / "walk.gif", hill(), walk(3)[:, :18], robot, 0.1)
