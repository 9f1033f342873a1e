"""How many processors this process may use."""

import os


def available_processors() -> int:
    """Count the processors that this process may run on.

    A scheduler or `taskset` may allow a process fewer processors than the machine has.

    Returns:
        At least 1.
    """
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows, which restrict no process
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
