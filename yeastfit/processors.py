"""Which processors this process may use, and what JAX computes on."""

import os
import sys
from typing import Any


def available_processors() -> int:
    """Count the processors that this process may run on.

    A scheduler or `taskset` may allow a process fewer processors than the machine has.

    Returns:
        At least 1.
    """
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows, which restrict no process
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def device_used() -> dict[str, Any]:
    """Describe what JAX computes on, for the record of a run.

    Returns:
        {"device": its kind, platform and count}; nothing where the process has done without JAX.
    """
    if "jax" not in sys.modules:
        return {}
    import jax

    device = jax.devices()[0]
    return {"device": {"kind": device.device_kind, "platform": device.platform, "count": jax.device_count()}}
