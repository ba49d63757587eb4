"""The published planners: which parts and numbers make paper A and paper C."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxleg.foothold.cascade import Cascade
from jaxleg.foothold.ranked import Ranked
from jaxleg.foothold.rectangle import Extent, SearchRectangle
from jaxleg.gait.limits import half_step_skew
from jaxleg.gait.params import GaitParams
from jaxleg.gait.support import CogRule
from jaxleg.gait.timing import ByAcceleration, BySpeed
from jaxleg.planner import Limits, Planner
from jaxleg.posture.incentre import Incentre
from jaxleg.posture.plane import Plane
from jaxleg.route.stations import Along, Straight
from jaxleg.series.candidates import Adjustments, Counts
from jaxleg.series.kinds import Greedy, Tree
from jaxleg.swing.clearance import Cycloid
from jaxleg.walk.config import Navigation


def paper_a(
    gait: GaitParams,
    rectangle: SearchRectangle,
    extent: Extent,
    cog: CogRule,
    speed: Float[ArrayLike, ""],
    least_bend: Float[ArrayLike, ""],
    clearance: Float[ArrayLike, ""] = 0.02,
    load_share: Float[ArrayLike, ""] = 0.1,
    height_threshold: Float[ArrayLike, ""] = 0.0,
) -> Planner:
    """Paper A: the energy-saving stance on a straight way, its footholds by the cascade, at a speed [m/s] with a least
    knee bend [rad]. Lengths [m]."""
    dtype = gait.step_length.dtype
    speed, bend, clear, load, threshold = (
        jnp.asarray(x, dtype) for x in (speed, least_bend, clearance, load_share, height_threshold)
    )
    return Planner(
        gait=gait,
        route=Straight(rectangle.heading),
        foothold=Cascade(rectangle, bend, extent),
        posture=Incentre(cog, threshold),
        series=Greedy(),
        timing=BySpeed(speed),
        swing=Cycloid(clear, load),
        limits=Limits(bend, jnp.zeros((), dtype)),
    )


def paper_c(settings: Navigation, gait: GaitParams, load_share: float, clearance: float, resolution: float) -> Planner:
    """Paper C: static gaits along a body path, by tree search, on maps of a resolution [m per cell]. Lengths [m].

    Of the gait it takes stance, step, H_COG and swing height; its stance has no skew but (4)'s and no L_F2H.
    """
    tree, pose, pace = settings.tree, settings.pose, settings.pace
    zero = jnp.zeros((), float)
    gait = dataclasses.replace(gait, skew=half_step_skew(gait.step_length), foot_offset=zero, lift_share=zero + pace.lift_share)
    degrees = np.deg2rad([tree.pitch_step_deg, tree.roll_step_deg, pose.least_knee_bend_deg, settings.path.turn_deg])
    pitch, roll, bend, turn = (zero + x for x in degrees)
    half = 0.5 * float(np.hypot(tree.search_length, tree.search_width))
    rectangle = (zero + x for x in (tree.search_length, tree.search_width, tree.cost_weight, tree.distance_weight))
    limits = (pace.acceleration, pace.least_shift, pace.reserve, pace.foot_speed, pace.least_swing)
    return Planner(
        gait=gait,
        route=Along(turn),
        foothold=Ranked(*rectangle, int(np.ceil(half / resolution)), tree.footholds),
        posture=Plane(CogRule(zero + pose.median_ratio, pose.rule), zero + pose.target_weight, zero + pose.levelling),
        series=Tree(
            adjustments=Adjustments(zero + tree.height_step, pitch, roll),
            budget=jnp.asarray(tree.budget, jnp.int32),
            energy_weight=zero + tree.energy_weight,
            energy=zero + tree.energy,
            acceleration=zero + pace.acceleration,
            swing_time=zero + pace.least_swing / (1.0 - 2.0 * load_share),
            counts=Counts(tree.footholds, tree.rolls, tree.pitches, tree.heights),
            depth=tree.depth,
            order=tree.order,
            prune=tree.prune,
        ),
        timing=ByAcceleration(*(zero + x for x in limits)),
        swing=Cycloid(zero + clearance, zero + load_share),
        limits=Limits(bend, zero + pose.least_margin),
        standing=True,
    )
