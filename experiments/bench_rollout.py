"""How fast is the rollout? Simulated seconds per second over distinct terrains and parameters, 64 x 64 maps.

Four engines follow the same joint references: jaxleg's rollout (meters included); `mjx.step` with MuJoCo's native height field
and contacts; bare `mjx.step` without any contact; C MuJoCo's `mujoco.rollout` on two threads, one model a terrain. Then the
cost per terrain at 64, 256 and 1024 terrains, and the memory of reverse mode over a full cycle.

jaxleg runs at its largest step that keeps every lane's energy within 2 % of a five times finer one. The two `mjx.step` rows
run at 2.5 ms: bare, that is about its own 2 % step; with native contact no step tried came within 2 %, see the README. C MuJoCo
runs at the referee's 2 ms, model building and meters included. All get the same 64 x 64 maps.

    python -m experiments.bench_rollout [--quick]
"""

import dataclasses
import resource
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import tyro
from mujoco import mjx

from experiments.common import setup, timed, write
from jaxleg.plan import Reference
from jaxleg.planning.planner import Site
from jaxleg.planning.reference import samples_per_cycle
from jaxleg.search.config import Study, baseline
from jaxleg.search.descent import Lanes
from jaxleg.search.lanes import Lab, Setting
from jaxleg.search.referees import references, unstack
from jaxleg.sim import referee
from jaxleg.terrain.generators import Grid, TerrainSettings, terrain_batch

GRID = Grid(64, 64, 0.03, (-0.9, -0.96))
MJX_STEP = 2.5e-3  # [s]
CANDIDATES = (((30, 25), 2), ((40, 34), 2), ((48, 40), 2), ((60, 50), 2), ((60, 50), 3))  # (samples a phase, steps a sample)


def main(out: Path | None = None, quick: bool = False) -> None:
    """Measure all rows; `quick` uses fewer lanes and skips 1024 terrains."""
    study, lab = setup()
    lanes, vectors = distinct(study, 64 if quick else 1024)
    result = growth(lab, vectors, lanes, (16, 64) if quick else (64, 256, 1024)) | reverse(lab, vectors, lanes)
    ours, note = rollout_rate(lab, vectors[:64], first(lanes, 64))
    few = 16 if quick else 64
    tracks = jax.tree.map(jnp.asarray, references(lab, vectors[:few], first(lanes, few)))
    rates = {"jaxleg": ours}
    for name, field in (("mjx_native", True), ("mjx_bare", False)):
        rates[name] = mjx_rate(lab, first(lanes, few), tracks, field)
    rates["c_mujoco"] = referee_rate(lab, first(lanes, few), tracks)
    ratios = {name: ours["rate"] / row["rate"] for name, row in rates.items()}
    for name, row in rates.items():
        speed = f"{row['rate']:9.1f} simulated s/s   step {1e3 * row['step']:.2f} ms   compile {row['compile']:5.1f} s"
        print(f"{name:11s}{speed}   jaxleg is x{ratios[name]:.2f}")
    write("bench_rollout", out, result | {"rates": rates, "ratios": ratios, "jaxleg": note})


def distinct(study: Study, count: int) -> tuple[Lanes, np.ndarray]:
    """Lanes on distinct rough terrains, with distinct parameters round the paper's."""
    terrain = terrain_batch("rough", GRID, jax.random.key(5), 0, jnp.ones(count), TerrainSettings())
    site = Site(terrain, jnp.ones((count, GRID.nx, GRID.ny), bool))
    setting = Setting(*(jnp.full(count, x, float) for x in (np.deg2rad(20.0), -10.0, 1.0)))
    vectors = np.tile(baseline(study, "rough", "paper"), (count, 1))
    vectors[:, 0] += np.linspace(-0.02, 0.02, count)
    return Lanes(site, setting), vectors


def first(lanes: Lanes, count: int) -> Lanes:
    """The first lanes."""
    return lanes.take(np.arange(count))


def rollout_rate(lab: Lab, vectors: np.ndarray, lanes: Lanes) -> tuple[dict[str, float], str]:
    """jaxleg at the largest of some steps that stays within 2 % energy error of the finest on every lane."""
    few = first(lanes, 8)
    fine = energy(dataclasses.replace(lab, steps=10), vectors[:8], few)
    for samples, steps in CANDIDATES:
        coarse = dataclasses.replace(lab, samples=samples, steps=steps)
        error = np.abs(energy(coarse, vectors[:8], few) / fine - 1.0).max()
        print(f"jaxleg with {steps} steps on {samples} samples: energy error {100 * error:.2f} %")
        if error < 0.02:
            break
    lab = dataclasses.replace(coarse, chunk=64)
    began = time.perf_counter()
    _, meters = lab.simulate_lanes(vectors, lanes.site, lanes.setting)
    compiled = time.perf_counter() - began
    wall = timed(lab.simulate_lanes, vectors, lanes.site, lanes.setting, repeats=3)
    step = float(meters.time.mean()) / (2 * samples_per_cycle(samples) * steps)
    row = {"rate": float(meters.time.sum()) / wall, "step": step, "compile": compiled - wall, "error": float(error)}
    return row, f"{steps} steps a sample, {samples} samples a phase"


def energy(lab: Lab, vectors: np.ndarray, lanes: Lanes) -> np.ndarray:
    """Energy per metre of each lane."""
    lab = dataclasses.replace(lab, chunk=len(vectors))
    return lab.simulate_lanes(vectors, lanes.site, lanes.setting)[0].energy[:, 1]


def mjx_rate(lab: Lab, lanes: Lanes, tracks: Reference, field: bool) -> dict[str, float]:
    """`mjx.step` following the references, with the native height field or without contact."""
    terrains = unstack(jax.tree.map(np.asarray, lanes.site.terrain))
    walks = unstack(jax.tree.map(np.asarray, tracks))
    specs = [referee.build_model(lab.robot, terrain, 0.8, finer=1) for terrain in terrains]
    for spec in specs:
        spec.opt.timestep = MJX_STEP
        if not field:
            spec.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model = mjx.put_model(specs[0])
    heights = jnp.asarray(np.stack([spec.hfield_data for spec in specs]))
    start = [referee.start_state(spec, track) for spec, track in zip(specs, walks)]
    q = jnp.asarray(np.stack(start)[:, 1:20], jnp.float32)
    control = jnp.asarray(np.stack([referee.controls(lab.robot, walk)[150:190] for walk in walks]))
    control = control.astype(jnp.float32)

    def lane(hfield, q, control):
        own = model.replace(hfield_data=hfield)
        data = mjx.make_data(specs[0]).replace(qpos=q)
        return jax.lax.scan(lambda d, u: (mjx.step(own, d.replace(ctrl=u)), None), data, control)[0].qpos

    run = jax.jit(jax.vmap(lane))
    began = time.perf_counter()
    jax.block_until_ready(run(heights, q, control))
    compiled = time.perf_counter() - began
    wall = timed(run, heights, q, control, repeats=2)
    return {"rate": control.shape[0] * control.shape[1] * MJX_STEP / wall, "step": MJX_STEP, "compile": compiled - wall}


def referee_rate(lab: Lab, lanes: Lanes, tracks: Reference) -> dict[str, float]:
    """C MuJoCo on two threads, model building and meters included."""
    terrains = unstack(jax.tree.map(np.asarray, lanes.site.terrain))
    walks = unstack(jax.tree.map(np.asarray, tracks))
    referee.replay(lab.robot, terrains[:2], walks[:2], 0.8)
    began = time.perf_counter()
    verdicts = referee.replay(lab.robot, terrains, walks, 0.8)
    return {"rate": sum(v.time for v in verdicts) / (time.perf_counter() - began), "step": referee.STEP, "compile": 0.0}


def growth(lab: Lab, vectors: np.ndarray, lanes: Lanes, counts: tuple[int, ...]) -> dict[str, Any]:
    """Time per terrain and peak resident memory of the process at several numbers of terrains, in chunks of 64."""
    lab, rows = dataclasses.replace(lab, chunk=min(64, counts[0])), []
    lab.simulate_lanes(vectors[: lab.chunk], *first(lanes, lab.chunk))
    for count in counts:
        began = time.perf_counter()
        lab.simulate_lanes(vectors[:count], *first(lanes, count))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        rows.append({"terrains": count, "ms_per_terrain": 1e3 * (time.perf_counter() - began) / count, "peak_gib": peak})
        print(f"{count:5d} terrains: {rows[-1]['ms_per_terrain']:.1f} ms each, peak memory so far {peak:.2f} GiB")
    last, before = rows[-1], rows[-2]
    ratio = {key: last[key] / before[key] for key in ("ms_per_terrain", "peak_gib")}
    ends = f"growth from {before['terrains']} to {last['terrains']}"
    print(f"{ends}: time x{ratio['ms_per_terrain']:.2f}, memory x{ratio['peak_gib']:.2f}")
    return {"growth": rows, "growth_ratio": ratio}


def reverse(lab: Lab, vectors: np.ndarray, lanes: Lanes, count: int = 256) -> dict[str, Any]:
    """Temporary memory of the compiled reverse-mode chunk that 256 terrains go through, and its inputs."""
    count = min(count, len(vectors))
    chunk = lab.chunk // 2
    lane = lab.simulate_gradients.args[0]
    some = first(lanes, chunk)
    compiled = lane.lower(jnp.asarray(vectors[:chunk], jnp.float32), some.site, some.setting).compile()
    memory = compiled.memory_analysis()
    inputs = sum(np.asarray(x).nbytes for x in jax.tree.leaves(first(lanes, count)))
    total = (memory.temp_size_in_bytes + memory.output_size_in_bytes + inputs) / 2**30
    print(f"reverse mode, {count} terrains in chunks of {chunk}: {total:.2f} GiB")
    return {"reverse_gib": total, "reverse_terrains": count}


if __name__ == "__main__":
    tyro.cli(main)
