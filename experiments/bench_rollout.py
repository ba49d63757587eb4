"""How fast is the rollout? Simulated seconds per second over distinct terrains and parameters, 64 x 64 maps.

Four engines follow the same joint references: jaxleg's rollout (meters included); `mjx.step` with MuJoCo's native height field
and contacts of the feet (MJX's box over a height field, which the trunk is, would take 20 to 30 times as long); bare `mjx.step`
without any contact (the robot moves its legs in free fall); C MuJoCo's `mujoco.rollout` on two threads, one model a terrain, at
the referee's 2 ms. The three that run in JAX get the same chunks on the same devices.

Each JAX engine runs at the largest of some steps that keeps every lane's energy within 2 % of its own fine step's, or at the
smallest of them where none does. Then the cost per terrain at 64, 256 and 1024 terrains (planning included), and the memory of
reverse mode over a full walk.

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
from mujoco import rollout

from experiments.common import setup, timed, write
from jaxleg.batch import in_chunks, on_devices, over_lanes
from jaxleg.leg.energy import Power, electrical, motor_power
from jaxleg.posture.collision import Sizes, robot_obstacles
from jaxleg.search.config import Study
from jaxleg.search.contestants import baseline, searched_planner
from jaxleg.search.lanes import Lab, settings_of
from jaxleg.search.referees import unstack
from jaxleg.search.training import Lanes
from jaxleg.sim import referee
from jaxleg.sim.engine import mjx
from jaxleg.sim.model import STEP, build_model
from jaxleg.sim.rollout import simulate
from jaxleg.terrain.generators import Grid, TerrainSettings, terrain_batch
from jaxleg.terrain.site import Site
from jaxleg.walk.data import Reference

GRID = Grid(64, 64, 0.03, (-0.9, -0.96))
CANDIDATES = (((30, 25), 2), ((40, 34), 2), ((48, 40), 2), ((60, 50), 2), ((60, 50), 3))  # (samples a phase, steps a sample)
MJX_STEPS = (1e-2, 6.25e-3, 5e-3, 4e-3, 2.5e-3, 2e-3, 1.6e-3, 1.25e-3)  # [s]
MJX_FINE = 2.5e-4  # step of comparison [s]
NATIVE_TIME, BARE_TIME = 0.1, 4.0  # simulated [s]: native contact is slow
ERROR = 0.02  # of the energy


def main(out: Path | None = None, quick: bool = False) -> None:
    """Measure all rows; `quick` uses fewer lanes and skips 1024 terrains."""
    study, lab = setup()
    lanes, vectors = distinct(study, lab, 64 if quick else 1024)
    result = growth(lab, vectors, lanes, (16, 64) if quick else (64, 256, 1024)) | reverse(lab, vectors, lanes)
    few = first(lanes, 64)
    tracks = lab.plan_lanes(vectors[:64], few.site, few.setting).reference
    rates = {
        "jaxleg": rollout_rate(lab, vectors[:64], few),
        "mjx_native": mjx_rate(lab, few, tracks, field=True),
        "mjx_bare": mjx_rate(lab, few, tracks, field=False),
        "c_mujoco": referee_rate(lab, few, tracks),
    }
    ratios = {name: rates["jaxleg"]["rate"] / row["rate"] for name, row in rates.items()}
    for name, row in rates.items():
        speed = f"{row['rate']:.1f} simulated s/s ({row['rate'] / row['step']:.0f} steps/s)"
        about = f"step {1e3 * row['step']:.2f} ms, energy error {100 * row['error']:.2f} %, compile {row['compile']:.1f} s"
        print(f"{name:11s}{speed}, {about}; jaxleg is x{ratios[name]:.2f}")
    write("bench_rollout", out, result | {"rates": rates, "ratios": ratios})


def distinct(study: Study, lab: Lab, count: int) -> tuple[Lanes, np.ndarray]:
    """Lanes on distinct rough terrains, with distinct parameters round the paper's."""
    terrain = terrain_batch("rough", GRID, jax.random.key(5), 0, jnp.ones(count), TerrainSettings())
    sizes = Sizes.of(lab.robot)
    obstacles = jax.jit(jax.vmap(lambda t: robot_obstacles(sizes, t, GRID.resolution)))(terrain)
    site = Site(terrain, jnp.ones((count, GRID.nx, GRID.ny), bool), obstacles)
    height = np.array([name == "gait.workspace.high" for name in lab.move])
    vectors = baseline(study, "rough", "paper") + np.linspace(-0.02, 0.02, count)[:, None] * height
    return Lanes(site, settings_of(searched_planner(study, "rough"), count)), vectors.astype(np.float32)


def first(lanes: Lanes, count: int) -> Lanes:
    """The first lanes."""
    return lanes.take(np.arange(count))


def rollout_rate(lab: Lab, vectors: np.ndarray, lanes: Lanes) -> dict[str, float]:
    """jaxleg's rollout of references, with its meters."""
    fine = walk_energy(dataclasses.replace(lab, steps=10), vectors, lanes)
    for samples, steps in CANDIDATES:
        lab = dataclasses.replace(lab, samples=samples, steps=steps)
        error = np.abs(walk_energy(lab, vectors, lanes) / fine - 1.0).max()
        print(f"jaxleg with {steps} steps on {samples} samples: energy error {100 * error:.2f} %")
        if error < ERROR:
            break
    lab.engine  # noqa: B018  built outside of any tracing
    run = over_lanes(lambda terrain, track: simulate(lab.engine, lab.robot, lab.ground, terrain, track, lab.steps), lab.chunk)
    arguments = lanes.site.terrain, lab.plan_lanes(vectors, lanes.site, lanes.setting).reference
    began = time.perf_counter()
    meters = run(*arguments)
    compiled = time.perf_counter() - began
    wall = timed(run, *arguments)
    step = float(meters.time.mean()) / ((arguments[1].time.shape[1] - 1) * lab.steps)
    return {"rate": float(meters.time.sum()) / wall, "step": step, "compile": compiled - wall, "error": float(error)}


def walk_energy(lab: Lab, vectors: np.ndarray, lanes: Lanes) -> np.ndarray:
    """Energy per metre of the first eight lanes."""
    few = first(lanes, 8)
    return lab.simulate_lanes(vectors[:8], few.site, few.setting)[0].energy[:, 1]


def mjx_rate(lab: Lab, lanes: Lanes, tracks: Reference, field: bool) -> dict[str, float]:
    """`mjx.step` following the references, with the native height field or without contact."""
    terrains, walks = unstack(lanes.site.terrain), unstack(tracks)
    specs = [_on_feet_alone(build_model(lab.robot, terrain, 0.8, finer=1)) for terrain in terrains]
    if not field:
        specs[0].opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model, data = mjx.put_model(specs[0]), mjx.make_data(specs[0])
    robot, simulated = lab.robot, NATIVE_TIME if field else BARE_TIME
    stiffness, gain, limit = (x.reshape(12) for x in (robot.stiffness, robot.velocity_gain, robot.torque_limit))

    def lane(heights, q, control, step, count):  # a loop of traced length: one compilation for all steps
        own = model.tree_replace({"hfield_data": heights, "opt.timestep": step})

        def follow(i, carry):
            d, energy = carry
            after = mjx.step(own, d.replace(ctrl=control[i]))
            wanted = control[i] - stiffness * d.qpos[7:] - gain * after.qvel[6:]  # as the implicit step applied it
            torque = jnp.clip(wanted, -limit, limit)
            power = Power(*(jnp.sum(p) for p in motor_power(robot, torque, 0.5 * (d.qvel + after.qvel)[6:])))
            return after, energy + step * electrical(power, "positive")

        return jax.lax.fori_loop(0, count, follow, (data.replace(qpos=q), jnp.zeros(())))[1]

    heights = np.stack([spec.hfield_data for spec in specs])
    q = np.stack([referee.start_state(spec, walk) for spec, walk in zip(specs, walks)])[:, 1:20]
    run = over_lanes(lane, lab.chunk)

    def at(step, count):
        rows = round(simulated / MJX_FINE)
        controls = np.stack([_controls(lab, walk, step, rows) for walk in walks[:count]])
        numbers = np.full(count, step, np.float32), np.full(count, round(simulated / step))
        return heights[:count], q[:count].astype(np.float32), controls.astype(np.float32), *numbers

    began = time.perf_counter()
    fine = run(*at(MJX_FINE, 8))
    compiled = time.perf_counter() - began
    for step in MJX_STEPS:
        error = float(np.abs(run(*at(step, 8)) / fine - 1.0).max())
        print(f"mjx.step {'with' if field else 'without'} contact at {1e3 * step:.2f} ms: energy error {100 * error:.1f} %")
        if error < ERROR:
            break
    arguments = at(step, len(q))
    wall = timed(run, *arguments, repeats=2)
    return {"rate": len(q) * round(simulated / step) * step / wall, "step": step, "compile": compiled, "error": error}


def _on_feet_alone(spec: mujoco.MjModel) -> mujoco.MjModel:
    """The model whose trunk touches nothing."""
    trunk = spec.geom("trunk").id
    spec.geom_contype[trunk] = spec.geom_conaffinity[trunk] = 0
    return spec


def _controls(lab: Lab, walk: Reference, step: float, rows: int) -> np.ndarray:
    """The controls of so many steps from the start of the walk on, at another step than the referee's."""
    controls = referee.controls(lab.robot, walk)
    at = referee.SETTLE + np.arange(rows) * step
    grid = np.arange(len(controls)) * STEP
    return np.stack([np.interp(at, grid, column) for column in controls.T], axis=1)


def referee_rate(lab: Lab, lanes: Lanes, tracks: Reference) -> dict[str, float]:
    """C MuJoCo on two threads: `mujoco.rollout` alone, models and controls made before."""
    walks = unstack(tracks)
    models = [build_model(lab.robot, terrain, 0.8) for terrain in unstack(lanes.site.terrain)]
    controls = [referee.controls(lab.robot, walk) for walk in walks]
    steps = min(map(len, controls))
    control = np.stack([rows[:steps] for rows in controls])
    start = np.stack([referee.start_state(model, walk) for model, walk in zip(models, walks)])
    workers = [mujoco.MjData(models[0]) for _ in range(2)]
    wall = timed(lambda: rollout.rollout(models, workers, start, control), repeats=2)
    step = STEP
    return {"rate": len(models) * steps * step / wall, "step": step, "compile": 0.0, "error": float("nan")}


def growth(lab: Lab, vectors: np.ndarray, lanes: Lanes, counts: tuple[int, ...]) -> dict[str, Any]:
    """Time per terrain and peak resident memory of the process at several numbers of terrains, in chunks."""
    rows = []
    lab.simulate_lanes(vectors[:1], *first(lanes, 1))
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
    """Memory of reverse mode over whole walks: what the compiled chunk needs on all devices, and the process's peak."""
    count = min(count, len(vectors))
    some = first(lanes, count)
    devices = jax.local_device_count()
    chunk = devices * max(1, lab.chunk // 2)  # as `Lab.simulate_gradients`
    began, part = time.perf_counter(), first(lanes, chunk)

    def lane(vector, site, setting):
        choice = lab.choose(vector, site, setting)
        return jax.grad(lab.simulated, has_aux=True)(vector, site, choice, setting)[0]

    run = on_devices(jax.vmap(lane))
    gradient = in_chunks(lambda *lanes: run((), lanes), chunk, vectors[:count], some.site, some.setting)
    wall = time.perf_counter() - began
    memory = run.lower((), (vectors[:chunk], part.site, part.setting)).compile().memory_analysis()
    inputs = sum(np.asarray(x).nbytes for x in jax.tree.leaves(some)) / 2**30
    total = inputs + devices * (memory.temp_size_in_bytes + memory.output_size_in_bytes) / 2**30
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    finite = int(np.isfinite(gradient).all(axis=1).sum())
    about = f"{total:.2f} GiB of arrays, peak of the process {peak:.2f} GiB, compiling included; {wall:.0f} s with compiling"
    print(f"reverse mode, {count} terrains in chunks of {chunk}, {finite} finite gradients: {about}")
    return {"reverse_gib": total, "reverse_peak_gib": peak, "reverse_terrains": count, "reverse_finite": finite}


if __name__ == "__main__":
    tyro.cli(main)
