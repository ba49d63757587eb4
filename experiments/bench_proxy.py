"""What does judging a plan cost? CPU time a lane of choosing and laying out a walk, of its energy proxy with and without the
gradient, and of the reference that controllers follow; on each ground of the quickstart.

The baseline planner of the quickstart, 16 lanes in one program on one device. Beside it how far the proxy's energy is from that
of a quadrature with four times the nodes. Older commits are compared by running this file there.

    python -m experiments.bench_proxy [--quick]
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, training, write
from jaxleg.search.contestants import baseline
from jaxleg.search.lanes import Lab
from jaxleg.walk import quadrature
from jaxleg.walk.reference import reference

LANES = 16
KINDS = ("flat", "rough", "stairs")
FINER = 4  # times as many nodes in each piece


def main(out: Path | None = None, quick: bool = False) -> None:
    """Time everything on both grounds; `quick` takes flat ground only and repeats less."""
    study, lab = setup()
    timers, rows = programs(lab), {}
    for kind in KINDS[:1] if quick else KINDS:
        lanes = training(study, lab, kind)
        lanes = lanes.take(np.arange(LANES) % lanes.site.valid.shape[0])
        vectors = jnp.asarray(np.tile(baseline(study, kind, "paper"), (LANES, 1)))
        rows[kind] = measured(timers, (vectors, lanes.site, lanes.setting), 5 if quick else 30)
        parts = ", ".join(f"{name} {ms:.2f} ms" for name, ms in rows[kind]["ms"].items())
        print(f"{kind:6s}{parts} CPU a lane; energy {rows[kind]['energy_error']:.1e} from that of {FINER} times the nodes")
    write("bench_proxy", out, {"lanes": LANES, "kinds": rows})


def programs(lab: Lab) -> dict[str, Callable[..., Any]]:
    """What is timed, of many lanes; compiled once for all grounds."""

    def walk(vector, site, setting):
        return lab.walk(vector, site, lab.choose(vector, site, setting), setting)

    def judged(vector, site, setting):
        return lab.proxy(vector, site, lab.choose(vector, site, setting), setting)

    def sloped(vector, site, setting):
        choice = lab.choose(vector, site, setting)
        return jax.grad(lambda x: lab.proxy(x, site, choice, setting).objective)(vector)

    def finer(vector, site, setting):
        nodes = {name: tuple(FINER * n for n in getattr(quadrature, name)) for name in ("SHIFT_NODES", "SWING_NODES")}
        with mock.patch.multiple(quadrature, FINE=FINER * quadrature.FINE, **nodes):  # while it is traced
            return judged(vector, site, setting)

    lanes = {"walk": walk, "judged": judged, "sloped": sloped, "finer": finer}
    lanes["reference"] = lambda walk: reference(lab.robot, walk, lab.samples)
    return {name: jax.jit(jax.vmap(lane)) for name, lane in lanes.items()}


def measured(programs: dict[str, Callable[..., Any]], lanes: tuple, repeats: int) -> dict[str, Any]:
    """CPU milliseconds a lane of each part, and the greatest relative error of the energy."""
    walks, laid = timed_cpu(programs["walk"], lanes, repeats)
    score, forward = timed_cpu(programs["judged"], lanes, repeats)
    ms = {"choice and walk": laid, "with proxy": forward, "with its gradient": timed_cpu(programs["sloped"], lanes, repeats)[1]}
    ms["reference"] = timed_cpu(programs["reference"], (walks,), repeats)[1]
    fine = programs["finer"](*lanes)
    return {"ms": ms, "energy_error": float(np.max(np.abs(score.energy / fine.energy - 1.0)))}


def timed_cpu(program: Callable[..., Any], lanes: tuple, repeats: int) -> tuple[Any, float]:
    """The answer for all lanes, and the least CPU time [ms] a lane of one call."""
    answer, best = jax.block_until_ready(program(*lanes)), np.inf
    for _ in range(repeats):
        began = time.process_time()
        jax.block_until_ready(program(*lanes))
        best = min(best, time.process_time() - began)
    return answer, 1e3 * best / LANES


if __name__ == "__main__":
    tyro.cli(main)
