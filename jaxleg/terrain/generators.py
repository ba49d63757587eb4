"""Terrain generators: flat ground, stairs, rough ground, cuboids, fractal ground. Jittable; one key makes one terrain."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxleg.conventions import InputError
from jaxleg.pytree import pytree
from jaxleg.terrain.heightmap import HeightMap

BATCH = 16  # terrains made at once
WAVES = 64  # plane waves in a rough surface
OCTAVES, WAVES_AN_OCTAVE = 5, 16  # of a fractal surface, its longest waves first
HURST = 0.8  # of a fractal surface: an octave's amplitude goes with its wavelength to this power


@dataclasses.dataclass(frozen=True)
class Grid:
    """Size and place of a map; static."""

    nx: int
    ny: int
    resolution: float  # [m per cell]
    origin: tuple[float, float]  # world xy of the centre of cell [0, 0] [m]

    def points(self) -> Float[Array, "nx ny 2"]:
        """World xy of every cell's centre [m]."""
        x = self.origin[0] + self.resolution * jnp.arange(self.nx, dtype=float)
        y = self.origin[1] + self.resolution * jnp.arange(self.ny, dtype=float)
        return jnp.stack(jnp.meshgrid(x, y, indexing="ij"), axis=-1)

    def map(self, elevation: Float[Array, "nx ny"]) -> HeightMap:
        """A `HeightMap` of this grid."""
        return HeightMap(elevation, jnp.array(self.origin, elevation.dtype), jnp.array(self.resolution, elevation.dtype))


@pytree
class TerrainSettings:
    """What the generators make at difficulty 1; every field a leaf."""

    rise: Float[ArrayLike, "*batch"] = 0.08  # stairs: height of a step [m]
    run: Float[ArrayLike, "*batch"] = 0.30  # stairs: depth of a tread [m]
    heading: Float[ArrayLike, "*batch"] = 0.0  # stairs: direction of ascent in W [rad]
    amplitude: Float[ArrayLike, "*batch"] = 0.05  # rough: two standard deviations [m]
    correlation_length: Float[ArrayLike, "*batch"] = 0.25  # rough: see `rough` [m]
    cuboid: Float[ArrayLike, "*batch"] = 0.30  # cuboids: length and width [m]
    cuboid_height: Float[ArrayLike, "*batch"] = 0.10  # cuboids: greatest height above and below the mean [m]
    deviation: Float[ArrayLike, "*batch"] = 0.12  # fractal: standard deviation [m]
    longest_wave: Float[ArrayLike, "*batch"] = 4.0  # fractal [m]


def flat(grid: Grid) -> HeightMap:
    """Level ground at height 0."""
    return grid.map(jnp.zeros((grid.nx, grid.ny), float))


def stairs(
    grid: Grid,
    rise: Float[ArrayLike, ""],
    run: Float[ArrayLike, ""],
    offset: Float[ArrayLike, ""] = 0.0,
    heading: Float[ArrayLike, ""] = 0.0,
) -> HeightMap:
    """Endless stairs up along `heading` [rad]: height = rise * floor((s - offset) / run), s the way along the heading [m]."""
    points = grid.points()
    along = points[..., 0] * jnp.cos(heading) + points[..., 1] * jnp.sin(heading)
    return grid.map(jnp.floor((along - offset) / run) * rise)


def rough(grid: Grid, key: Array, amplitude: Float[ArrayLike, ""], correlation_length: Float[ArrayLike, ""]) -> HeightMap:
    """Random ground: a sum of `WAVES` plane waves of random direction and phase, standard deviation amplitude / 2 [m].

    The wave vectors are normal with standard deviation 1 / correlation_length [rad/m] per axis, cut at 2.5 of them, so the
    autocorrelation is about exp(-r^2 / (2 correlation_length^2)). Mean 0 and standard deviation are those over many keys at
    one point. The ground at a point does not depend on the grid.
    """
    key_wave, key_phase = jax.random.split(key)
    waves = jax.random.truncated_normal(key_wave, -2.5, 2.5, (WAVES, 2), float)[None, None] / correlation_length
    phases = jax.random.uniform(key_phase, (WAVES,), float, 0.0, 2.0 * jnp.pi)
    points = grid.points()[:, :, None]
    # not a matrix product: accelerators may round its factors, and the same key must give the same ground
    angle = points[..., 0] * waves[..., 0] + points[..., 1] * waves[..., 1] + phases[None, None]
    return grid.map(0.5 * amplitude * jnp.sqrt(2.0 / WAVES) * jnp.sum(jnp.cos(angle), axis=-1))


def cuboids(grid: Grid, key: Array, side: Float[ArrayLike, ""], height: Float[ArrayLike, ""]) -> HeightMap:
    """Square cuboids side by side, their tops uniform within +-height [m]. Paper C, 4.2 (Fig. 9).

    The lattice begins at a random place. The ground at a point does not depend on the grid.
    """
    key_place, key_top = jax.random.split(key)
    cell = jnp.floor(grid.points() / side + jax.random.uniform(key_place, (2,), float)[None, None]).astype(jnp.int32)

    def top(cell):
        of_cell = jax.random.fold_in(jax.random.fold_in(key_top, cell[0]), cell[1])
        return jax.random.uniform(of_cell, (), float, -1.0, 1.0)

    return grid.map(height * jax.vmap(jax.vmap(top))(cell))


def fractal(grid: Grid, key: Array, deviation: Float[ArrayLike, ""], longest: Float[ArrayLike, ""]) -> HeightMap:
    """Fractional Brownian ground: octaves of plane waves from `longest` [m] on, each half as long as the one before.

    Amplitudes fall with the wavelength to the power `HURST`; directions, phases and wavelengths within an octave are random.
    Mean 0 and standard deviation `deviation` [m] are those over many keys at one point. As `rough`, free of the grid.
    """
    key_turn, key_wave, key_phase = jax.random.split(key, 3)
    octave = jnp.repeat(jnp.arange(OCTAVES, dtype=float), WAVES_AN_OCTAVE)
    turn = jax.random.uniform(key_turn, octave.shape, float, 0.0, 2.0 * jnp.pi)
    length = longest * 2.0 ** -(octave + jax.random.uniform(key_wave, octave.shape, float))
    phase = jax.random.uniform(key_phase, octave.shape, float, 0.0, 2.0 * jnp.pi)
    amplitude = 2.0 ** (-HURST * octave)
    amplitude = amplitude * deviation * jnp.sqrt(2.0 / jnp.sum(amplitude**2))

    points = grid.points()

    def wave(total, one):
        turn, length, phase, amplitude = one
        along = points[..., 0] * jnp.cos(turn) + points[..., 1] * jnp.sin(turn)  # no matrix product, as in `rough`
        return total + amplitude * jnp.cos(2.0 * jnp.pi / length * along + phase), None

    return grid.map(jax.lax.scan(wave, jnp.zeros((grid.nx, grid.ny), float), (turn, length, phase, amplitude))[0])


# To add a kind of terrain, add its generator here: grid, key, difficulty d in [0, 1], settings.
KINDS: dict[str, Callable[[Grid, Array, Float[ArrayLike, ""], TerrainSettings], HeightMap]] = {
    "flat": lambda grid, key, d, settings: flat(grid),
    "rough": lambda grid, key, d, settings: rough(grid, key, d * settings.amplitude, settings.correlation_length),
    "stairs": lambda grid, key, d, settings: stairs(
        grid, d * settings.rise, settings.run, jax.random.uniform(key, (), float, 0.0, settings.run), settings.heading
    ),
    "cuboids": lambda grid, key, d, settings: cuboids(grid, key, settings.cuboid, d * settings.cuboid_height),
    "fractal": lambda grid, key, d, settings: fractal(grid, key, d * settings.deviation, settings.longest_wave),
}


def terrain(kind: str, grid: Grid, key: Array, difficulty: Float[ArrayLike, ""], settings: TerrainSettings) -> HeightMap:
    """One terrain of a kind in `KINDS`; difficulty 0 is flat, 1 the full rise or amplitude of the settings.

    Raises InputError for a kind that is not in `KINDS`.
    """
    if kind not in KINDS:
        raise InputError(f"terrain kind {kind!r} is unknown; there are {', '.join(sorted(KINDS))}")
    return KINDS[kind](grid, key, difficulty, settings)


def terrain_keys(key: Array, first: int, count: int) -> Array:
    """Keys of terrains number first ... first + count - 1: each depends on the key and its own number only."""
    return jax.vmap(jax.random.fold_in, in_axes=(None, 0))(key, first + jnp.arange(count))


def terrain_batch(
    kind: str, grid: Grid, key: Array, first: int, difficulties: Float[Array, "n"], settings: TerrainSettings
) -> HeightMap:
    """Terrains number first, first + 1, ... (leading axis n), one per difficulty, however a batch is cut.

    Made a few at a time: memory beyond the maps themselves does not grow with their number.
    """
    keys = terrain_keys(key, first, difficulties.shape[0])
    return jax.lax.map(lambda x: terrain(kind, grid, *x, settings), (keys, difficulties), batch_size=BATCH)
