"""Can a foothold's terrain features tell what standing there costs? Weights learned from simulation, beside the hand's.

On random rough ground and on cuboids, both tilted, a front and a hind leg (in turn) try candidate cells near each other: in
simulation the foot stands on the piece of ground round the cell, at its default foothold, the other feet on level ground as
high, and the trunk moves ahead over them. So the ground under the foot makes all the difference, not where the foot is or how
high: the features know nothing of that. The expert ranks each set of candidates by energy and the foot's slip, each in units
of its spread within the training sets; weights are learned from those rankings (listwise) and judged by the pairs they order
rightly on held-out terrains, with a bootstrap over sets. Paper C, (11)-(13).

Found (400 terrains): of the held-out pairs the learned weights order 0.77 (front) and 0.82 (hind) rightly, the hand's 0.72 and
0.78. Slope under the foot is nearly all of it, and slip nearly all of what can be told (0.87, 0.86; energy 0.53, 0.57). Signed
weights tell energy better (0.65, 0.63), and turn the paper's uphill rule round for both legs.

    python -m experiments.learn_footholds [--quick]
"""

from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.common import setup, write
from jaxleg.batch import over_lanes
from jaxleg.foothold.learned import differences, learn, leg_weights, listwise_loss, pairwise_accuracy
from jaxleg.gait.order import PHASES, SWING_LEG
from jaxleg.gait.phases import Phases, no_flights
from jaxleg.leg.energy import electrical
from jaxleg.planner import Planner
from jaxleg.search.contestants import contestant
from jaxleg.search.lanes import Lab
from jaxleg.settings import dump
from jaxleg.sim.rollout import simulate
from jaxleg.terrain import Grid, HeightMap, rough
from jaxleg.terrain.cost_map import CostSettings, cost_weights
from jaxleg.terrain.foothold_cost import FEATURES, foothold_scores
from jaxleg.terrain.foothold_features import foothold_features
from jaxleg.terrain.ground import on_ground
from jaxleg.viz.style import GREY, LEG_COLOUR, blank, label, save
from jaxleg.walk.reference import phase_instants, to_reference
from jaxleg.walk.standing import stand_first

GRID = Grid(41, 31, 0.04, (-0.8, -0.6))
STANCE = np.array([(0.28, 0.20), (0.28, -0.20), (-0.28, 0.20), (-0.28, -0.20)])  # on cells
PATCH = 5  # cells on either side of the foot that are the candidate's
LEGS = {"front": 0, "hind": 2}  # LF and LH
CANDIDATES, WINDOW = 10, 5  # of a set; how many cells they lie from the middle of the map at most
HEIGHT, TRAVEL, STEP_TIME, STAND = 0.46, 0.12, 0.25, 0.3  # of the hips, of the trunk [m]; of each of six moves, before [s]
SAMPLES, STEPS, STAND_SAMPLES = 10, 6, 6
RESAMPLES = 2000


class Sets(NamedTuple):
    """Sets of candidates of one leg."""

    scores: np.ndarray  # (set, candidate, feature)
    energy: np.ndarray  # (set, candidate) [J]
    slip: np.ndarray  # (set, candidate) [m]
    fell: np.ndarray  # (set, candidate)

    def part(self, chosen: slice) -> "Sets":
        """Some of the sets."""
        return Sets(*(x[chosen] for x in self))


def main(terrains: int = 400, out: Path | None = None, quick: bool = False) -> None:
    """Learn on half of `terrains` (80 with `quick`), judge on the other half."""
    study, lab = setup()
    count = 80 if quick else terrains
    maps = jax.jit(jax.vmap(ground))(jax.random.split(jax.random.key(7), count), jnp.arange(count))
    hand, folder = np.asarray(cost_weights(CostSettings()).feet.weight), out or Path("runs/learn_footholds")
    learned, rows = {}, {}
    for name, leg in LEGS.items():
        sets = stand_on(lab, contestant(study, "flat", "traditional"), maps, leg, count)
        learned[name], rows[name] = judge(sets, hand[leg])
        print(name, f"fell {rows[name]['fell']}")
        for expert in ("both", "energy", "slip"):
            parts = ("learned", "signed", "hand", "gain")
            print(f"  by {expert:6s}", *(f"{part} {rows[name][expert][part]}" for part in parts), sep="  ")
    write("learn_footholds", out, {"terrains": count, "candidates": CANDIDATES, "features": FEATURES, "legs": rows})
    dump(leg_weights(*(jnp.asarray(learned[name]) for name in LEGS)), folder / "weights.toml")
    draw(hand[0], learned, rows, folder / "weights.png")


def ground(key: jax.Array, number: jax.Array) -> HeightMap:
    """Even numbers: rough ground; odd ones: cuboids 0.16 to 0.2 m wide. Both tilted by up to 0.25 along x and y."""
    keys = jax.random.split(key, 5)
    amplitude = jax.random.uniform(keys[0], (), float, 0.02, 0.06)
    waves = rough(GRID, keys[1], amplitude, jax.random.uniform(keys[2], (), float, 0.08, 0.25)).elevation
    blocks = amplitude * jax.random.uniform(keys[3], (GRID.nx // 4, GRID.ny // 5))
    index = (np.minimum(np.arange(n) // k, n // k - 1) for n, k in ((GRID.nx, 4), (GRID.ny, 5)))
    tilt = jnp.sum(GRID.points() * jax.random.uniform(keys[4], (2,), float, -0.25, 0.25), axis=-1)
    return GRID.map(jnp.where(number % 2 == 0, waves, blocks[jnp.ix_(*index)]) + tilt)


def stand_on(lab: Lab, planner: Planner, maps: HeightMap, leg: int, count: int) -> Sets:
    """Stand on random candidates of each map, all of them in simulation."""
    rng, around = np.random.default_rng(leg), np.arange(-PATCH, PATCH + 1)
    offsets = np.stack(np.meshgrid(*(np.arange(-WINDOW, WINDOW + 1),) * 2), axis=-1).reshape(-1, 2)
    cells = np.array([GRID.nx // 2, GRID.ny // 2]) + offsets[np.argsort(rng.random((count, len(offsets))))[:, :CANDIDATES]]
    x, y = (cells[:, :, axis, None] + around for axis in (0, 1))
    elevation = np.asarray(maps.elevation)
    patches = elevation[np.arange(count)[:, None, None, None], x[:, :, :, None], y[:, :, None, :]]
    lab.engine  # noqa: B018  built outside of any tracing
    lane = over_lanes(lambda patch: stand(lab, planner, patch, leg), lab.chunk)
    seen = lane(patches.reshape(-1, 2 * PATCH + 1, 2 * PATCH + 1))
    scores = np.asarray(jax.jit(lambda m: jax.lax.map(lambda t: scores_of(t, leg), m))(maps))
    at = scores[np.arange(count)[:, None], :, cells[..., 0], cells[..., 1]]
    return Sets(at, *(x.reshape(count, CANDIDATES) for x in seen))


def stand(lab: Lab, planner: Planner, patch: jax.Array, leg: int) -> tuple[jax.Array, ...]:
    """Energy [J], the leg's slip [m] and whether it fell, while the trunk moves ahead over the feet, one on the patch."""
    i, j = np.round((STANCE[leg] - GRID.origin) / GRID.resolution).astype(int) - PATCH
    level, size = jnp.zeros((GRID.nx, GRID.ny), patch.dtype), 2 * PATCH + 1
    terrain = GRID.map(level.at[i : i + size, j : j + size].set(patch - patch[PATCH, PATCH]))
    feet = on_ground(lab.robot, terrain, jnp.asarray(STANCE, patch.dtype))
    poses = jnp.zeros((PHASES + 1, 6), feet.dtype).at[:, 0].set(TRAVEL * jnp.linspace(-0.5, 0.5, PHASES + 1))
    poses = poses.at[:, 2].set(jnp.mean(feet[:, 2]) + HEIGHT - jnp.mean(lab.robot.hip_position[:, 2]))
    time, none = jnp.full(PHASES, STEP_TIME, feet.dtype), jnp.zeros((PHASES, 4), feet.dtype)
    there = jnp.broadcast_to(feet, (PHASES, 4, 3))
    still = no_flights(PHASES, feet.dtype)
    phases = Phases(jnp.cumsum(time) - time, time, poses[:-1], poses[1:], there, there, still, none)
    track = to_reference(*phase_instants(lab.robot, phases, SWING_LEG, planner.swing.load_share, (SAMPLES, SAMPLES)))
    track = stand_first(track, STAND, STAND_SAMPLES)
    meters = simulate(lab.engine, lab.robot, lab.ground, terrain, track, STEPS, STAND_SAMPLES)
    return jnp.sum(electrical(meters.energy, lab.convention)), meters.slip[leg], meters.fell


def scores_of(terrain: HeightMap, leg: int) -> jax.Array:
    """Scores (feature, nx, ny) of every cell for a leg that travels along x."""
    settings = CostSettings()
    features = foothold_features(terrain, GRID.resolution, settings.windows.foothold)
    return foothold_scores(features, cost_weights(settings).feet.limit, leg, 0.0)


def judge(sets: Sets, hand: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """Learned weights of the expert, and accuracies on held-out sets beside the hand's weights; by energy or slip alone too."""
    half = len(sets.energy) // 2
    train, held_out = sets.part(slice(half)), sets.part(slice(half, None))
    spread = [
        float(np.sqrt(np.nanmean(np.nanvar(np.where(train.fell, np.nan, x), axis=1)))) for x in (train.energy, train.slip)
    ]
    row: dict[str, Any] = {"fell": int(sets.fell.sum()), "spread_energy_J": spread[0], "spread_slip_m": spread[1]}
    for expert, share in {"both": (1, 1), "energy": (1, 0), "slip": (0, 1)}.items():
        table, kept = (rank(part, share, spread) for part in (train, held_out))
        weights = {name: fit(jnp.asarray(table), name == "signed") for name in ("learned", "signed")} | {"hand": hand}
        row[expert] = accuracies(kept, weights) | {f"{name} weights": w.tolist() for name, w in weights.items()}
    return np.array(row["both"]["learned weights"]), row


def fit(table: jax.Array, signed: bool) -> np.ndarray:
    """Weights learned from rankings."""
    return np.asarray(jax.jit(lambda t: learn(listwise_loss, t, signed=signed).weight)(table), float)


def rank(sets: Sets, share: tuple[int, int], spread: list[float]) -> np.ndarray:
    """Scores (set, rank, feature), the expert's best first; who fell comes last."""
    cost = share[0] * sets.energy / spread[0] + share[1] * sets.slip / spread[1]
    order = np.argsort(np.where(sets.fell, np.inf, cost), axis=1)
    return np.take_along_axis(sets.scores, order[:, :, None], axis=1)


def accuracies(ranked: np.ndarray, weights: dict[str, np.ndarray]) -> dict[str, list[float]]:
    """Pairwise accuracy of each weight with its 95 % interval, and what the learned ones gain on the hand's."""
    pairs = differences(jnp.asarray(ranked)).reshape(len(ranked), -1, ranked.shape[2])
    score = jax.vmap(pairwise_accuracy, in_axes=(None, 0))
    each = {name: np.asarray(score(jnp.asarray(w, pairs.dtype), pairs)) for name, w in weights.items()}
    each["gain"] = each["learned"] - each["hand"]
    chosen = np.random.default_rng(0).integers(0, len(ranked), (RESAMPLES, len(ranked)))
    spans = {name: np.percentile(x[chosen].mean(axis=1), [2.5, 97.5]) for name, x in each.items()}
    return {name: np.array([x.mean(), *spans[name]], float).round(4).tolist() for name, x in each.items()}


def draw(hand: np.ndarray, learned: dict[str, np.ndarray], rows: dict[str, Any], path: Path) -> None:
    """Weights of the features, learned and the hand's; accuracies in the legend."""
    figure, (ax,) = blank(4.0)
    place = np.arange(len(FEATURES))
    for k, (name, weight) in enumerate(learned.items()):
        right = rows[name]["both"]
        text = f"{name}: learned {right['learned'][0]:.3f}, hand {right['hand'][0]:.3f} of held-out pairs"
        ax.bar(place + 0.25 * (k - 1), weight, 0.25, color=LEG_COLOUR[LEGS[name]], label=text)
    ax.bar(place + 0.25, hand, 0.25, color=GREY, label="hand")
    ax.set_xticks(place, [feature.replace("_", "\n") for feature in FEATURES])
    ax.legend(frameon=False, fontsize=9)
    label(ax, "feature", "weight", "Weights of foothold features")
    save(figure, path)


if __name__ == "__main__":
    tyro.cli(main)
