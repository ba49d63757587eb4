"""Where the feet stand nominally: a parallelogram round each station of a route. Paper A, IV.A, Fig. 6a (A7); C, 3.1."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxleg.conventions import LEFT_LEGS, LEG_END, LEG_SIDE
from jaxleg.gait.params import GaitParams
from jaxleg.rotations import turned
from jaxleg.route.stations import Stations

LATER = np.isin(np.arange(4), LEFT_LEGS).astype(np.int32)  # the left legs stand a half cycle further on than the right ones


def nominal_offset(gait: GaitParams, leg: Int[Array, ""]) -> Float[Array, "2"]:
    """A leg's nominal foothold (ahead, left) of the station that it stands at [m].

    L_Stance and W_Stance apart, and as much before or behind as L_Skew differs from (4)'s half a step: stations of a half
    cycle are half a step apart already.
    """
    dtype = gait.step_length.dtype
    end, side = jnp.asarray(LEG_END, dtype)[leg], jnp.asarray(LEG_SIDE, dtype)[leg]
    ahead = 0.5 * (end * gait.stance_length + side * (gait.skew - 0.5 * gait.step_length))
    return jnp.stack([ahead, 0.5 * side * gait.stance_width])


def nominal_foothold(gait: GaitParams, stations: Stations, station: Int[Array, ""], leg: Int[Array, ""]) -> Float[Array, "2"]:
    """A leg's nominal foothold (x, y in W) [m] at a station; beyond the last one it stays there."""
    station = jnp.minimum(station, stations.yaw.shape[0] - 1)
    return stations.xy[station] + turned(nominal_offset(gait, leg), stations.yaw[station])


def nominal_stances(
    gait: GaitParams, stations: Stations, stances: int
) -> tuple[Float[Array, "stance leg 2"], Float[Array, "stance leg"]]:
    """Nominal footholds (x, y in W) [m] of so many stances, and the headings [rad] of their stations: the right legs stand at
    every other one, the left legs at those between."""
    station = jnp.asarray(2 * np.arange(stances)[:, None] + LATER[None], jnp.int32)
    at = jax.vmap(jax.vmap(lambda s, leg: nominal_foothold(gait, stations, s, leg)), in_axes=(0, None))
    return at(station, jnp.arange(4)), stations.yaw[jnp.minimum(station, stations.yaw.shape[0] - 1)]
