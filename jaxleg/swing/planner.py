"""The informed planner's parameters, what it sees of a map, and what it predicts after a collision. Paper B, III.C."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxleg.pytree import pytree, static
from jaxleg.swing.localmap import LocalMap, points, widened, with_block, with_felt_error, with_flat_patch, with_ramp
from jaxleg.swing.machine import Machine, Mode, Sensed, Step, check_positive
from jaxleg.swing.route import Route
from jaxleg.swing.routing import WINDOW, View, field_as_printed, field_repaired, taut_string


@pytree
class RoutePlanner:
    """Parameters of the informed planner: B's Table I, and what its repairs need. Lengths in the unit of the map."""

    clearance: Float[Array, "*batch"]  # d0; at most `WINDOW` points of the map
    preset: Float[Array, "*batch"]  # H_limit: the height of the preset obstacle (13), and its distance from the start
    preset_end: Float[Array, "*batch"]  # its distance from x_e: H_limit as printed; if by w more, it covers no landing
    half_width: Float[Array, "*batch"]  # w_pre of the predicted obstacles (14), (16)
    ramp: Float[Array, "*batch"]  # tan(theta_pre)
    attraction: Float[Array, "*batch"]  # zeta
    repulsion: Float[Array, "*batch"]  # eta
    reach: Float[Array, "*batch"]  # how far round a collision the map is raised by the felt error; 0 as printed
    margin: Float[Array, "*batch"]  # landings keep this far from the ends of En
    gentle: Float[Array, "*batch"]  # slope from which on a landing is avoided
    press: Float[Array, "*batch"]  # a route ends this far below the believed ground, to feel it
    route: Callable[[View], Route] = static()


def as_printed(**changes: float) -> RoutePlanner:
    """The potential field with the numbers of B's Table I."""
    return _planner(field_as_printed, dict(preset_end=0.5, ramp=1.0, reach=0.0, margin=0.0, gentle=1.0), changes)


def repaired(**changes: float) -> RoutePlanner:
    """The field without its local minima."""
    return _planner(field_repaired, {}, changes)


def shortest(**changes: float) -> RoutePlanner:
    """The taut string for a map that is right: the shortest safe way."""
    return _planner(taut_string, {}, changes)


def cautious(**changes: float) -> RoutePlanner:
    """The taut string for a map in doubt: wide of the ground, and on to gentle landings (found by search, `tune_swing`)."""
    numbers = dict(clearance=0.48, half_width=0.25, ramp=2.85, reach=0.77, gentle=0.33, press=0.1)
    return _planner(taut_string, numbers, changes)


def _planner(route, kind, changes) -> RoutePlanner:
    numbers = dict(clearance=0.05, preset=0.5, preset_end=1.5, half_width=0.5, ramp=2.0, attraction=10.0, repulsion=1000.0)
    numbers |= dict(reach=1.0, margin=0.1, gentle=0.8, press=0.02) | kind | changes
    check_positive("planner", numbers, ("clearance", "preset", "half_width", "ramp", "attraction", "repulsion", "gentle"))
    return RoutePlanner(**{k: jnp.asarray(v, float) for k, v in numbers.items()}, route=route)


def plan(
    machine: Machine, planner: RoutePlanner, step: Step, local: LocalMap, begin: Float[Array, "2"], preset: Bool[Array, ""]
) -> Route:
    """Route over a map from a point to a landing in En, the preset obstacle (13) in the way or not."""
    return planner.route(view(machine, planner, step, local, begin, preset))


def view(
    machine: Machine, planner: RoutePlanner, step: Step, local: LocalMap, begin: Float[Array, "2"], preset: Bool[Array, ""]
) -> View:
    """What a planner sees of a map from a point."""
    x = points(local)
    left, right = step.start[0] + planner.preset, step.target[0] - planner.preset_end
    block = jnp.where(preset, jnp.stack([left, right, step.start[1] + planner.preset]), -jnp.inf)
    obstacle = with_block(local, *block)
    wide = widened(obstacle, planner.clearance, WINDOW)
    blocked = jnp.cumsum((x > begin[0]) & ~(local.ground <= machine.high)) > 0  # unseen ground blocks, too
    wide = jnp.where(blocked, wide, jnp.minimum(wide, machine.high))
    wide = jnp.where(jnp.isneginf(wide), machine.low, wide)  # nothing is seen there, behind or beyond: in nobody's way
    first = jnp.clip(jnp.sum(x <= begin[0] + 1e-3 * local.spacing) - 1, 0, x.shape[0] - 2)
    lift = jnp.maximum(begin[1], jnp.maximum(wide[first], wide[first + 1]))
    wide, x = wide.at[first].set(jnp.minimum(lift, machine.high)), x.at[first].set(begin[0])
    cost = jnp.where(blocked | (x <= begin[0]), jnp.inf, _landing_cost(machine, planner, step, local))
    gains = jnp.stack([planner.attraction, planner.repulsion, planner.clearance])
    return View(x, local.ground, block, wide, first, begin, cost, step.target[0], planner.press, gains)


def _landing_cost(machine, planner, step, local):
    """Cost of a landing besides the way: none on gentle ground in En, infinite where it could be no support."""
    x, slope = points(local), jnp.abs(jnp.asarray(jnp.gradient(local.ground))) / local.spacing
    inside = jnp.abs(x - step.target[0]) <= machine.allowance - planner.margin + 1e-6
    between = (local.ground >= machine.low) & (local.ground <= machine.high)
    steep = 10.0 * jnp.maximum(slope - planner.gentle, 0.0)
    return jnp.where(inside & between & (slope < machine.dominance), steep, jnp.inf)


def predicted(machine: Machine, planner: RoutePlanner, local: LocalMap, case: Int[Array, ""], at: Sensed) -> LocalMap:
    """The map after a collision: raised to what was felt, with the predicted obstacle of case 3 (14) or 4 (16) joined in."""
    raised = with_felt_error(local, at.point, jnp.maximum(planner.reach, 1e-6))
    ramp = jnp.where(at.slope > 0.0, planner.ramp, -planner.ramp)
    flat, slanted = (
        with_flat_patch(raised, at.point, planner.half_width),
        with_ramp(raised, at.point, planner.half_width, ramp),
    )
    ground = jnp.where(case == Mode.OVER, flat.ground, jnp.where(case == Mode.BACK, slanted.ground, local.ground))
    return local._replace(ground=ground)
