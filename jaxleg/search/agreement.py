"""Does the proxy tell the truth? Proxy against simulation over random feasible gaits: order and bias."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array

from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search.lanes import LEAST_LOAD, Lab
from jaxleg.search.training import Lanes
from jaxleg.status import Status
from jaxleg.walk.data import PlanChecks

LEAST_MARGIN = 0.02  # static walking needs some stability margin [m]


class Agreement(NamedTuple):
    """Energies per metre [J/m] of the same lanes, both ways."""

    proxy: np.ndarray
    simulated: np.ndarray
    fell: np.ndarray
    usable: np.ndarray  # feasible, walked without a fall, finite


def random_gaits(
    lab: Lab, key: Array, lanes: Lanes, bounds: np.ndarray, count: int, tries: int = 20
) -> tuple[np.ndarray, Lanes]:
    """Gaits uniform in the bounds that are `feasible` on their terrain; where too few are found, infeasible ones fill up."""
    vectors = np.array(jax.random.uniform(key, (count * tries, bounds.shape[0]), minval=bounds[:, 0], maxval=bounds[:, 1]))
    index = np.arange(len(vectors)) % lanes.number
    found: list[int] = []
    block = lab.chunk * 2
    for start in range(0, len(vectors), block):
        part = np.arange(start, min(start + block, len(vectors)))
        some = lanes.take(index[part])
        checks = lab.models(vectors[part], some.site, some.setting, np.zeros_like(vectors[part])).score.checks
        found += list(part[feasible(checks)])
        if len(found) >= count:
            break
    others = np.setdiff1d(np.arange(count), found)
    chosen = np.array([*found, *others], int)[:count]
    return vectors[chosen], lanes.take(index[chosen])


def feasible(checks: PlanChecks) -> np.ndarray:
    """Planned, knee bend kept without lowering, some stability margin, torques and joints in limits, no foot near lifting."""
    stands = (checks.status == Status.OK) & (checks.margin > LEAST_MARGIN) & (checks.torque_ratio < 1.0)
    return np.asarray(stands & (checks.lowering == 0.0) & (checks.load > LEAST_LOAD) & (checks.joint_room >= 0.0))


def compare(lab: Lab, vectors: np.ndarray, lanes: Lanes) -> Agreement:
    """Energy of each lane by the proxy and by simulation."""
    score = lab.models(vectors, lanes.site, lanes.setting, np.zeros_like(vectors)).score
    simulated, meters = lab.simulate_lanes(vectors, lanes.site, lanes.setting)
    convention, fell = CONVENTIONS.index(lab.convention), np.asarray(meters.fell) & feasible(score.checks)
    energies = score.energy[:, convention], simulated.energy[:, convention]
    return Agreement(*energies, fell, feasible(score.checks) & ~fell & np.isfinite(energies[1]))


def agreement(data: Agreement) -> dict[str, Any]:
    """Spearman's rank correlation and the mean relative bias; None each where fewer than three gaits can be compared."""
    from scipy.stats import spearmanr  # 1 s, which only a study need pay

    on = data.usable
    counts = {"gaits": int(on.sum()), "falls": int(data.fell.sum())}
    if counts["gaits"] < 3:
        return counts | dict.fromkeys(("spearman", "bias"))
    proxy, simulated = data.proxy[on], data.simulated[on]
    bias = float(np.mean(proxy / simulated - 1.0))
    return counts | {"spearman": float(spearmanr(proxy, simulated).statistic), "bias": bias}
