"""What the experiments share: the quickstart's lab and terrains, timing, and where results go."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxleg.about import about
from jaxleg.cli import configure_jax
from jaxleg.cli.start import cache_folder
from jaxleg.files import write_json
from jaxleg.robot import load_robot
from jaxleg.search.config import Study, robot_path
from jaxleg.search.contestants import BASELINES, contestant, searched_planner
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.run import make_lab
from jaxleg.search.sites import make_sites
from jaxleg.search.training import Lanes
from jaxleg.settings import load

CONFIG = Path(__file__).parent.parent / "configs" / "quickstart.toml"


def setup(config: Path = CONFIG) -> tuple[Study, Lab]:
    """A study, the quickstart's, and its lab, with JAX configured as in the command line."""
    configure_jax()
    study = load(Study, config)
    return study, make_lab(study, load_robot(robot_path(study, config)), cache_folder())


def training(study: Study, lab: Lab, kind: str, held_out: bool = False) -> Lanes:
    """Training lanes of a kind, or held-out ones, judged by energy alone (J/m), no margin floor; what a vector
    does not hold is the searched planners'."""
    site = make_sites(study, lab.robot, kind, held_out)
    return Lanes(site, settings_of(searched_planner(study, kind), site.valid.shape[0]))


def each_on_its_own(study: Study, kind: str, lanes: Lanes, names: Sequence[str]) -> Lanes:
    """All lanes once for each contestant of these names, with what no vector holds as that contestant has it: the paper's own
    workspace, say. A name that is no published contestant's is a searched planner's."""
    planners = [contestant(study, kind, name) if name in BASELINES else searched_planner(study, kind) for name in names]
    settings = [settings_of(planner, lanes.number) for planner in planners]
    return lanes.take(np.tile(np.arange(lanes.number), len(names)))._replace(
        setting=jax.tree.map(lambda *x: np.concatenate(x), *settings)
    )


def timed(function: Callable[..., Any], *arguments: Any, repeats: int = 3) -> float:
    """Least wall time [s] of a call that is already compiled."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - began)
    return min(times)


def write(name: str, out: Path | None, result: dict[str, Any]) -> None:
    """Write runs/NAME/result.json with versions and hardware beside the numbers."""
    folder = out or Path("runs") / name
    write_json(folder / "result.json", result | about())
    print(f"written: {folder / 'result.json'}")
