"""What runs in a worker process. It makes the simulator from its specification, once, and simulates blocks of rows.

A process of its own with one device. What decides over bits beside the program is taken over from the process that
asks: XLA divides its loops among as many parts as its pool has threads, and a sum's rounding depends on that number.
So a worker's pool is as large as the other's, whatever the worker's own machine has (`Arithmetic.threads`).

Nothing here imports jax before `settle` has set what jax reads when it is imported. Programs are compiled once a
machine and kept on its local disk.
"""

import os
import socket
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

Block = tuple[np.ndarray, np.ndarray]
"""Values [row, parameter], and seeds."""


class NotMade(LookupError):
    """A simulator is asked for that this process has not made."""


_made: dict[tuple[str, int], Any] = {}  # by digest, and rows of a block
_settled: dict[str, Any] = {}


def settle(threads: int, double: bool) -> None:
    """Make this process one with one device, before jax is imported.

    Arguments:
        threads: Of XLA's pool.
        double: Whether arrays are in double precision.
    """
    if _settled:
        return
    os.environ.update({"NPROC": str(threads), "JAX_NUM_CPU_DEVICES": "1"})
    import jax
    from threadpoolctl import threadpool_limits

    jax.config.update("jax_num_cpu_devices", 1)
    jax.config.update("jax_enable_x64", double)
    if (folder := _programs(threads)) is not None:
        jax.config.update("jax_compilation_cache_dir", str(folder))
    threadpool_limits(1)
    _settled.update({"threads": threads, "double": double})


def admit(text: str, size: int, threads: int, double: bool, blocks: list[Block]) -> dict[str, Any]:
    """Make the simulator, unless it is there, and simulate blocks that are known elsewhere.

    Arguments:
        text: Of the simulator's `Specification`.
        size: Rows of every block; smaller ones are filled up.
        threads: See `settle`.
        double: See there.
        blocks: At least one; the last one is timed.

    Returns:
        `arithmetic` of this process as plain data, its `name`, how many `tasks` it does at once, `rows` of each block,
        and `seconds` of the last.
    """
    settle(threads, double)
    from yeastfit.inference.workers.arithmetic import Arithmetic
    from yeastfit.specification import Specification

    specification = Specification.read(text)
    if (specification.digest, size) not in _made:
        simulator = specification.made()
        own = getattr(simulator, "in_blocks_of", None)
        _made[specification.digest, size] = simulator if own is None else own(size)
    name, tasks = _worker()
    found = [simulate(specification.digest, size, *block) for block in blocks]
    return {
        "arithmetic": Arithmetic.of_this_process().asdict(),
        "name": f"{name} on {socket.gethostname()}",
        "tasks": tasks,
        "rows": [each["rows"] for each in found],
        "seconds": found[-1]["seconds"],
    }


def simulate(digest: str, size: int, values: np.ndarray, seeds: np.ndarray) -> dict[str, Any]:
    """One block.

    Arguments:
        digest: Of the simulator's specification, which `admit` has read.
        size: Rows of every block, as `admit` has it.
        values: Parameters [row, parameter].
        seeds: One a row.

    Returns:
        `rows`, what they ran into (`problems`), and `seconds`.
    """
    if (digest, size) not in _made:
        raise NotMade(digest)
    simulator = _made[digest, size]
    problems: Mapping[str, int] = getattr(simulator, "problems", {})
    before, began = Counter(problems), time.perf_counter()
    rows = in_full(simulator, size, values, seeds)
    return {"rows": rows, "problems": dict(Counter(problems) - before), "seconds": time.perf_counter() - began}


def in_full(simulator: Any, size: int, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
    """Rows of a simulator that is always called with `size` rows, filled up with copies of the first."""
    pick = np.concatenate([np.arange(len(seeds)), np.zeros(size - len(seeds), dtype=int)])
    return np.asarray(simulator(values[pick], seeds[pick]), dtype=float)[: len(seeds)]


def _worker() -> tuple[str, int]:
    """Its name, and how many tasks it does at once."""
    from distributed import get_worker

    try:
        worker = get_worker()
    except ValueError:  # not in a process of Dask
        return f"process {os.getpid()}", 1
    return str(worker.name), worker.state.nthreads


def _programs(threads: int) -> Path | None:
    """Where compiled programs for a number of threads are kept; None where it is not safe.

    Compiled programs are run: a folder that somebody else could have filled is not used.
    """
    import jaxlib

    given = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    user = getattr(os, "getuid", lambda: "user")()
    folder = Path(given) if given else Path(tempfile.gettempdir()) / f"yeastfit-programs-{user}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not given and hasattr(os, "getuid"):
            about = folder.lstat()
            if about.st_uid != os.getuid() or about.st_mode & 0o077 or folder.is_symlink():
                return None
        folder = folder / f"workers-{jaxlib.__version__}-{threads}"
        folder.mkdir(exist_ok=True)
    except OSError:
        return None
    return folder
