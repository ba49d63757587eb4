"""Where the feet stand nominally: a parallelogram round each station of a route. Paper A, IV.A, Fig. 6a (A7); C, 3.1."""

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


def station_of(stance: Int[Array, "*n"], leg: Int[Array, "*n"]) -> Int[Array, "*n"]:
    """The station at which a leg stands in a stance: the right legs at every other one, the left ones at those between."""
    return 2 * stance + jnp.asarray(LATER)[leg]


def nominal_foothold(gait: GaitParams, stations: Stations, station: Int[Array, ""], leg: Int[Array, ""]) -> Float[Array, "2"]:
    """A leg's nominal foothold (x, y in W) [m] at a station; beyond the last one it stays there."""
    station = jnp.minimum(station, stations.yaw.shape[0] - 1)
    return stations.xy[station] + turned(nominal_offset(gait, leg), stations.yaw[station])
