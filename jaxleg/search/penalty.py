"""What a violated constraint costs: quadratic at first, then linear, so that one bad constraint does not drown all others."""

from typing import Any

import numpy as np


def fine(violation: Any) -> Any:
    """2 (sqrt(1 + v^2) - 1) of a violation of v >= 0 units; elementwise, for JAX and NumPy."""
    return 2.0 * ((1.0 + violation**2) ** 0.5 - 1.0)


def fine_slopes(violation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivative of `fine`."""
    root = (1.0 + violation**2) ** 0.5
    return 2.0 * violation / root, 2.0 / root**3
