"""Memory: what this machine has, and whether sizes fit into it, asked before anything is allocated."""

from pathlib import Path

import psutil

from yeastfit.errors import InputError

GROUP = Path("/sys/fs/cgroup/memory.max")  # of a container or a job, on Linux
ITEM = 1000  # bytes that a simulation, a draw or a start takes at least, its parameters, seed and statistics


def machine_memory() -> int:
    """Bytes of memory that this machine has, or that the process's group is allowed."""
    try:
        allowed = int(GROUP.read_text())
    except (OSError, ValueError):  # there is no such file, or it says `max`
        return psutil.virtual_memory().total
    return min(allowed, psutil.virtual_memory().total)


def check_memory(size: float, what: str) -> None:
    """Check that sizes fit into memory.

    Arguments:
        size: Bytes, estimated from below.
        what: What needs them, with the argument's name and value.

    Raises:
        InputError: The machine has less.
    """
    if not size <= (room := machine_memory()):
        raise InputError(f"{what} would take {in_words(size)} of memory, this machine has {in_words(room)}")


def check_count(name: str, count: float, each: float = ITEM) -> None:
    """Check that so many of something fit into memory; see `check_memory`.

    Arguments:
        name: Of the argument.
        count: Its value.
        each: Bytes that one of them takes.

    Raises:
        InputError: The machine has less.
    """
    count = min(count, 1e300)  # of a whole number without end
    check_memory(count * each, f"{name} is {count:g}, which")


def in_words(size: float) -> str:
    """As in "15.6 GiB"."""
    return f"{size / 2**30:.3g} GiB"
