"""The crawl on a terrain: from footholds to a `Walk` of phases. Paper A, Sections II.A and IV.

`crawl` is one lane; `vmap` it over parameters and terrains. Given the chosen offsets everything is differentiable in the
gait parameters and the map.
"""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEFT_LEGS, RIGHT_LEGS
from jaxleg.gait.nominal import nominal_stances
from jaxleg.gait.order import PHASES, SHIFT, SWING_LEG
from jaxleg.gait.params import GaitParams
from jaxleg.posture.incentre import CogPlan, held_heights, lowering_needed, waypoint
from jaxleg.robot import Robot
from jaxleg.swing.cycloid import cycloid_advance, cycloid_lift
from jaxleg.terrain.heightmap import HeightMap, height, height_and_gradient
from jaxleg.walk.data import Phases, Walk
from jaxleg.walk.trajectory import foot_path, trunk_path

SIDES = ((LEFT_LEGS, RIGHT_LEGS), (RIGHT_LEGS, LEFT_LEGS))  # (standing, swinging) in each half of a cycle


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class CrawlSettings:
    """What a crawl is planned with besides the gait parameters; every field a leaf."""

    speed: Float[Array, "*batch"]  # mean forward speed over the walk [m/s]; all its cycles take the same time
    least_knee_bend: Float[Array, "*batch"]  # the trunk is lowered until every leg keeps it [rad]
    clearance: Float[Array, "*batch"]  # between the foot and the ground in mid-swing [m]
    load_share: Float[Array, "*batch"]  # part of a swing phase at either end in which the load is transferred
    cog: CogPlan


def crawl(
    robot: Robot,
    params: GaitParams,
    settings: CrawlSettings,
    terrain: HeightMap,
    offsets: Float[Array, "stance leg 2"],
    status: Int[Array, "stance leg"],
) -> Walk:
    """Plan a walk of `stance - 1` cycles along +x from the nominal footholds plus chosen `offsets` (x, y) [m]."""
    cycles = offsets.shape[0] - 1
    footholds = on_ground(robot, terrain, nominal_stances(params, 0, cycles + 1) + offsets)
    earlier = on_ground(robot, terrain, nominal_stances(params, -1, 1)[0] + offsets[0])
    poses, feet_from, feet_to = _stages(robot, params, settings.cog, footholds, earlier)
    advance = (poses[-1, 0] - poses[0, 0]) / cycles
    cycle_time = jnp.full(cycles, 1.0, advance.dtype) * advance / settings.speed
    phases = _phases(params, terrain, robot, settings, poses, feet_from, feet_to, cycle_time)
    lowering = _lowering(robot, params, settings, phases)
    down = jnp.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]], lowering.dtype) * lowering
    phases = phases._replace(trunk_from=phases.trunk_from + down, trunk_to=phases.trunk_to + down)
    return Walk(params, footholds, status, poses + down, cycle_time, lowering, phases)


def on_ground(robot: Robot, terrain: HeightMap, xy: Float[Array, "*n 2"]) -> Float[Array, "*n 3"]:
    """Foot centres [m] that rest on the ground at xy: the contact sphere touches the tangent plane there."""
    sample = height_and_gradient
    for _ in xy.shape[:-1]:
        sample = jax.vmap(sample, in_axes=(None, 0))
    ground, slope = sample(terrain, xy)
    return jnp.concatenate([xy, (ground + robot.contact_radius * jnp.sqrt(1.0 + jnp.sum(slope**2, -1)))[..., None]], -1)


def _stages(robot, params, cog, footholds, earlier):
    """Trunk poses (before the first shift, then after each), and the feet before and after each of the six phases."""
    left = jnp.zeros(4, bool).at[jnp.array(LEFT_LEGS)].set(True)[:, None]
    before, after, starts, ends = [jnp.where(left, earlier, footholds[0])], [footholds[0]], [], []
    feet = footholds[0]
    for target in footholds[1:]:
        for _, swinging in SIDES:
            mid = feet.at[swinging[1]].set(target[swinging[1]])
            landed = mid.at[swinging[0]].set(target[swinging[0]])
            before.append(feet)
            after.append(landed)
            starts += [feet, feet, mid]
            ends += [feet, mid, landed]
            feet = landed
    sides = jnp.array(SIDES[1:] + SIDES * (footholds.shape[0] - 1))
    pose = jax.vmap(waypoint, in_axes=(None, None, None, 0, 0, 0, 0))
    poses = pose(robot, params, cog, jnp.stack(before), jnp.stack(after), sides[:, 0], sides[:, 1])
    poses = poses.at[:, 2].set(held_heights(poses[:, 2], cog.height_threshold))
    return poses, jnp.stack(starts), jnp.stack(ends)


def phase_shares(params: GaitParams) -> Float[Array, "6"]:
    """Each phase's part of the cycle's time; they sum to 1."""
    swing = 1.0 - params.shift_share
    half = jnp.stack([params.shift_share, swing * params.hind_share, swing * (1.0 - params.hind_share)])
    return 0.5 * jnp.concatenate([half, half])


def _phases(params, terrain, robot, settings, poses, feet_from, feet_to, cycle_time):
    cycles = cycle_time.shape[0]
    duration = (cycle_time[:, None] * phase_shares(params)[None]).reshape(-1)
    start = jnp.cumsum(duration) - duration
    swings = jnp.tile(jax.nn.one_hot(jnp.array(SWING_LEG), 4, dtype=poses.dtype), (cycles, 1))
    trunk_to = jnp.repeat(poses[1:], PHASES // 2, axis=0)
    shifting = (jnp.array(SWING_LEG * cycles) == SHIFT)[:, None]
    trunk_from = jnp.where(shifting, jnp.repeat(poses[:-1], PHASES // 2, axis=0), trunk_to)
    legs = jnp.array([max(leg, 0) for leg in SWING_LEG] * cycles)
    pick = jnp.arange(PHASES * cycles)
    raised = jax.vmap(_apex, in_axes=(None, None, None, None, 0, 0))(
        robot, params, settings, terrain, feet_from[pick, legs], feet_to[pick, legs]
    )
    return Phases(start, duration, trunk_from, trunk_to, feet_from, feet_to, raised[:, None] * swings, swings)


def _apex(robot, params, settings, terrain, start, end):
    """Apex above the higher end: the swing height, raised until the foot clears the ground at nine places of its way."""
    shares = jnp.array([0.15, 0.22, 0.3, 0.4, 0.5, 0.6, 0.7, 0.78, 0.85], start.dtype)
    along = jnp.clip((shares - params.lift_share) / (1.0 - 2.0 * params.lift_share), 0.0, 1.0)
    way = end[:2] - start[:2]
    path = start[None, :2] + way[None] * cycloid_advance(along)[:, None]
    reach = jnp.stack([jnp.zeros_like(way), jnp.stack([robot.foot_radius, 0.0 * way[1]])])
    disc = path[:, None] + jnp.stack([-reach[1], reach[0], reach[1]])[None]
    ground = jnp.max(jax.vmap(jax.vmap(height, in_axes=(None, 0)), in_axes=(None, 0))(terrain, disc), axis=1)
    base = jnp.where(shares < 0.5, start[2], end[2])
    lift = cycloid_lift(shares)
    top = base + (ground + robot.contact_radius + settings.clearance * lift - base) / lift
    return jnp.maximum(jnp.max(top) - jnp.maximum(start[2], end[2]), params.swing_height)


def _lowering(robot, params, settings, phases):
    """The trunk's lowering over the whole walk: distances to a fixed foot peak at the ends of a phase, swings in between."""
    shares = jnp.linspace(0.0, 1.0, 5, dtype=phases.start.dtype)

    def at(phase, share):
        pose, feet = trunk_path(phase, share), foot_path(phase, share, params.lift_share, settings.load_share)
        return lowering_needed(robot, pose, feet, settings.least_knee_bend)[0]

    return jnp.max(jax.vmap(lambda share: jax.vmap(at, in_axes=(0, None))(phases, share))(shares))
