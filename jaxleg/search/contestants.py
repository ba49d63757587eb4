"""The planners of a study: its contestants on each kind of terrain, and which of their numbers a search moves how far.

A search sees of a planner the vector of the numbers that it moves, in the order of `search.move`.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.foothold.rectangle import Extent, SearchRectangle, extent_of
from jaxleg.gait.params import GaitParams
from jaxleg.gait.support import CogRule
from jaxleg.leg.workspace import UNBOUND, Workspace
from jaxleg.planner import Planner
from jaxleg.search.config import Contestants, Gait, Kind, Rectangle, Span, Study
from jaxleg.search.config import Workspace as Bounds
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.walk.presets import paper_a

BASELINES = tuple(field.name for field in dataclasses.fields(Contestants))
STAGES = ("best_i", "best_ii", "best")  # the searches; the first keeps to the paper's band of H_COG
CONTESTANTS = BASELINES + STAGES
STANCE = ("gait.workspace.high", "gait.foot_offset", "gait.skew")  # all that the first two may move
WIDEST = {"behind": 0, "ahead": 1, "low": 0}  # which end of an end's bounds cuts least
LOOSE = {f"gait.workspace.{name}": (getattr(UNBOUND, name), end) for name, end in WIDEST.items()}
WORKSPACE = tuple(f"gait.workspace.{name}" for name in Workspace._fields)
GAIT = (*WORKSPACE, *(f"gait.{field.name}" for field in dataclasses.fields(Gait) if field.name != "workspace"))


def planner_of(study: Study, kind: Kind, gait: Gait) -> Planner:
    """Paper A's planner with the study's numbers, a kind's and a gait's."""
    box, cog, simulation = study.rectangle, study.cog, study.simulation
    lengths = (box.search_length, box.search_width, box.longer, box.nominal_weight, 0.0)
    planner = paper_a(
        gait=dataclasses.replace(gait_params(gait), support=box.support),
        rectangle=SearchRectangle(*(jnp.asarray(x, float) for x in lengths)),
        extent=_extent(study),
        cog=CogRule(jnp.asarray(cog.median_ratio, float), cog.rule),
        speed=study.speed,
        least_bend=np.deg2rad(kind.least_knee_bend_deg),
        clearance=simulation.clearance,
        load_share=simulation.load_share,
        height_threshold=cog.height_threshold,
    )
    return with_leaves(planner, tuple(kind.leaves), jnp.asarray(tuple(kind.leaves.values()), float))


def gait_params(gait: Gait) -> GaitParams:
    """A gait of a configuration as arrays."""
    table = dataclasses.asdict(gait)
    given = {name: bound for name, bound in table.pop("workspace").items() if bound is not None}
    return GaitParams(**jax.tree.map(lambda x: jnp.asarray(x, float), table | {"workspace": UNBOUND._replace(**given)}))


def _extent(study: Study) -> Extent:
    """The cells round a nominal foothold that some planner of the study looks at."""
    box = rectangles(study)[1]
    steps = [getattr(study.contestants, name).step_length for name in BASELINES]
    step = span_of(study, "gait.step_length", steps)[1]
    return extent_of(box.search_length + box.longer, box.search_width, step, study.terrains.resolution)


def rectangles(study: Study) -> tuple[Rectangle, Rectangle]:
    """The smallest and the largest search rectangle of a study."""
    box = study.rectangle
    keys = {"length": "search_length", "width": "search_width", "longer": "longer"}
    spans = {key: span_of(study, f"foothold.rectangle.{leaf}", [getattr(box, key)]) for leaf, key in keys.items()}
    least, most = ({key: span[end] for key, span in spans.items()} for end in (0, 1))
    return dataclasses.replace(box, **least), dataclasses.replace(box, **most)


def span_of(study: Study, leaf: str, fixed: Sequence[float]) -> Span:
    """Least and greatest value of a number in a study: those that are fixed, the kinds' own and, where it moves, its bounds."""
    own = [kind.leaves[leaf] for kind in study.kinds.values() if leaf in kind.leaves]
    values = [*fixed, *own, *(study.bounds[leaf] if leaf in study.search.move else ())]
    return min(values), max(values)


def contestant(study: Study, kind: str, name: str) -> Planner:
    """The planner of a published contestant on a kind of terrain."""
    table, stance = study.kinds[kind], getattr(study.contestants, name)
    return planner_of(study, table, dataclasses.replace(table.gait, **vars(stance)))


def searched_planner(study: Study, kind: str) -> Planner:
    """The planner that a search moves the numbers of: the paper's with the kind's own bounds of the workspace."""
    table, stance = study.kinds[kind], study.contestants.paper
    own = dataclasses.replace(table.gait.workspace, high=stance.workspace.high)
    return planner_of(study, table, dataclasses.replace(table.gait, **vars(stance) | {"workspace": own}))


def baseline(study: Study, kind: str, name: str) -> np.ndarray:
    """What a search moves, of a published contestant on a kind of terrain."""
    return np.asarray(read_leaves(contestant(study, kind, name), study.search.move))


def bounds(study: Study, kind: str, stage: str) -> np.ndarray:
    """Bounds (parameter, 2) of a search; what it does not move has both at the paper's value. An end of the workspace that does
    not bind there has both at the widest that `bounds` allow: what is infinite has no scale."""
    spans = study.bounds | ({"gait.workspace.high": study.band} if stage == "best_i" else {})
    free = study.search.move if stage == "best" else STANCE
    fixed = np.asarray(read_leaves(searched_planner(study, kind), study.search.move)).tolist()
    return np.array([spans[x] if x in free else (_held(spans, x, value),) * 2 for x, value in zip(study.search.move, fixed)])


def _held(spans: Mapping[str, Span], name: str, value: float) -> float:
    unbound, end = LOOSE.get(name, (None, 0))
    return spans[name][end] if value == unbound else value


def contestants(study: Study, kind: str, best: np.ndarray) -> list[Planner]:
    """All planners on a kind, in the order of `CONTESTANTS`; `best` are the searches' vectors (stage, parameter)."""
    own, move = searched_planner(study, kind), study.search.move
    moved = [with_leaves(own, move, jnp.asarray(vector, float)) for vector in best]
    return [*(contestant(study, kind, name) for name in BASELINES), *moved]


def numbers(study: Study, planner: Planner) -> dict[str, float | None]:
    """The numbers of a planner that results name: its gait's, and what else the study moves. A bound that does not bind is
    None."""
    names = tuple(dict.fromkeys((*GAIT, *study.search.move)))
    values = {name: float(str(value)) for name, value in zip(names, np.asarray(read_leaves(planner, names)))}  # exact digits
    loose = {name for name, bound in zip(WORKSPACE, UNBOUND) if values[name] == bound}
    return {short_name(name): None if name in loose else value for name, value in values.items()}


def short_name(leaf: str) -> str:
    """The name of a planner's number in results: as it is, but a gait's number goes by its own name alone."""
    return leaf.removeprefix("gait.")


def with_best(study: Study, chosen: dict[str, np.ndarray]) -> Study:
    """The study with each kind's best numbers in place: the gait's, and in `leaves` those outside it."""
    kinds = {}
    for kind, table in study.kinds.items():
        best = numbers(study, contestants(study, kind, chosen[kind])[-1])
        own = {short_name(name): best.pop(short_name(name)) for name in GAIT}
        workspace = {name: own.pop(f"workspace.{name}") for name in Workspace._fields}
        if workspace["low"] is not None:  # a walk takes a higher one as `high`; a file may not have it
            workspace["low"] = min(workspace["low"], workspace["high"])
        kinds[kind] = dataclasses.replace(table, gait=Gait(Bounds(**workspace), **own), leaves=table.leaves | best)
    return dataclasses.replace(study, kinds=kinds)
