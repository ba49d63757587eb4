"""The contest again, refereed by C MuJoCo: the same plans, an independent simulator."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.leg.energy import CONVENTIONS, Power, electrical
from jaxleg.robot import Robot
from jaxleg.search.contest import Contest, keeps_limits
from jaxleg.search.lanes import Lab
from jaxleg.search.training import Lanes
from jaxleg.search.worlds import set_down
from jaxleg.sim.referee import replay_each
from jaxleg.terrain.heightmap import HeightMap


def replay_contest(lab: Lab, vectors: np.ndarray, lanes: Lanes, contestants: int) -> Contest:
    """Replay lanes (contestant by contestant) in C MuJoCo; constraints are those of the plan."""
    plan = lab.plan_lanes(jnp.asarray(vectors, float), lanes.site, lanes.setting)
    robots, terrain, frictions = _truth(lab, len(vectors), lanes)
    tracks = plan.reference if lanes.truth is None else jax.vmap(set_down)(plan.reference, lanes.site.terrain, terrain)
    seen = replay_each(robots, *(unstack(jax.tree.map(np.asarray, tree)) for tree in (terrain, tracks)), frictions)
    power = Power(*(jnp.asarray(x) for x in seen.energy))
    total = np.stack([np.asarray(electrical(power, convention)) for convention in CONVENTIONS], axis=-1)
    way = seen.moved[:, :1]
    energy = np.divide(total, way, out=np.full(total.shape, np.nan), where=way != 0.0)  # a fall at once goes nowhere
    infeasible = ~keeps_limits(plan.checks, np.asarray(lanes.setting.least_bend))
    number = plan.slack.dtype
    fields = (energy, way[:, 0], seen.time, seen.slip, seen.margin)
    numbers = [np.asarray(x, number) for x in fields] + [plan.checks.knee_bend, plan.checks.lowering]
    numbers += [np.stack(plan.checks.used, axis=-1), plan.checks.inside, plan.checks.found]
    data = Contest(*numbers, seen.fell, infeasible, plan.slack)
    return Contest(*(x.reshape(contestants, -1, *x.shape[1:]) for x in data))


def _truth(lab: Lab, count: int, lanes: Lanes) -> tuple[list[Robot], HeightMap, list[float]]:
    """Robots, terrains (leading axis lane) and frictions of so many lanes."""
    if lanes.truth is None:
        return [lab.robot] * count, lanes.site.terrain, [float(lab.ground.friction)] * count
    robot, ground, terrain = jax.tree.map(np.asarray, lanes.truth)
    return unstack(robot), terrain, ground.friction.tolist()


def unstack(tree):
    """A list of trees from one with a leading axis."""
    count = jax.tree.leaves(tree)[0].shape[0]
    return [jax.tree.map(lambda x, i=i: x[i], tree) for i in range(count)]
