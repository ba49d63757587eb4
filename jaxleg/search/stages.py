"""The search of a study, stage by stage: descents on the proxy, ranking and polish in simulation."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.leg.energy import CONVENTIONS
from jaxleg.search import descent
from jaxleg.search.contestants import STAGES, baseline, bounds, contestant
from jaxleg.search.descent import Lanes, bounded
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.run import STEP_UNITS, Run
from jaxleg.search.sites import make_sites


def training_lanes(state: Run, kind: str) -> Lanes:
    """Training sites of a kind; each lane's baseline energy and its margin floor are those of `traditional` there. What a
    search does not move is the paper's."""
    began = time.perf_counter()
    site = make_sites(state.study, state.robot, kind, held_out=False)
    count = site.valid.shape[0]
    setting = settings_of(contestant(state.study, kind, "paper"), count)

    def measure() -> np.ndarray:
        vectors = np.tile(baseline(state.study, kind, "traditional"), (count, 1))
        alone = settings_of(contestant(state.study, kind, "traditional"), count)
        score, _ = state.lab.proxy_gradients(vectors, site, alone)
        return np.stack([score.energy[:, CONVENTIONS.index(state.study.power)], score.checks.margin])

    energy, margin = state.remember(f"{kind}/baseline", np.zeros((2, count), setting.energy.dtype), measure)
    floor = jnp.asarray(margin + state.study.search.margin_reserve, float)
    state.clock("baseline", began)
    state.tell(2.0, f"{kind}: baseline {np.nanmean(energy):.0f} J/m on {count} training terrains")
    return Lanes(site, setting._replace(margin=floor, energy=jnp.full(count, np.nanmean(energy), float)))


def pooled(training: dict[str, Lanes], group: tuple[str, ...]) -> Lanes:
    """The lanes of a group of kinds, taken in turn."""
    joined = jax.tree.map(lambda *x: jnp.concatenate(x), *(training[kind] for kind in group))
    if len(group) == 1:
        return joined
    order = np.argsort(np.concatenate([np.arange(training[kind].number) for kind in group]), kind="stable")
    return joined.take(order)


def search_group(state: Run, group: tuple[str, ...], training: dict[str, Lanes]) -> np.ndarray:
    """Descend on the proxy from many starts, all three searches at once; returns the end points (stage, start, parameter)."""
    began, study, search = time.perf_counter(), state.study, state.study.search
    name, lanes = "+".join(group), pooled(training, group)
    spans = jnp.asarray(np.repeat([bounds(study, group[0], stage) for stage in STAGES], search.starts, axis=0), float)
    known = jnp.asarray(np.stack([baseline(study, group[0], c) for c in ("traditional", "paper")]), float)
    key = jax.random.fold_in(jax.random.key(study.seed), 100 + state.kinds.index(group[0]))
    optimiser = descent.make_optimiser(search.learning_rate, search.steps)
    points = descent.start(key, known, spans, search.starts, optimiser)
    points = state.folder.load(f"{name}/descent", points) or points
    while int(points.step) < search.steps:
        points, objective = descent.descend(state.lab, lanes, spans, points, search.lanes, optimiser)
        step = int(points.step)
        for stage, values in zip(STAGES, objective.reshape(len(STAGES), -1)):
            row = {"kind": name, "stage": stage, "step": step, "best": float(values.min()), "mean": float(values.mean())}
            state.folder.append_history(row | {"seconds": round(time.perf_counter() - began, 3)})
        if step % 10 == 0 or step == search.steps:
            state.folder.save(f"{name}/descent", points)
        state.tell(STEP_UNITS, f"{name}: step {step} of {search.steps}, best {objective.min():.3f} of the baseline")
    state.clock("descent", began)
    return np.asarray(bounded(points.free, spans)).reshape(len(STAGES), search.starts, -1)


def rank(state: Run, group: tuple[str, ...], training: dict[str, Lanes], ends: np.ndarray) -> np.ndarray:
    """The best of each search (stage, parameter): the proxy on more terrains than a step saw, then simulation of the best."""
    began, search = time.perf_counter(), state.study.search
    lanes = pooled(training, group)

    def compute() -> np.ndarray:
        """The best start of each search, by simulation of the proxy's best."""
        few = spread(lanes, search.rank_lanes)
        flat = ends.reshape(-1, ends.shape[-1])
        objective = judge(lambda *x: state.lab.proxy_gradients(*x)[0].objective, flat, few)
        pools = [np.argsort(objective[: (i + 1) * search.starts])[: search.candidates] for i in range(len(ends))]
        candidates = sorted(set(np.concatenate(pools)))  # each search contains the one before it, and so its end points
        simulated = dict(zip(candidates, judge(lambda *x: simulated_objective(state.lab, *x), flat[candidates], few)))
        return flat[[min(pool, key=simulated.__getitem__) for pool in pools]]

    chosen = state.remember(f"{'+'.join(group)}/ranked", np.zeros(ends[:, 0].shape, ends.dtype), compute)
    state.clock("rank", began)
    state.tell(10.0, f"{'+'.join(group)}: best starts ranked in simulation")
    return chosen


def polish(state: Run, group: tuple[str, ...], training: dict[str, Lanes], best: np.ndarray) -> np.ndarray:
    """Improve the last search's answer by gradients of the simulation itself; a step that does not help is halved."""
    began, study, search = time.perf_counter(), state.study, state.study.search
    lanes = spread(pooled(training, group), search.polish_lanes)
    span = jnp.asarray(bounds(study, group[0], STAGES[-1]), float)

    def compute() -> np.ndarray:
        """All searches' answers, the last one's after its steps downhill."""
        free, rate = descent.unbounded(jnp.asarray(best[-1]), span, least=1e-3), search.polish_rate
        kept, value, gradient = free, *simulated_gradient(state.lab, bounded(free, span), lanes)
        for step in range(search.polish_steps):
            slope = descent.free_gradient(kept, span, gradient)
            free = _downhill(kept, slope, rate)
            new_value = judge(lambda *x: simulated_objective(state.lab, *x), np.asarray(bounded(free, span))[None], lanes)[0]
            better = new_value < value
            kept, value, rate = (free, new_value, rate) if better else (kept, value, 0.5 * rate)
            if better and step + 1 < search.polish_steps:
                _, gradient = simulated_gradient(state.lab, bounded(kept, span), lanes)
        return np.concatenate([best[:-1], np.asarray(bounded(kept, span))[None]])

    if search.polish_steps:
        best = state.remember(f"{'+'.join(group)}/polished", np.zeros_like(best), compute)
    state.clock("polish", began)
    state.tell(10.0, f"{'+'.join(group)}: polished with the simulation's gradients")
    return best


@jax.jit
def _downhill(free, slope, rate):
    return free - rate * slope / jnp.maximum(jnp.linalg.norm(slope), 1e-12)


def spread(lanes: Lanes, count: int) -> Lanes:
    """`count` lanes spread evenly over all, or all where there are fewer."""
    return lanes.take(np.linspace(0, lanes.number - 1, min(count, lanes.number)).round().astype(int))


def judge(objective: Callable[..., np.ndarray], vectors: np.ndarray, lanes: Lanes) -> np.ndarray:
    """Mean objective of each vector over the lanes; a lane that cannot be judged costs ten times the baseline."""
    rows = jnp.asarray(np.repeat(vectors, lanes.number, axis=0))
    many = lanes.take(np.tile(np.arange(lanes.number), len(vectors)))
    values = objective(rows, many.site, many.setting).reshape(len(vectors), -1)
    return np.where(np.isfinite(values), values, 10.0).mean(axis=1)


def simulated_objective(lab: Lab, *lanes: Any) -> np.ndarray:
    """Objective of each lane in simulation; not finite for a fallen one."""
    score, meters = lab.simulate_lanes(*lanes)
    return np.where(meters.fell, np.inf, score.objective)


def simulated_gradient(lab: Lab, vector: jax.Array, lanes: Lanes) -> tuple[float, jax.Array]:
    """Mean objective and gradient of one vector over the lanes, in simulation; lanes without a finite gradient stay out."""
    rows = jnp.asarray(np.tile(vector, (lanes.number, 1)))
    score, meters, gradient = lab.simulate_gradients(rows, lanes.site, lanes.setting)
    usable = ~meters.fell & np.isfinite(gradient).all(axis=1)
    value = np.where(usable, score.objective, 10.0).mean()
    return float(value), jnp.asarray(np.where(usable[:, None], gradient, 0.0).mean(axis=0))
