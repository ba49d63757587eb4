"""A study from start to end: search per kind of terrain, ranking and polish in simulation, the contest on held-out terrains.

Each stage's answer goes into the run folder as soon as it is there; a resumed study takes it from there and goes on, so it
reaches the same answer. `run` returns the content of `result.json`.
"""

import dataclasses
import time
from collections.abc import Callable
from importlib.metadata import version
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.energy import CONVENTIONS
from jaxleg.planning.footholds import SearchRectangle
from jaxleg.robot import Robot
from jaxleg.search import agreement, descent, referees
from jaxleg.search.config import BASELINES, MOVED, PARAMETERS, Study, baseline, bounds
from jaxleg.search.contest import Contest, active_constraints, contest, nested, savings, summary
from jaxleg.search.descent import Lanes, bounded
from jaxleg.search.lanes import CONSTRAINTS, CYCLES, Lab, Setting
from jaxleg.search.run_folder import RunFolder
from jaxleg.search.sites import make_sites
from jaxleg.sim.contact import Ground

STAGES = tuple(MOVED)
CONTESTANTS = BASELINES + STAGES
UNBOUND = -10.0  # a margin floor [m] that never binds
STEP_UNITS = 0.4  # units of work of a step of the descent


class Report(Protocol):
    """Where progress goes: `done` units of `total`, and a line on what is going on."""

    def __call__(self, done: float, text: str) -> None: ...


def make_lab(study: Study, robot: Robot) -> Lab:
    """The lab of a study: everything its lanes share."""
    table, sim = study.rectangle, study.simulation
    numbers = (table.search_length, table.search_width, table.longer, table.nominal_weight, 0.0)
    rectangle = SearchRectangle(*(jnp.asarray(x, float) for x in numbers))
    half = np.array([0.5 * (table.search_length + table.longer), 0.5 * table.search_width])
    cells = tuple(int(n) for n in np.floor(half / study.terrains.resolution + 1e-3))
    return Lab(
        robot=robot,
        rectangle=rectangle,
        ground=Ground(friction=sim.friction),
        speed=study.speed,
        clearance=sim.clearance,
        load_share=sim.load_share,
        cells=cells,
        samples=(sim.shift_samples, sim.swing_samples),
        steps=sim.steps,
        chunk=sim.chunk,
        convention=study.power,
    )


def work(study: Study) -> float:
    """Units of work of a whole study, about a second each: what `Report` counts up to."""
    groups = 1 if study.one_for_all else len(study.kinds)
    return STEP_UNITS * study.search.steps * groups + 20.0 * groups + 18.0 * len(study.kinds) + 10.0


@dataclasses.dataclass
class Run:
    """One run of a study: its settings, its folder and what is shared between the stages."""

    study: Study
    robot: Robot
    folder: RunFolder
    report: Report

    def __post_init__(self) -> None:
        self.lab = make_lab(self.study, self.robot)
        self.kinds = tuple(self.study.kinds)
        self.seconds: dict[str, float] = {}
        self.done = 0.0

    def tell(self, units: float, text: str) -> None:
        """Report progress by so many units of work."""
        self.done += units
        self.report(self.done, text)

    def remember(self, stage: str, like: Any, compute: Callable[[], Any]) -> Any:
        """The stage's answer from the run folder, or computed now and saved there."""
        saved = self.folder.load(stage, like)
        if saved is None:
            saved = compute()
            self.folder.save(stage, saved)
        return saved

    def clock(self, stage: str, began: float) -> None:
        """Add the seconds since `began` to a stage's time."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - began


def run(study: Study, robot: Robot, folder: RunFolder, report: Report) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Run (or resume) a study; returns its result and the searched parameter vectors (stage, parameter) of each kind. Raises nothing of its own: failures are counted in the result."""
    state = Run(study, robot, folder, report)
    began = time.perf_counter()
    chosen, held, replays = {}, {}, {}
    groups = [state.kinds] if study.one_for_all else [(kind,) for kind in state.kinds]
    for group in groups:
        training = {kind: training_lanes(state, kind) for kind in group}
        best = rank(state, group, training, search_group(state, group, training))
        best = polish(state, group, training, best)
        chosen |= dict.fromkeys(group, best)
    for kind in state.kinds:
        held[kind] = held_out(state, kind, chosen[kind])
    proxy = check_proxy(state)
    for kind in state.kinds:
        replays[kind] = referee(state, kind, chosen[kind])
    state.seconds["total"] = time.perf_counter() - began
    return assemble(state, chosen, held, replays, proxy), chosen


def training_lanes(state: Run, kind: str) -> Lanes:
    """Training sites of a kind; each lane's baseline energy and its margin floor are those of `traditional` there."""
    began = time.perf_counter()
    site = make_sites(state.study, float(state.robot.foot_radius), kind, held_out=False)
    count = site.valid.shape[0]
    bend = jnp.full(count, np.deg2rad(state.study.kinds[kind].least_knee_bend_deg), float)
    setting = Setting(bend, jnp.full(count, UNBOUND, float), jnp.ones(count, float))

    def measure() -> np.ndarray:
        vectors = jnp.tile(jnp.asarray(baseline(state.study, kind, "traditional"), float), (count, 1))
        score, _ = state.lab.proxy_gradients(vectors, site, setting)
        return np.stack([score.energy[:, CONVENTIONS.index(state.study.power)], score.checks.margin])

    energy, margin = state.remember(f"{kind}/baseline", np.zeros((2, count), setting.energy.dtype), measure)
    floor = jnp.asarray(margin + state.study.search.margin_reserve, float)
    state.clock("baseline", began)
    state.tell(2.0, f"{kind}: baseline {np.nanmean(energy):.0f} J/m on {count} training terrains")
    return Lanes(site, Setting(bend, floor, jnp.full(count, np.nanmean(energy), float)))


def pooled(training: dict[str, Lanes], group: tuple[str, ...]) -> Lanes:
    """The lanes of a group of kinds, taken in turn."""
    joined = jax.tree.map(lambda *x: jnp.concatenate(x), *(training[kind] for kind in group))
    if len(group) == 1:
        return joined
    ends = np.cumsum([training[kind].count for kind in group])
    order = np.argsort(np.concatenate([np.arange(training[kind].count) for kind in group]), kind="stable")
    assert len(order) == ends[-1]
    return joined.take(order)


def search_group(state: Run, group: tuple[str, ...], training: dict[str, Lanes]) -> np.ndarray:
    """Descend on the proxy from many starts, all three searches at once; returns the end points (stage, start, parameter)."""
    began, study, search = time.perf_counter(), state.study, state.study.search
    name, lanes = "+".join(group), pooled(training, group)
    spans = jnp.asarray(np.repeat([bounds(study, group[0], stage) for stage in STAGES], search.starts, axis=0), float)
    known = jnp.asarray(np.stack([baseline(study, group[0], c) for c in ("traditional", "paper")]), float)
    key = jax.random.fold_in(jax.random.key(study.seed), 100 + state.kinds.index(group[0]))
    points = descent.start(key, known, spans, search.starts, search.learning_rate)
    points = state.folder.load(f"{name}/descent", points) or points
    while int(points.step) < search.steps:
        points, objective = descent.descend(state.lab, lanes, spans, points, search.lanes, search.learning_rate)
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
    """The best of each search (stage, parameter): the proxy over all training terrains, then MJX for the best few."""
    began, study, search = time.perf_counter(), state.study, state.study.search
    lanes = pooled(training, group)

    def compute() -> np.ndarray:
        some = spread(lanes, min(4 * search.rank_lanes, lanes.count))
        objective = judge(lambda *x: state.lab.proxy_gradients(*x)[0].objective, ends.reshape(-1, ends.shape[-1]), some)
        order = np.argsort(objective.reshape(ends.shape[:2]), axis=1)[:, : search.candidates]
        best = np.take_along_axis(ends, order[..., None], axis=1)
        few = spread(lanes, min(search.rank_lanes, lanes.count))
        objective = judge(lambda *x: simulated_objective(state.lab, *x), best.reshape(-1, best.shape[-1]), few)
        winner = np.argmin(objective.reshape(best.shape[:2]), axis=1)
        return best[np.arange(len(best)), winner]

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
        free, rate = descent.unbounded(jnp.asarray(best[-1]), span, least=1e-3), search.polish_rate
        kept, value, gradient = free, *simulated_gradient(state.lab, bounded(free, span), lanes)
        for step in range(search.polish_steps):
            slope = descent.free_gradient(kept, span, gradient)
            free = kept - rate * slope / jnp.maximum(jnp.linalg.norm(slope), 1e-12)
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


def spread(lanes: Lanes, count: int) -> Lanes:
    """`count` lanes spread evenly over all, each again from the start where there are fewer."""
    return lanes.take(np.linspace(0, lanes.count - 1, count).round().astype(int))


def judge(objective: Callable[..., np.ndarray], vectors: np.ndarray, lanes: Lanes) -> np.ndarray:
    """Mean objective of each vector over the lanes; a lane that cannot be judged costs ten times the baseline."""
    rows = jnp.repeat(jnp.asarray(vectors), lanes.count, axis=0)
    many = lanes.take(np.tile(np.arange(lanes.count), len(vectors)))
    values = objective(rows, many.site, many.setting).reshape(len(vectors), -1)
    return np.where(np.isfinite(values), values, 10.0).mean(axis=1)


def simulated_objective(lab: Lab, *lanes: Any) -> np.ndarray:
    """Objective of each lane in MJX; not finite for a fallen one."""
    score, meters = lab.simulate_lanes(*lanes)
    return np.where(meters.fell, np.inf, score.objective)


def simulated_gradient(lab: Lab, vector: jax.Array, lanes: Lanes) -> tuple[float, jax.Array]:
    """Mean objective and gradient of one vector over the lanes, in MJX; lanes without a finite gradient stay out."""
    rows = jnp.tile(vector, (lanes.count, 1))
    score, meters, gradient = lab.simulate_gradients(rows, lanes.site, lanes.setting)
    usable = ~meters.fell & np.isfinite(gradient).all(axis=1)
    value = np.where(usable, score.objective, 10.0).mean()
    return float(value), jnp.asarray(np.where(usable[:, None], gradient, 0.0).mean(axis=0))


def contestants(study: Study, kind: str, best: np.ndarray) -> np.ndarray:
    """Parameter vectors of all contestants on a kind, in the order of `CONTESTANTS`."""
    return np.concatenate([[baseline(study, kind, name) for name in BASELINES], best])


def held_out_lanes(state: Run, kind: str, best: np.ndarray) -> tuple[np.ndarray, Lanes]:
    """All contestants on all held-out terrains of a kind, contestant by contestant."""
    site = make_sites(state.study, float(state.robot.foot_radius), kind, held_out=True)
    vectors, count = contestants(state.study, kind, best), site.valid.shape[0]
    bend = np.deg2rad(state.study.kinds[kind].least_knee_bend_deg)
    numbers = (jnp.full(count, x, float) for x in (bend, UNBOUND, 1.0))
    lanes = Lanes(site, Setting(*numbers)).take(np.tile(np.arange(count), len(vectors)))
    return np.repeat(vectors, count, axis=0), lanes


def held_out(state: Run, kind: str, best: np.ndarray) -> Contest:
    """Simulate all contestants on the kind's held-out terrains; margins' slack is against the traditional baseline's."""
    began = time.perf_counter()
    vectors, lanes = held_out_lanes(state, kind, best)

    def compute() -> Contest:
        score, meters = state.lab.simulate_lanes(jnp.asarray(vectors, float), lanes.site, lanes.setting)
        seen = contest(score, meters, np.asarray(lanes.setting.least_bend), len(CONTESTANTS))
        return with_margin_slack(seen, score.checks.margin.reshape(len(CONTESTANTS), -1))

    result = state.remember(f"{kind}/held_out", empty_contest(len(CONTESTANTS), len(vectors) // len(CONTESTANTS)), compute)
    state.clock("held_out", began)
    state.tell(8.0, f"{kind}: contestants compared on {result.fell.shape[1]} held-out terrains")
    return result


def with_margin_slack(seen: Contest, margin: np.ndarray) -> Contest:
    """Put the slack of the planned margin against the traditional baseline's in its place."""
    slack = seen.slack.copy()
    slack[..., CONSTRAINTS.index("margin")] = margin - margin[CONTESTANTS.index("traditional")]
    return seen._replace(slack=slack)


def empty_contest(count: int, lanes: int) -> Contest:
    """A contest of the right shapes and types, to load a saved one into."""
    number, flag = np.zeros((count, lanes), np.asarray(jnp.zeros((), float)).dtype), np.zeros((count, lanes), bool)
    by_convention, by_constraint = (np.zeros((count, lanes, n), number.dtype) for n in (3, len(CONSTRAINTS)))
    return Contest(by_convention, number, number, number, number, number, number, flag, flag, by_constraint)


def check_proxy(state: Run) -> dict[str, Any]:
    """Proxy against simulation over random feasible gaits, in equal shares on the kinds that are not stairs."""
    began, study = time.perf_counter(), state.study
    kinds = [kind for kind in state.kinds if study.kinds[kind].generator != "stairs"] or list(state.kinds)
    count = study.search.proxy_gaits // len(kinds)

    def compute() -> agreement.Agreement:
        parts = []
        for kind in kinds:
            site = make_sites(study, float(state.robot.foot_radius), kind, held_out=False)
            size = site.valid.shape[0]
            bend = np.deg2rad(study.kinds[kind].least_knee_bend_deg)
            lanes = Lanes(site, Setting(*(jnp.full(size, x, float) for x in (bend, UNBOUND, 1.0))))
            span = bounds(study, kind, STAGES[-1])
            key = jax.random.fold_in(jax.random.key(study.seed), 200 + state.kinds.index(kind))
            parts.append((*agreement.random_gaits(state.lab, key, lanes, span, count), span))
        vectors = np.concatenate([part[0] for part in parts])
        lanes = jax.tree.map(lambda *x: jnp.concatenate(x), *(part[1] for part in parts))
        return agreement.compare(state.lab, vectors, lanes, parts[0][2])

    like = empty_agreement(count * len(kinds))
    result = agreement.agreement(state.remember("proxy", like, compute))
    state.clock("proxy", began)
    state.tell(10.0, "proxy compared with simulation")
    return result


def empty_agreement(count: int) -> agreement.Agreement:
    """An agreement of the right shapes and types, to load a saved one into."""
    number = np.zeros(count, np.asarray(jnp.zeros((), float)).dtype)
    gradient = np.zeros((count, len(PARAMETERS)), number.dtype)
    return agreement.Agreement(number, number, gradient, gradient, np.zeros(count, bool))


def referee(state: Run, kind: str, best: np.ndarray) -> Contest:
    """Replay contestants on some held-out terrains in C MuJoCo."""
    began, study = time.perf_counter(), state.study
    count = min(
        study.search.referee_terrains // len(state.kinds),
        make_sites(study, float(state.robot.foot_radius), kind, held_out=True).valid.shape[0],
    )
    vectors, lanes = held_out_lanes(state, kind, best)
    total = len(vectors) // len(CONTESTANTS)
    pick = np.linspace(0, total - 1, count).round().astype(int)
    index = (np.arange(len(CONTESTANTS))[:, None] * total + pick).reshape(-1)
    result = state.remember(
        f"{kind}/referee",
        empty_contest(len(CONTESTANTS), count),
        lambda: referees.replay_contest(state.lab, vectors[index], lanes.take(index), len(CONTESTANTS)),
    )
    state.clock("referee", began)
    state.tell(8.0, f"{kind}: {count} held-out terrains replayed in C MuJoCo")
    return result


def assemble(state: Run, chosen: dict, held: dict, replays: dict, proxy: dict) -> dict[str, Any]:
    """The content of `result.json`."""
    study, search = state.study, state.study.search
    options = (search.resamples, study.seed)
    mass = float(state.robot.mass)
    table = {}
    for kind in state.kinds:
        vectors = contestants(study, kind, chosen[kind])
        table[kind] = {
            name: summary(held[kind], i, vectors[i], study.power, mass, *options) for i, name in enumerate(CONTESTANTS)
        }
    active = {
        kind: {
            name: active_constraints(held[kind], len(BASELINES) + i, chosen[kind][i], bounds(study, kind, name))
            for i, name in enumerate(STAGES)
        }
        for kind in state.kinds
    }

    def against(base: str) -> dict[str, Any]:
        engines = {"mjx": held, "mujoco": replays}
        return {
            engine: nested({kind: savings(data[kind], CONTESTANTS, base, *options) for kind in state.kinds})
            for engine, data in engines.items()
        }

    return {
        **nested(table),
        "saving": against("traditional"),
        "saving_vs_implied": against("implied"),
        "saving_vs_paper": against("paper"),
        "active_constraints": nested(active),
        "bounds": {kind: dict(zip(PARAMETERS, bounds(study, kind, "best").tolist())) for kind in state.kinds},
        "proxy": proxy,
        "power": study.power,
        "speed": study.speed,
        "least_knee_bend_deg": {kind: study.kinds[kind].least_knee_bend_deg for kind in state.kinds},
        "timing": state.seconds,
        "terrains": {
            "train": study.terrains.train,
            "held_out": study.terrains.held_out,
            "referee": sum(replays[kind].fell.shape[1] for kind in state.kinds),
            "cycles": CYCLES,
        },
        "seed": study.seed,
        "versions": {name: version(name) for name in ("jaxleg", "jax", "mujoco", "mujoco-mjx", "numpy", "optax")},
    }
