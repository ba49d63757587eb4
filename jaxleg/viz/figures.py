"""The figures of a study, each a function that writes one PNG. What they have in common stands in `style`."""

from jaxleg.viz.gait import gait
from jaxleg.viz.results import energy
from jaxleg.viz.search import history, parameters
from jaxleg.viz.torque import torque_maps

__all__ = ["energy", "gait", "history", "parameters", "torque_maps"]
