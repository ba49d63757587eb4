"""What a result was made with: versions and hardware, which may change its last digits."""

import os
import platform
from importlib.metadata import version

import jax

PACKAGES = ("jaxleg", "jax", "jaxlib", "mujoco", "mujoco-mjx", "numpy", "optax")


def about() -> dict[str, dict[str, str]]:
    """Versions of Python and the packages, the machine and JAX's devices, in words."""
    devices = jax.local_devices()
    return {
        "versions": {"python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "hardware": {
            "machine": platform.machine(),
            "cores": str(os.cpu_count()),
            "devices": f"{len(devices)} x {devices[0].device_kind}",
        },
    }
