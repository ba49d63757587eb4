"""Spoiled robot files, seeded: none a traceback, none slow; what is read walks, by finite numbers or by a named status."""

import copy
import itertools
import time
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tomli_w

from jaxleg.conventions import InputError
from jaxleg.gait.limits import leg_length
from jaxleg.robot import load_robot
from jaxleg.status import Status
from jaxleg.terrain import Grid, flat
from jaxleg.walk.proxy import evaluate
from tests.crawls import crawl, gait, settings

pytestmark = pytest.mark.slow

ROBOTS = Path(__file__).parents[1] / "configs/robots"
SECONDS = 5.0
GROUND = flat(Grid(112, 52, 0.02, (-0.9, -0.51)))
CHANGES = {
    "nothing": lambda x: 0,
    "negative": lambda x: each(x, lambda v: -v - 1e-3),
    "tiny": lambda x: each(x, lambda v: 1e-300),
    "huge": lambda x: each(x, lambda v: 1e300),
    "endless": lambda x: 10**400,
    "nan": lambda x: each(x, lambda v: float("nan")),
    "inf": lambda x: each(x, lambda v: float("inf")),
    "thousandfold": lambda x: each(x, lambda v: 1e3 * v),
    "a thousandth": lambda x: each(x, lambda v: 1e-3 * v),
    "tenfold": lambda x: each(x, lambda v: 10.0 * v),
    "a tenth": lambda x: each(x, lambda v: 0.1 * v),
    "in radians": lambda x: each(x, np.deg2rad),
    "in degrees": lambda x: each(x, np.rad2deg),
    "a text": lambda x: "a lot",
    "true": lambda x: True,
    "a table": lambda x: {"value": 1.0},
    "an empty list": lambda x: [],
    "reversed": lambda x: x[::-1] if isinstance(x, list) else [x, x],
}


def each(value, change):
    if isinstance(value, list):
        return [float(change(v)) for v in value]
    return float(change(value)) if isinstance(value, float | int) else value


def tables():
    """Both robots of the package with every key given."""
    for name in ("pegasus", "dh_quadruped"):
        table = tomllib.loads((ROBOTS / f"{name}.toml").read_text())
        ranges = {f"{joint}_range_deg": [-180.0, 180.0] for joint in ("hip", "thigh", "knee")}
        table["geometry"] = ranges | table["geometry"]
        yield name, table


def places(table):
    return [(part, key) for part in ("geometry", "masses", "motor") for key in table[part]]


def spoiled():
    """(name, table) of every spoiled file."""
    rng = np.random.default_rng(0)
    for robot, table in tables():
        for (part, key), (word, change) in itertools.product(places(table), CHANGES.items()):
            if rng.random() < 0.5:
                yield f"{robot}: {key} {word}", changed(table, {(part, key): change(table[part][key])})
        for part, key in [*places(table), ("", "name")]:
            broken = copy.deepcopy(table)
            del (broken[part] if part else broken)[key]
            yield f"{robot}: without {key}", broken
        for _ in range(40):
            (a, b), (c, d) = (places(table)[i] for i in rng.choice(len(places(table)), 2, replace=False))
            yield f"{robot}: {b} for {d}", changed(table, {(a, b): table[c][d], (c, d): table[a][b]})
        for _ in range(60):
            chosen = [places(table)[i] for i in rng.choice(len(places(table)), 3, replace=False)]
            factors = np.exp(rng.uniform(-3.0, 3.0, 3))
            new = {(p, k): each(table[p][k], lambda v, f=f: f * v) for (p, k), f in zip(chosen, factors)}
            yield f"{robot}: {', '.join(k for _, k in chosen)} by chance", changed(table, new)
        yield f"{robot}: without masses", {key: value for key, value in table.items() if key != "masses"}
        yield f"{robot}: a key too many", changed(table, {("motor", "torque"): 1.0})


def changed(table, values):
    table = copy.deepcopy(table)
    for (part, key), value in values.items():
        table[part][key] = value
    return table


@pytest.fixture(scope="module")
def walk():
    """Energy, distance and checks of two gaits in single precision, Pegasus's and one as large as the robot; compiled once."""
    single = lambda tree: jax.tree.map(lambda x: jnp.asarray(x, jnp.float32) if x.dtype == jnp.float64 else x, tree)  # noqa: E731
    ground, options = single(GROUND), single(settings())
    none = jnp.zeros((3, 4, 2), jnp.float32), jnp.zeros((3, 4), jnp.int32)

    def lane(robot, params):
        seen = evaluate(robot, crawl(robot, params, options, ground, *none))
        return jax.tree.map(jnp.sum, seen.energy), seen.distance, seen.checks

    run = jax.jit(jax.vmap(lane, in_axes=(None, 0)))

    def both(robot):
        scale = leg_length(robot) / 0.6
        sizes = jax.tree.map(lambda x: jnp.stack([x, x * scale]), gait(hind=0.5))
        shares = {name: jnp.stack([getattr(gait(), name)] * 2) for name in ("shift_share", "hind_share", "lift_share")}
        params = type(sizes)(**(vars(sizes) | shares))
        return jax.tree.map(np.asarray, run(single(robot), single(params)))

    return both


def read(path):
    """The robot of a file, or the sentence that refuses it; and the seconds it took."""
    began = time.perf_counter()
    try:
        robot, sentence = load_robot(path), ""
    except InputError as error:
        robot, sentence = None, str(error)
    return robot, sentence, time.perf_counter() - began


def test_every_spoiled_robot_is_refused_in_a_sentence_or_walks_by_finite_numbers(walk, tmp_path):
    load_robot(ROBOTS / "pegasus.toml")  # what is compiled or imported once
    path, refused, statuses, count = tmp_path / "robot.toml", 0, [], 0
    for name, table in spoiled():
        path.write_text(tomli_w.dumps(table))
        robot, sentence, seconds = read(path)
        count, refused = count + 1, refused + bool(sentence)
        assert seconds < SECONDS, name
        if robot is None:
            assert sentence.startswith(f"{path}: "), name
            assert "\n" not in sentence, name
            continue
        energy, distance, checks = walk(robot)
        parts = jax.tree.leaves((energy, distance, checks[:-1]))
        numbers = np.concatenate([np.reshape(x, (2, -1)) for x in parts], axis=1)
        assert (np.isfinite(numbers).all(axis=1) | (checks.status != Status.OK)).all(), (name, numbers, checks.status)
        statuses += list(checks.status)
    assert count >= 300
    assert refused > 0.4 * count
    assert np.mean(np.array(statuses) == Status.OK) > 0.2, np.bincount(statuses)
