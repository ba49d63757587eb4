"""Motions without a step: standing before a walk, and moving up and down over the feet."""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxleg.gait.order import PHASES, SWING_LEG
from jaxleg.gait.params import GaitParams
from jaxleg.gait.phases import Phases, no_flights
from jaxleg.robot import Robot
from jaxleg.terrain.ground import on_ground
from jaxleg.terrain.heightmap import HeightMap
from jaxleg.walk.data import Reference, Walk


def stand_first(reference: Reference, seconds: float, samples: int) -> Reference:
    """A reference that stands in its first pose for so long [s] before it begins, in so many equal intervals.

    The first sample of a walk is a rest pose with four loaded feet, so its feed-forward torque is that of standing still.
    Paper A, Fig. 10b: the robot waits for its map.
    """
    wait = jnp.arange(samples, dtype=reference.time.dtype) * (seconds / samples)
    held = Reference(*(jnp.repeat(x[:1], samples, axis=0) for x in reference))
    still = {name: jnp.zeros_like(getattr(held, name)) for name in ("joint_vel", "trunk_vel")}
    held = held._replace(time=wait, **still)
    moved = reference._replace(time=reference.time + seconds)
    return Reference(*(jnp.concatenate(pair) for pair in zip(held, moved)))


def up_down(
    robot: Robot,
    params: GaitParams,
    terrain: HeightMap,
    low: Float[ArrayLike, ""],
    high: Float[ArrayLike, ""],
    seconds: Float[ArrayLike, ""],
) -> Walk:
    """Three times up and down between two hip heights over feet that stand under the thigh joints (paper A, Fig. 5).

    A `Walk` of six phases without a swing, each from rest to rest in so many seconds; it begins at `low` [m]. `params` is
    carried along unused.
    """
    lateral = jnp.sum(robot.link_offset[..., 1], axis=1)
    feet = on_ground(robot, terrain, robot.hip_position[:, :2] + jnp.stack([robot.link_offset[:, 0, 0], lateral], axis=1))
    ground = jnp.mean(feet[:, 2])
    ends = jnp.tile(jnp.array([low, high], feet.dtype), PHASES // 2 + 1)[: PHASES + 1]
    poses = jnp.zeros((PHASES + 1, 6), feet.dtype).at[:, 2].set(ground + ends - jnp.mean(robot.hip_position[:, 2]))
    duration = jnp.full(PHASES, 1.0, feet.dtype) * seconds
    there, none = jnp.broadcast_to(feet, (PHASES, 4, 3)), jnp.zeros((PHASES, 4), feet.dtype)
    still = no_flights(PHASES, feet.dtype)
    phases = Phases(jnp.cumsum(duration) - duration, duration, poses[:-1], poses[1:], there, there, still, none)
    zero, status = jnp.zeros((), feet.dtype), jnp.zeros((1, 4), jnp.int32)
    return Walk(
        gait=params,
        footholds=feet[None],
        found=status,
        poses=poses,
        feet=feet[None],
        count=status[0, 0],
        way=zero,
        lowering=zero,
        phases=phases,
        used=jnp.ones(PHASES, bool),
        load_share=zero + 0.1,
        status=status[0, 0],
        legs=SWING_LEG,
    )
