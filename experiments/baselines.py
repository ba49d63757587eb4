"""What does a saving owe to the choice of the baseline? The paper does not say what its "before" was.

The paper's parameters and ours against a grid of possible "traditional" settings at 0.012 m/s under "net" power: H_COG, L_F2H
centre, skew none or half a step; the centre of mass midway between the hips and 0.1 m behind; and with a constant loss.
Powers are those of the plan's inverse dynamics, which simulation follows within 2 %; stairs include a stand of 35 s in 265 s.

    python -m experiments.baselines [--quick]
"""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import CONFIG, each_on_its_own, setup, training, write
from experiments.slow_walk import SPEED, STAND_SHARE, search_gait, slow
from jaxleg.batch import over_lanes
from jaxleg.leg.energy import CONVENTIONS, electrical, motor_power
from jaxleg.robot import RobotFile, build_robot
from jaxleg.search.config import Study, robot_path
from jaxleg.search.contest import keeps_limits
from jaxleg.search.contestants import baseline, contestant
from jaxleg.search.lanes import Lab
from jaxleg.search.leaves import read_leaves, with_leaves
from jaxleg.settings import load
from jaxleg.viz.baselines import draw_baselines
from jaxleg.walk.reference import phase_instant

NET = CONVENTIONS.index("net")
HEIGHTS, OFFSETS = np.linspace(0.44, 0.50, 7), np.linspace(-0.10, 0.10, 9)  # H_COG, L_F2H centre [m]
STANCE = ("gait.skew", "gait.workspace.high", "gait.foot_offset")
SKEWS = {"no skew": 0.0, "skew of half a step": 0.1}  # [m]
MASSES = {"midway": 0.0, "0.1 m behind": -0.1}  # centre of mass from the hips' centre, fore and aft [m]
NEAR = 0.2  # percentage points between two pairs of savings that count as the same
LOSSES = np.linspace(0.0, 0.9, 91)  # constant loss as a share of the baseline's power
PAPER = {"average power": {"flat": 10.2, "stairs": 6.9}, "sums": {"flat": 12.0, "stairs": 7.94}}  # Table I [%]


class Power(NamedTuple):
    """Net power of gaits (leading axis) on one kind of terrain [W] and planned stability margin [m], means over terrains."""

    power: np.ndarray  # NaN where a terrain cannot be walked
    margin: np.ndarray


def main(out: Path | None = None, quick: bool = False) -> None:
    """Evaluate the grid, print the cells nearest to the paper, draw them; `quick` takes fewer terrains and a short search."""
    study, lab = slow(*setup(), 6 if quick else 24)
    ours = {kind: search_gait(study, lab, kind, quick) for kind in ("flat", "stairs")}
    rows = [row for name, shift in MASSES.items() for row in grid_rows(study, with_mass(lab, shift), name, ours)]
    matches = {name: nearest(rows, target) for name, target in PAPER.items()}
    for name, match in matches.items():
        print(f"{name}, paper {PAPER[name]['flat']} % flat and {PAPER[name]['stairs']} % stairs, is nearest to")
        for title in ("as it is", "with a constant loss"):
            cell = match[title]
            print(f"  {title}: {describe(cell)}; {cell['cells']} cells within {NEAR} points, losses {cell['losses']}")
    write("baselines", out, {"rows": rows, "nearest": matches, "paper": PAPER, "speed": SPEED})
    folder = out or Path("runs") / "baselines"
    for name in ("paper", "ours"):
        draw_baselines(rows, name, matches, folder / f"baselines_{name}.png")


def with_mass(lab: Lab, shift: float) -> Lab:
    """The lab with the trunk's centre of mass moved fore and aft [m]."""
    file = load(RobotFile, robot_path(load(Study, CONFIG), CONFIG))
    masses = dataclasses.replace(file.masses, com_offset=(shift, 0.0, 0.0))
    return dataclasses.replace(lab, robot=build_robot(dataclasses.replace(file, masses=masses)))


def grid_rows(study: Study, lab: Lab, mass: str, ours: dict[str, np.ndarray]) -> list[dict[str, Any]]:
    """One row a cell of the grid: its power, the paper's and our saving [%] on both kinds of terrain."""
    cells = [(skew, h, x) for skew in SKEWS for h in HEIGHTS for x in OFFSETS]
    rows = [dict(mass=mass, skew=s, hip_height=round(h, 3), foot_offset=round(x, 3)) for s, h, x in cells]
    for kind in ("flat", "stairs"):
        traditional = contestant(study, kind, "traditional")
        planners = [with_leaves(traditional, STANCE, jnp.asarray((SKEWS[s], h, x))) for s, h, x in cells]
        before = [read_leaves(planner, lab.move) for planner in planners]
        names = ["paper", "ours", *["traditional"] * len(before)]
        seen = powers(study, lab, kind, np.stack([baseline(study, kind, "paper"), ours[kind], *before]), names)
        for i, row in enumerate(rows):
            saving = {name: 100.0 * (1.0 - seen.power[k] / seen.power[i + 2]) for k, name in enumerate(("paper", "ours"))}
            row[kind] = {"power_w": seen.power[i + 2], "margin": seen.margin[i + 2], "saving": saving}
    return jax.tree.map(lambda x: None if isinstance(x, float) and not np.isfinite(x) else x, jax.tree.map(as_number, rows))


def as_number(x: Any) -> Any:
    """A plain float for a NumPy one."""
    return float(x) if isinstance(x, np.floating) else x


def powers(study: Study, lab: Lab, kind: str, vectors: np.ndarray, names: list[str]) -> Power:
    """Power of each gait, of the contestants of these names, on the training terrains of a kind; on stairs with the share of
    the time that is stood."""
    lanes = training(study, lab, kind)
    count = 1 if kind == "flat" else lanes.number
    many = each_on_its_own(study, kind, lanes.take(np.arange(count)), names)
    rows = np.repeat(vectors, count, axis=0).astype(np.float32)
    walk, stand, margin, feasible = over_lanes(lambda *x: judge(lab, *x), lab.chunk)(rows, many.site, many.setting)
    share = STAND_SHARE if kind == "stairs" else 0.0
    power = np.where(feasible, (1.0 - share) * walk + share * stand, np.nan)
    return Power(power.reshape(-1, count).mean(axis=1), margin.reshape(-1, count).min(axis=1))


def judge(lab: Lab, vector, site, setting):
    """Net power walking and standing in the first pose [W], least margin [m], whether the lane can be walked."""
    choice = lab.choose(vector, site, setting)
    score = lab.proxy(vector, site, choice, setting)
    walk = lab.walk(vector, site, choice, setting)
    first = jax.tree.map(lambda x: x[0], walk.phases)
    torque = phase_instant(lab.robot, first, jnp.zeros((), vector.dtype), walk.load_share).torque
    stand = jnp.sum(electrical(motor_power(lab.robot, torque, jnp.zeros_like(torque)), "net"))
    return score.energy[NET] * SPEED, stand, score.checks.margin, keeps_limits(score.checks, setting.least_bend)


def nearest(rows: list[dict[str, Any]], target: dict[str, float]) -> dict[str, Any]:
    """The cells whose savings with the paper's parameters come nearest to the paper's, without and with a constant loss.

    A loss that no posture changes, a share of the baseline's power, scales every saving by what it leaves.
    """
    pairs = [(row, savings(row)) for row in rows]
    pairs = [(row, pair) for row, pair in pairs if pair is not None]
    wanted = np.array([target["flat"], target["stairs"]])
    found = {}
    for title, shares in (("as it is", LOSSES[:1]), ("with a constant loss", LOSSES)):
        misses = np.array([[np.linalg.norm((1.0 - share) * pair - wanted) for share in shares] for _, pair in pairs])
        i, j = np.unravel_index(misses.argmin(), misses.shape)
        cell = {key: pairs[i][0][key] for key in ("mass", "skew", "hip_height", "foot_offset")}
        pair = (1.0 - shares[j]) * pairs[i][1]
        found[title] = cell | {"loss": float(shares[j]), "flat": pair[0], "stairs": pair[1], "miss": float(misses[i, j])}
        found[title] |= matching(misses, shares)
    return jax.tree.map(as_number, found)


def matching(misses: np.ndarray, shares: np.ndarray) -> dict[str, Any]:
    """How many cells come within `NEAR` of the paper with some loss, and with which."""
    near = np.flatnonzero(misses.min(axis=1) < NEAR)
    losses = shares[misses[near].argmin(axis=1)]
    return {"within": NEAR, "cells": len(near), "losses": [losses.min(), losses.max()] if len(near) else []}


def savings(row: dict[str, Any]) -> np.ndarray | None:
    """Savings [%] of the paper's parameters on flat ground and stairs against a cell, or None."""
    pair = [row[kind]["saving"]["paper"] for kind in ("flat", "stairs")]
    return None if None in pair else np.array(pair)


def describe(cell: dict[str, Any]) -> str:
    """A cell and what the paper's parameters save against it."""
    place = f"H_COG {cell['hip_height']:.2f} m, L_F2H {cell['foot_offset']:+.3f} m, {cell['skew']}, mass {cell['mass']}"
    loss = f", {100 * cell['loss']:.0f} % of the power lost anyway" if cell["loss"] else ""
    return f"{place}{loss}: {cell['flat']:.1f} % flat, {cell['stairs']:.1f} % stairs"


if __name__ == "__main__":
    tyro.cli(main)
