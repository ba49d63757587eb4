"""The figures of a study's run folder, from its result and its history."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxleg.search.config import Study
from jaxleg.search.contestants import searched_planner, short_name
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.sites import make_sites
from jaxleg.viz.gait import gait
from jaxleg.viz.results import energy
from jaxleg.viz.search import history, parameters
from jaxleg.viz.torque import torque_maps


def study_pictures(study: Study, lab: Lab, result: dict[str, Any], history_file: Path) -> dict[str, Callable[[Path], None]]:
    """Torque maps, energies, search history, parameters in their bounds, and the best gait on a terrain of each kind.

    By file name, the functions that draw them to a path.
    """
    first = next(iter(study.kinds))
    before, after = (result[name][first]["params"] for name in ("traditional", "best"))
    return {
        "torque_maps.png": functools.partial(torque_maps, lab.robot, before, after),
        "energy.png": functools.partial(energy, result),
        "history.png": functools.partial(history, history_file),
        "parameters.png": functools.partial(parameters, result),
        **{f"gait_{kind}.png": functools.partial(_best_gait, study, lab, result, kind) for kind in study.kinds},
    }


def _best_gait(study: Study, lab: Lab, result: dict[str, Any], kind: str, path: Path) -> None:
    """The best gait on the last held-out terrain of a kind; no picture where it cannot be planned."""
    site = jax.tree.map(lambda x: x[-1:], make_sites(study, lab.robot, kind, held_out=True))
    vector = jnp.asarray([[result["best"][kind]["params"][short_name(name)] for name in lab.move]], float)
    plan = lab.plan_lanes(vector, site, settings_of(searched_planner(study, kind), 1))
    walk, track, terrain = jax.tree.map(lambda x: x[0], (plan.walk, plan.reference, site.terrain))
    if np.isfinite(track.joint_torque).all():
        gait(lab.robot, walk, track, terrain, path)
