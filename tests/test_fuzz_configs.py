"""Spoiled study files, seeded: none a traceback, none slow; what is read is built and walks, or has a named status."""

import copy
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

from jaxleg.cli.study import leg_numbers
from jaxleg.conventions import InputError
from jaxleg.search.checks import check_study
from jaxleg.search.config import Kind, Study
from jaxleg.search.contestants import contestant
from jaxleg.search.navigate import navigator_of
from jaxleg.search.sites import grid, terrain_settings
from jaxleg.settings import load, to_table
from jaxleg.status import Status
from jaxleg.terrain import Grid, flat
from jaxleg.walk.proxy import evaluate
from tests.crawls import Options, crawl
from tests.test_fuzz_robots import CHANGES

pytestmark = pytest.mark.slow

SECONDS, FILES = 5.0, 600
GROUND = flat(Grid(112, 52, 0.02, (-0.9, -0.51)))
TABLE = to_table(Study(kinds={"flat": Kind(), "rough": Kind("rough", leaves={"swing.clearance": 0.03})}))
BARE = ["", "speed", "= 1", "[kinds", "kinds = 3\n", "[kinds.flat]\ngait = 1\n", "\0", "[[kinds]]\n", "seed = 0x\n"]


def places(table, path=()):
    """Paths of all tables and values."""
    for key, value in table.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from places(value, (*path, key))


def put(table, path, value):
    table = copy.deepcopy(table)
    inner = table
    for key in path[:-1]:
        inner = inner[key]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return table


def at(table, path):
    for key in path:
        table = table[key]
    return table


def plain(value):
    """Tuples as lists: what `each` in CHANGES knows."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    return [plain(entry) for entry in value] if isinstance(value, tuple) else value


def spoiled():
    """(name, text) of every spoiled file."""
    rng, table = np.random.default_rng(0), plain(TABLE)
    paths, words = list(places(table)), [*CHANGES, "left out", "misspelt"]
    for text in BARE:
        yield f"text {text!r}", text
    for _ in range(FILES):
        path, word = paths[rng.integers(len(paths))], words[rng.integers(len(words))]
        value = at(table, path)
        try:
            if word == "misspelt":
                changed = put(put(table, path, None), (*path[:-1], path[-1] + "x"), value)
            else:
                changed = put(table, path, None if word == "left out" else CHANGES[word](value))
            yield f"{'.'.join(path)} {word}", tomli_w.dumps(changed)
        except TypeError:  # what cannot be done to this value, or TOML cannot say
            continue


@pytest.fixture(scope="module")
def walk(pegasus):
    """Energy, distance and checks of a gait on level ground in single precision; compiled once for each rule."""
    single = lambda tree: jax.tree.map(lambda x: jnp.asarray(x, jnp.float32) if x.dtype == jnp.float64 else x, tree)  # noqa: E731
    none = jnp.zeros((3, 4, 2), jnp.float32), jnp.zeros((3, 4), jnp.int32)
    robot, ground = single(pegasus), single(GROUND)

    @jax.jit
    def lane(gait, options):
        seen = evaluate(robot, crawl(robot, gait, options, ground, *none))
        return jax.tree.map(jnp.sum, seen.energy), seen.distance, seen.checks

    def of(study, kind):
        planner = single(contestant(study, kind, "traditional"))
        posture, swing = planner.posture, planner.swing
        numbers = planner.timing.speed, planner.limits.knee_bend, swing.clearance, swing.load_share
        return lane(planner.gait, Options(*numbers, posture.cog, posture.height_threshold))

    return of


def test_every_spoiled_study_is_refused_in_a_sentence_or_walks_by_finite_numbers(walk, pegasus, tmp_path):
    legs, path = leg_numbers(pegasus), tmp_path / "study.toml"
    refused, statuses, count = 0, [], 0
    for name, text in spoiled():
        count += 1
        path.write_text(text)
        began = time.perf_counter()
        try:
            study = load(Study, path)
            check_study(study, str(path), legs)
        except InputError as error:
            refused += 1
            message = str(error)
            if not message.startswith(f"{path}: ") or "\n" in message:
                pytest.fail(f"{name}: {message}")
            continue
        finally:
            assert time.perf_counter() - began < SECONDS, name
        statuses += used(walk, pegasus, study, name)
    print(count, "files", refused, "refused", np.bincount(statuses))
    assert count >= 300
    assert 0.4 * count < refused < 0.95 * count
    assert np.mean(np.array(statuses) == Status.OK) > 0.9


def used(walk, robot, study, name):
    """Build what a study asks for and walk each of its kinds; the statuses."""
    statuses = []
    for kind, table in study.kinds.items():
        assert np.isfinite([grid(study).resolution, *vars(terrain_settings(table)).values()]).all(), name
        navigator = navigator_of(study, robot, table.gait, study.terrains.resolution)
        assert not any(np.isnan(x).any() for x in jax.tree.leaves(navigator.planner)), name  # no bound is infinity
        energy, distance, checks = walk(study, kind)
        numbers = np.concatenate([np.ravel(x) for x in jax.tree.leaves((energy, distance, checks[:-1]))])
        assert np.isfinite(numbers).all() or checks.status != Status.OK, (name, numbers)
        statuses.append(int(checks.status))
    return statuses
