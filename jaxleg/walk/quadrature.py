"""The integral of power (paper A, equation (1)) over a walk, piece by piece of each phase.

Within a piece motion is smooth, so the phases' shares have true gradients (a uniform grid aliases them). Torques and speeds are
worked out at a few Gauss nodes of a piece; power, which has kinks where a motor begins to brake, is taken at many places of the
polynomials through them. How far that is from four times the nodes tells `experiments.bench_proxy`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxleg.gait.order import SHIFT
from jaxleg.leg.energy import Power, motor_power
from jaxleg.robot import Robot
from jaxleg.walk.data import Walk
from jaxleg.walk.reference import Instant

SHIFT_NODES = (4, 4)  # of each smooth piece of a body shift: its two halves
SWING_NODES = (3, 4, 6, 6, 4, 3)  # of a swing: load off, foot straight up, on to the middle, and the same in reverse
FINE = 32  # places in a piece at which power is taken


class Pieces(NamedTuple):
    """Smooth pieces of a walk's phases that have as many nodes each."""

    phase: np.ndarray  # (piece,)
    start: Float[Array, "piece"]  # in shares of the phase
    width: Float[Array, "piece"]
    nodes: int


def pieces_of(walk: Walk) -> list[Pieces]:
    """All pieces of all phases, in groups, whose nodes follow one another in what `energy_of` takes."""
    orders = [SHIFT_NODES if leg == SHIFT else SWING_NODES for leg in walk.legs]
    edges, groups = _edges(walk), []
    for nodes in sorted({*SHIFT_NODES, *SWING_NODES}):
        found = [(phase, k) for phase, each in enumerate(orders) for k, order in enumerate(each) if order == nodes]
        phase, piece = np.array(found).T
        start = edges[phase, piece]
        groups.append(Pieces(phase, start, edges[phase, piece + 1] - start, nodes))
    return groups


def _edges(walk: Walk) -> Float[Array, "phase edge"]:
    """Where the pieces of each phase begin and end, in shares of it."""
    load, lift = walk.load_share, walk.phases.flight.lift
    before = jnp.stack([jnp.zeros_like(lift), jnp.full_like(lift, load), load + lift * (1.0 - 2.0 * load)], axis=1)
    swing = jnp.concatenate([before, jnp.full_like(before[:, :1], 0.5), 1.0 - before[:, ::-1]], axis=1)
    shift = jnp.asarray([0.0, 0.5, *[1.0] * (len(SWING_NODES) - 1)], swing.dtype)
    return jnp.where(jnp.asarray(walk.legs)[:, None] == SHIFT, shift[None], swing)


def nodes_of(pieces: Pieces) -> Float[Array, "node"]:
    """Shares of the phase of all nodes, piece by piece."""
    places = jnp.asarray(_gauss(pieces.nodes)[0], pieces.start.dtype)
    return (pieces.start[:, None] + pieces.width[:, None] * places[None]).reshape(-1)


def energy_of(robot: Robot, walk: Walk, pieces: list[Pieces], at: Instant) -> Power:
    """Energy by joint (leg, joint) [J], from instants at all nodes of the pieces in their last axis. Paper A, equation (1)."""
    total, first = Power(*[jnp.zeros(at.torque.shape[:2], at.torque.dtype)] * 3), 0
    for some in pieces:
        last = first + len(some.phase) * some.nodes
        own = (x[..., first:last] for x in (at.torque, at.velocity))
        torque, speed = (x.reshape(*x.shape[:2], -1, some.nodes) for x in own)  # (leg, joint, piece, node)
        power = motor_power(robot, torque, speed)
        fine = motor_power(robot, _finer(torque), _finer(speed)).mechanical_positive
        seconds = jnp.where(walk.used[some.phase], some.width * walk.phases.duration[some.phase], 0.0)
        parts = (_sum(power.mechanical, seconds), _sum(fine, seconds), _sum(power.joule, seconds))
        total = jax.tree.map(jnp.add, total, Power(*parts))
        first = last
    return total


def _sum(power: Float[Array, "leg joint piece node"], seconds: Float[Array, "piece"]) -> Float[Array, "leg joint"]:
    """Gauss's rule on pieces that last so long."""
    weight = jnp.asarray(_gauss(power.shape[-1])[1], power.dtype)
    return jnp.sum(power * (seconds[:, None] * weight[None])[None, None], axis=(-2, -1))


def _finer(values: Float[Array, "leg joint piece node"]) -> Float[Array, "leg joint piece fine"]:
    """Values at the finer places of each piece, by the polynomial through its nodes."""
    matrix = jnp.asarray(_interpolation(values.shape[-1]), values.dtype)
    return jnp.einsum("ljpn,fn->ljpf", values, matrix, precision="highest")


def _gauss(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre places and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    return 0.5 * (x + 1.0), 0.5 * w


def _interpolation(nodes: int) -> np.ndarray:
    """Values at `FINE` Gauss places from those at `nodes` of them (fine, node)."""
    few, many = (np.polynomial.legendre.legvander(2.0 * _gauss(n)[0] - 1.0, nodes - 1) for n in (nodes, FINE))
    return many @ np.linalg.inv(few)
