"""Contestants on the same held-out terrains: paired savings with bootstrap intervals, and what each costs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxleg.foothold.contract import FootholdStatus
from jaxleg.leg.energy import CONVENTIONS, cost_of_transport
from jaxleg.leg.workspace import Workspace
from jaxleg.search.lanes import CONSTRAINTS, Score
from jaxleg.sim.meters import Meters
from jaxleg.status import Status
from jaxleg.walk.data import PlanChecks

BEND_SLACK = np.deg2rad(0.2)  # a knee bend or a joint's range counts as kept down to this much beyond the limit
BINDING = (np.deg2rad(0.5), 0.005, 0.05, 0.05, np.deg2rad(0.5), 0.01, 0.01, 0.01, 0.005, 0.002)
ACTIVE = dict(zip(CONSTRAINTS, BINDING, strict=True))  # slack that counts as binding
BASES = {"saving": "traditional", "saving_vs_implied": "implied", "saving_vs_paper": "paper"}  # of a result's savings


class Contest(NamedTuple):
    """What a set of contestants did on the lanes of a kind; arrays (contestant, lane)."""

    energy: np.ndarray  # by convention, last axis [J/m]
    distance: np.ndarray  # [m]
    time: np.ndarray  # [s]
    slip: np.ndarray  # mean of the feet [m]
    margin: np.ndarray  # least stability margin in simulation [m]
    bend: np.ndarray  # least knee bend [rad]
    lowering: np.ndarray  # [m]
    used: np.ndarray  # smallest workspace that the feet stood in (behind, ahead, low, high), last axis [m]
    inside: np.ndarray  # share of the feet's places that are inside their own
    found: np.ndarray  # share of the footholds by `FootholdStatus`, last axis
    fell: np.ndarray
    infeasible: np.ndarray  # not plannable, or the knee bend or a joint's range not kept
    slack: np.ndarray  # by constraint, last axis

    @property
    def usable(self) -> np.ndarray:
        """Lanes that count: planned within the constraints and walked without a fall."""
        return ~(self.fell | self.infeasible) & np.isfinite(self.energy).all(axis=-1)


def contest(score: Score, meters: Meters, least_bend: np.ndarray, contestants: int) -> Contest:
    """Arrange flat lanes (contestant by contestant) for comparison."""
    fields = Contest(
        energy=score.energy,
        distance=meters.moved[..., 0],
        time=meters.time,
        slip=meters.slip.mean(axis=-1),
        margin=meters.margin,
        bend=score.checks.knee_bend,
        lowering=score.checks.lowering,
        used=np.stack(score.checks.used, axis=-1),
        inside=score.checks.inside,
        found=score.checks.found,
        fell=meters.fell,
        infeasible=~keeps_limits(score.checks, least_bend),
        slack=score.slack,
    )
    return Contest(*(x.reshape(contestants, -1, *x.shape[1:]) for x in fields))


def keeps_limits(checks: PlanChecks, least_bend: Any) -> Any:
    """Whether a plan can be walked with its knees bent enough [rad] and its joints within their ranges."""
    within = (checks.knee_bend >= least_bend - BEND_SLACK) & (checks.joint_room >= -BEND_SLACK)
    return within & (checks.status == Status.OK)


def bootstrap(
    values: np.ndarray, resamples: int, seed: int, of: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> dict[str, Any]:
    """The mean of lanes (leading axis), or what is made `of` means (last axes), and its 95 % interval over resampled lanes.

    Null without a lane; of a single lane there is no interval.
    """
    values = np.asarray(values, float)
    if len(values) < 2:
        return {"mean": float(of(values.mean(axis=0))) if len(values) else None, "ci95": None}
    index = np.random.default_rng(seed).integers(0, len(values), (resamples, len(values)))
    spread = of(values[index].mean(axis=1))
    return {"mean": float(of(values.mean(axis=0))), "ci95": [float(x) for x in np.percentile(spread, [2.5, 97.5])]}


def saving(ours: np.ndarray, base: np.ndarray, resamples: int, seed: int) -> dict[str, Any]:
    """Saving 1 - mean(ours) / mean(base) of paired energies [J/m] at equal speed, with its interval."""
    return bootstrap(np.stack([ours, base], axis=-1), resamples, seed, lambda means: 1.0 - means[..., 0] / means[..., 1])


def savings(
    held: Contest, names: Sequence[str], against: str, resamples: int, seed: int
) -> dict[str, dict[str, dict[str, Any]]]:
    """Savings of the searched contestants against one other, by contestant and convention; pairs where both are usable."""
    base = names.index(against)
    table: dict[str, Any] = {}
    for i, name in enumerate(names):
        if name.startswith("best"):
            both = held.usable[i] & held.usable[base]
            table[name] = {
                convention: saving(held.energy[i, both, c], held.energy[base, both, c], resamples, seed)
                for c, convention in enumerate(CONVENTIONS)
            }
    return table


def savings_by_engine(
    seen: Mapping[str, Mapping[str, Contest]], names: Sequence[str], resamples: int, seed: int
) -> dict[str, Any]:
    """`savings` against each of `BASES`, from contests by engine and kind of terrain."""
    return {
        key: {
            engine: nested({kind: savings(each, names, base, resamples, seed) for kind, each in contests.items()})
            for engine, contests in seen.items()
        }
        for key, base in BASES.items()
    }


def summary(
    held: Contest, i: int, params: Mapping[str, float | None], power: str, mass: float, resamples: int, seed: int
) -> dict[str, Any]:
    """One contestant on one kind of terrain, for `result.json`; `params` are its planner's numbers by name."""
    on = held.usable[i]
    energy = {convention: bootstrap(held.energy[i, on, c], resamples, seed) for c, convention in enumerate(CONVENTIONS)}
    speed = _mean(held.distance[i, on] / held.time[i, on])
    mean = energy[power]["mean"]
    return {
        "params": params,
        "energy_per_metre": energy,
        "cost_of_transport": None if mean is None else float(cost_of_transport(mean, mass)),
        "mean_power_w": None if mean is None else mean * speed,
        "speed": speed,
        **failed(held, i),
        "min_stability_margin": _least(held.margin[i, on]),
        "min_knee_bend_deg": _least(np.rad2deg(held.bend[i, on])),
        "lowering": _mean(held.lowering[i, on]),
        "slip": _mean(held.slip[i, on]),
    }


def workspace(held: Contest, i: int, params: Mapping[str, float | None]) -> dict[str, Any]:
    """A contestant's workspace on one kind of terrain, for `result.json`: its bounds, the one that its feet used, how far they
    were inside and how the footholds were found, over the lanes that it walks."""
    on = held.usable[i]
    ends = dict(zip(Workspace._fields, held.used[i, on].T))
    most = {"behind": np.min, "ahead": np.max, "low": np.min, "high": np.max}
    return {
        "bounds": {name: params[f"workspace.{name}"] for name in ends},
        "used": {name: float(most[name](values)) if len(values) else None for name, values in ends.items()},
        "inside": _mean(held.inside[i, on]),
        "found": {status.name.lower(): _mean(held.found[i, on, status]) for status in FootholdStatus},
    }


def failed(held: Contest, i: int) -> dict[str, int]:
    """A contestant's lanes, how many of them fell, and how many could not be walked at all, which do not count as falls."""
    infeasible = held.infeasible[i]
    falls = int((held.fell[i] & ~infeasible).sum())
    return {"lanes": infeasible.size, "falls": falls, "infeasible": int(infeasible.sum())}


def failures(held: Contest, i: int) -> dict[str, float]:
    """Shares of a contestant's lanes that fell, and that could not be walked at all."""
    seen = failed(held, i)
    lanes = seen["lanes"] or float("nan")
    return {"fell": seen["falls"] / lanes, "infeasible": seen["infeasible"] / lanes}


def active_constraints(held: Contest, i: int, params: Mapping[str, Any], bounds: Mapping[str, Sequence[float]]) -> list[str]:
    """Names of the constraints and bounds that bind a contestant: the least slack over its lanes is within `ACTIVE`."""
    on = held.usable[i]
    if not on.any():
        return []
    slack = held.slack[i, on].min(axis=0)
    names = [name for name, value in zip(CONSTRAINTS, slack) if value < ACTIVE[name]]
    for name, (low, high) in bounds.items():
        if high > low:
            share = (params[name] - low) / (high - low)
            names += [f"{name} at its lower bound"] * bool(share < 0.02) + [f"{name} at its upper bound"] * bool(share > 0.98)
    return names


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if len(values) else None


def _least(values: np.ndarray) -> float | None:
    return float(values.min()) if len(values) else None


def nested(per_kind: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Turn kind -> contestant -> value into contestant -> kind -> value."""
    names = list(next(iter(per_kind.values())))
    return {name: {kind: table[name] for kind, table in per_kind.items()} for name in names}
