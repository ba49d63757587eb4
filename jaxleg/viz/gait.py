"""A planned walk seen from the side and from above."""

import functools
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from jaxleg.conventions import LEFT_LEGS, RIGHT_LEGS, RING
from jaxleg.gait.order import PHASES
from jaxleg.leg.dynamics import all_folds, all_leg_frames, centre_of_mass
from jaxleg.numerics import matvec
from jaxleg.robot import Robot
from jaxleg.rotations import rotation_from_quaternion
from jaxleg.terrain.heightmap import HeightMap, heights
from jaxleg.viz.ground import HEIGHT, View, draw_ground, heights_in
from jaxleg.viz.style import BLACK, LEG_COLOUR, PURPLE, WIDTH, blank, label, leg_keys, legend_below, save
from jaxleg.walk.data import Reference, Walk

MARGIN = np.array([0.10, 0.06, 0.05])  # drawn round the walk in x, y, z [m]
FORWARD = "x, direction of travel [m]"
LEVEL = 1e-3  # ground that varies by less is drawn as level [m]
GROUND_LEFT, GROUND_RIGHT = dict(color=BLACK, lw=1.0), dict(color="#bdbdbd", lw=4.0)


class Posture(NamedTuple):
    """The robot's joints and centre of mass in W [m]; leading axis time."""

    chain: np.ndarray  # (t, leg, hip roll - thigh - knee - foot, xyz)
    com: np.ndarray  # (t, xyz)


def gait(robot: Robot, walk: Walk, reference: Reference, terrain: HeightMap, path: str | Path) -> None:
    """Side view and top view of a walk, on one scale.

    Side: the ground under the left and the right feet, the feet's paths, trunk and legs at the start of each
    phase of the last cycle. Top: elevation, footholds, the last cycle's support triangles, way-points, the
    paths of trunk and centre of mass. The plan must be finite (`Status.OK`).
    """
    walk = jax.tree.map(np.asarray, walk)
    reference = jax.tree.map(np.asarray, reference)
    posture = Posture(*map(np.asarray, postures(robot, reference.joint_pos, reference.trunk_pos, reference.trunk_quat)))
    low, high = _extent(walk, posture)
    view = (low[0], high[0], low[1], high[1])
    level = np.ptp(heights_in(terrain, view)) < LEVEL
    width, depth, rise = high - low
    around = 2.1 if level else 2.85  # inches for labels, legend and colour bar; the views then fill the width
    tall = around + 0.9 * WIDTH * (depth + rise) / width
    figure, (side, top) = blank(tall, rows=2, height_ratios=(rise, depth))
    _side(side, walk, reference, terrain, posture, low, high)
    if not level:
        image = draw_ground(top, terrain, view=view)
        figure.colorbar(image, ax=top, location="bottom", shrink=0.6, aspect=40).set_label(HEIGHT)
    _top(top, walk, reference, posture, view)
    top.set_title("from above" + (", level ground" if level else ""), fontsize=11)
    legend_below(figure, _legend(), 5)
    save(figure, path)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0, 0, 0))
def postures(robot, angles, position, quaternion):
    """The fields of `Posture` at joint angles (t, leg, joint) [rad], places (t, xyz) [m] and quaternions (t, 4) of trunks."""
    frames = all_leg_frames(robot, angles)
    points = jnp.concatenate([frames.origin, frames.foot[:, None]], axis=1) + robot.hip_position[:, None]
    rotation = rotation_from_quaternion(quaternion)
    com = centre_of_mass(robot, all_folds(robot, angles)).array()
    return position[None, None] + matvec(rotation, points), position + matvec(rotation, com)


def _extent(walk: Walk, posture: Posture) -> tuple[np.ndarray, np.ndarray]:
    points = np.concatenate([walk.footholds.reshape(-1, 3), posture.chain.reshape(-1, 3)])
    return points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN


def _side(ax: Axes, walk: Walk, reference: Reference, terrain: HeightMap, posture: Posture, low, high):
    x = np.linspace(low[0], high[0], 300)
    for legs, style in ((RIGHT_LEGS, GROUND_RIGHT), (LEFT_LEGS, GROUND_LEFT)):
        y = float(walk.footholds[:, list(legs), 1].mean())
        ax.plot(x, heights(terrain, np.stack([x, np.full_like(x, y)], axis=-1)), **style)
    _sticks(ax, walk, reference, posture)
    for leg, colour in enumerate(LEG_COLOUR):
        ax.plot(*reference.foot_pos[:, leg, ::2].T, color=colour, lw=1.0)
    ax.set_aspect("equal")
    ax.set(xlim=(low[0], high[0]), ylim=(low[2], high[2]))
    label(ax, FORWARD, "z, up [m]", "from the side, as each phase of the last cycle begins (later is darker)")


def _sticks(ax: Axes, walk: Walk, reference: Reference, posture: Posture) -> None:
    starts = walk.phases.start[-PHASES:]
    samples = np.argmin(np.abs(reference.time[:, None] - starts), axis=0)
    for sample, strength in zip(samples, np.linspace(0.25, 1.0, PHASES)):
        chain = posture.chain[sample, :, 1:]
        for leg, colour in enumerate(LEG_COLOUR):
            ax.plot(*chain[leg, :, ::2].T, color=colour, alpha=strength, lw=1.8, marker="o", ms=2.5)
        hips = posture.chain[sample, :, 0]
        trunk = np.stack([hips[2:].mean(axis=0), hips[:2].mean(axis=0)])
        ax.plot(*trunk[:, ::2].T, color=BLACK, alpha=strength, lw=2.5)


def _top(ax: Axes, walk: Walk, reference: Reference, posture: Posture, view: View) -> None:
    for swings, feet in zip(walk.phases.swings[-PHASES:], walk.phases.feet_from[-PHASES:]):
        if swings.any():
            corners = [feet[leg, :2] for leg in RING if not swings[leg]]
            ax.add_patch(Polygon(corners, facecolor=PURPLE, edgecolor=PURPLE, alpha=0.14))
    ax.plot(*reference.trunk_pos[:, :2].T, color=BLACK, lw=1.2, ls=(0, (4, 2)))
    ax.plot(*posture.com[:, :2].T, color=BLACK, lw=1.6)
    ax.plot(*walk.poses[:, :2].T, "D", color="white", mec=BLACK, ms=5)
    for leg, colour in enumerate(LEG_COLOUR):
        ax.plot(*walk.footholds[:, leg, :2].T, "o", color=colour, mec=BLACK, mew=0.6, ms=7)
    ax.set_aspect("equal")
    ax.set(xlim=view[:2], ylim=view[2:])
    label(ax, FORWARD, "y, to the left [m]")


def _legend() -> list:
    return [
        *leg_keys(marker="o", mec=BLACK, mew=0.6),
        Line2D([], [], **GROUND_LEFT, label="ground, left feet"),
        Line2D([], [], **GROUND_RIGHT, label="ground, right feet"),
        Line2D([], [], color=BLACK, lw=1.2, ls=(0, (4, 2)), label="trunk's centre"),
        Line2D([], [], color=BLACK, lw=1.6, label="centre of mass"),
        Line2D([], [], color="white", marker="D", mec=BLACK, ls="", label="way-point"),
        Patch(facecolor=PURPLE, alpha=0.3, label="support triangle"),
    ]
