"""Crawls that tests plan: gaits, settings, terrains."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxleg.walk.crawl import CrawlSettings

from jaxleg.gait.params import GaitParams
from jaxleg.posture.incentre import CogPlan
from jaxleg.terrain import Grid, flat, rough, stairs

GRID = Grid(112, 52, 0.02, (-0.9, -0.51))
TERRAINS = {
    "flat": flat,
    "stairs": lambda g: stairs(g, 0.08, 0.30, 0.1),
    "rough": lambda g: rough(g, jax.random.key(1), 0.05, 0.25),
}


@functools.partial(jax.jit, static_argnums=0)
def terrain_of(kind):
    return TERRAINS[kind](GRID)


def gait(height=0.5, offset=-0.1, skew=0.1, step=0.2, length=0.62, width=0.36, swing=0.08, shift=0.45, hind=0.5, lift=0.1):
    return GaitParams(*(jnp.asarray(x, float) for x in (height, offset, skew, step, length, width, swing, shift, hind, lift)))


def settings(bend=20.0, threshold=0.0, rule="overlap", ratio=0.5):
    cog = CogPlan(jnp.asarray(ratio), jnp.asarray(threshold), rule)
    return CrawlSettings(*(jnp.asarray(x, float) for x in (0.05, np.deg2rad(bend), 0.02, 0.1)), cog)


def in_numpy(walk):
    """Its arrays NumPy's, but for the parameters'."""
    return jax.tree.map(np.asarray, walk._replace(params=None))._replace(params=walk.params)
