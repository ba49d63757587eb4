"""Where standing ends and falling begins: each limit just kept and just passed, alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxleg.control.contract import State
from jaxleg.sim import fall
from jaxleg.terrain import HeightMap

SHAPE, SIZE = (41, 31), 0.05
ORIGIN = np.array([-1.0, -0.75])
STAND = 0.5  # [m]
DEEP = np.full(SHAPE, -9.0)  # ground that nothing meets


@pytest.fixture(scope="module")
def falls(pegasus):
    @jax.jit
    def run(elevation, start, q, v, feet):
        trunk = fall.watch_trunk(
            pegasus, HeightMap(elevation, jnp.asarray(ORIGIN), jnp.array(SIZE)), State(start, jnp.zeros(18)), jnp.zeros((4, 3))
        )
        return fall.fallen(trunk, State(q, v), feet)

    def ask(position=(0.0, 0.0, STAND), turn=(0.0, 0.0, 0.0), feet=0.0, elevation=DEEP, joints=0.0, v=0.0):
        """Turn: roll, pitch and yaw [deg], first the roll."""
        quaternion = np.roll(Rotation.from_euler("xyz", turn, degrees=True).as_quat(), 1)
        start = np.concatenate([[0.0, 0.0, STAND], np.zeros(16)])
        q = np.concatenate([position, quaternion, np.full(12, joints)])
        places = np.column_stack([np.zeros((4, 2)), feet + np.array([0.1, -0.1, 0.05, -0.05])])
        return bool(run(*(jnp.asarray(x, float) for x in (elevation, start, q, np.full(18, v), places))))

    return ask


@pytest.mark.parametrize("yaw", [0.0, 70.0, -160.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_45_degrees_either_way(falls, yaw, side):
    assert not falls(turn=(44.0 * side, 0.0, yaw))
    assert falls(turn=(46.0 * side, 0.0, yaw))
    assert not falls(turn=(0.0, 44.0 * side, yaw))
    assert falls(turn=(0.0, 46.0 * side, yaw))


def test_roll_and_pitch_together_tilt_as_the_vertical_says(falls):
    """cos 32 cos 32 = 0.719, cos 34 cos 34 = 0.687: 44 and 46.6 degrees."""
    assert not falls(turn=(32.0, 32.0, 20.0))
    assert falls(turn=(34.0, 34.0, 20.0))


@pytest.mark.parametrize("feet", [0.0, 0.4, -0.3])
def test_half_the_height_over_the_feet_as_they_are(falls, feet):
    assert not falls(position=(0.0, 0.0, feet + 0.5 * STAND + 1e-3), feet=feet)
    assert falls(position=(0.0, 0.0, feet + 0.5 * STAND - 1e-3), feet=feet)


def box(x, y, height):
    """A box on deep ground, of the cells whose centres lie between two x and two y."""
    across, along = (ORIGIN[i] + SIZE * np.arange(SHAPE[i]) for i in (0, 1))
    inside = ((x[0] <= across) & (across <= x[1]))[:, None] & ((y[0] <= along) & (along <= y[1]))
    return np.where(inside, height, DEEP)


LOWER = STAND - 0.075  # the trunk's lower face, 0.80 x 0.24 m
PLACES = {
    "middle": ((-0.06, 0.06), (-0.06, 0.06), True),
    "nose": ((0.34, 0.39), (-0.06, 0.06), True),
    "tail": ((-0.39, -0.34), (-0.06, 0.06), True),
    "left edge": ((-0.06, 0.06), (0.04, 0.11), True),
    "right edge": ((-0.06, 0.06), (-0.11, -0.04), True),
    "ahead": ((0.54, 0.9), (-0.7, 0.7), False),
    "behind": ((-0.9, -0.54), (-0.7, 0.7), False),
    "to the left": ((-0.9, 0.9), (0.24, 0.7), False),
    "to the right": ((-0.9, 0.9), (-0.7, -0.24), False),
}


@pytest.mark.parametrize("place", PLACES)
def test_a_box_under_the_trunk_is_a_fall_where_it_reaches_it_and_one_beside_is_none(falls, place):
    x, y, under = PLACES[place]
    assert falls(elevation=box(x, y, LOWER + 0.01)) == under
    assert not falls(elevation=box(x, y, LOWER - 0.01))


def test_the_trunk_carries_its_box_along_as_it_moves_and_turns(falls):
    """A quarter turn to the left puts the nose to the left; a nose that dips by 0.3 rad comes 0.12 m down."""
    left = box((-0.06, 0.06), (0.33, 0.38), LOWER + 0.01)
    assert not falls(elevation=left)
    assert falls(elevation=left, turn=(0.0, 0.0, 90.0))
    assert falls(elevation=left, position=(0.0, 0.35, STAND))
    ahead = box((0.32, 0.37), (-0.06, 0.06), LOWER - 0.08)
    assert not falls(elevation=ahead)
    assert not falls(elevation=ahead, turn=(0.0, np.rad2deg(-0.3), 0.0))
    assert falls(elevation=ahead, turn=(0.0, np.rad2deg(0.3), 0.0))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_is_a_fall(falls, bad):
    assert not falls(joints=1e3, v=1e6)
    assert falls(joints=bad)
    assert falls(v=bad)
    assert falls(position=(bad, 0.0, STAND))
