"""The contract of a controller, and what passes between it and a simulation."""

import abc
from typing import Generic, NamedTuple, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Memory = TypeVar("Memory")
Row = TypeVar("Row")


class State(NamedTuple):
    """Configuration and velocity in MuJoCo's order: position in W, quaternion, joints; linear in W, angular in B, joints."""

    q: Float[Array, "19"]
    v: Float[Array, "18"]


class Reading(NamedTuple):
    """What is sensed when a tick begins."""

    state: State
    foot: Float[Array, "leg 3"]  # centres of the feet in W [m]
    foot_by_leg: Float[Array, "leg 3 joint"]  # Jacobian of each foot by its own joints, in W [m/rad]


class Tracking(NamedTuple):
    """Command to the joint controllers for a tick, or for n of them: one row each."""

    position: Float[Array, "*n leg joint"]  # at the start of the step [rad]
    velocity: Float[Array, "*n leg joint"]  # at its end [rad/s]
    torque: Float[Array, "*n leg joint"]  # feed-forward at its middle [N m]
    dt: Float[Array, "*n"]  # [s]


class Controller(abc.ABC, Generic[Memory, Row]):
    """What every controller is: a pytree. Its `Memory` is one too, of a structure that stays the same.

    One that lacks `start` or `command` cannot be made: TypeError.
    """

    @abc.abstractmethod
    def start(self) -> Memory:
        """The memory before the first tick."""

    @abc.abstractmethod
    def command(self, memory: Memory, sensed: Reading, row: Row) -> tuple[Tracking, Memory]:
        """The command for the tick that begins.

        `row` is the tick's row of what was computed before the walk: a scanned input, because an indexed look-up in every
        step would make reverse mode quadratic in the steps. The open loop has one, the others get None.
        """

    def felt(self, memory: Memory, torque: Float[Array, "leg joint"], after: State) -> Memory:
        """The memory after the tick: `torque` [N m] is what the motors applied in it, `after` the state it ends in."""
        return memory

    def over(self, memory: Memory) -> Bool[Array, ""]:
        """Whether the walk has come to its end: from then on it stands, and is measured no more. By default never."""
        return jnp.array(False)
