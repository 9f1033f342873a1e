"""Compiled programs that outlive a run of the command line, by JAX's persistent cache in the user's cache folder.

Most of what a small simulation takes is compiling. JAX keys a program by what it computes, by its own version and XLA's
flags and, where XLA says it, by the processor; not every XLA does, and machines of different processors may share a
home. Each kind of processor therefore has a folder of its own. JAX removes what was used least recently where the
folder would exceed `MOST_BYTES`.

JAX writes a program in place, and then when it was used. A run that is killed in between leaves half a program, or one
that JAX cannot order: `_remove_unfinished` removes those that lack the second file.
"""

import hashlib
import os
import platform
from collections.abc import MutableMapping
from pathlib import Path

from filelock import FileLock, Timeout

MOST_BYTES = 100_000_000
SHORTEST = 0.02  # seconds of compiling; a program that takes less is compiled again as fast as it is read
PROGRAM, USED = "-cache", "-atime"  # how JAX's names end


def keep_programs(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let JAX, which is imported after this, keep programs, unless its own variables say where or whether.

    Nothing is kept where the folder cannot be written, which is no fault of the run.

    Arguments:
        environment: Of this process and those it starts; JAX's variables are set in it.
    """
    if "JAX_COMPILATION_CACHE_DIR" in environment or "JAX_ENABLE_COMPILATION_CACHE" in environment:
        return
    from platformdirs import user_cache_path

    folder = user_cache_path("yeastfit", appauthor=False) / "programs" / _processor()
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)  # whoever can write here can run code as this user
        _remove_unfinished(folder)
    except (OSError, Timeout):
        return
    environment["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    environment.setdefault("JAX_COMPILATION_CACHE_MAX_SIZE", str(MOST_BYTES))
    environment.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", str(SHORTEST))


def _processor() -> str:
    """A name for the kind of processor: its architecture, and a hash of its model and instructions."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        telling = ("model", "flags", "Features", "CPU part", "CPU implementer", "isa")
        said = "\n".join(sorted({line for line in lines if line.startswith(telling)}))
    except OSError:  # elsewhere than on Linux
        said = platform.processor()
    return f"{platform.machine()}-{hashlib.sha256(said.encode()).hexdigest()[:12]}"


def _remove_unfinished(folder: Path) -> None:
    """Remove programs of which a run that was killed has not written everything."""
    with FileLock(folder / ".lockfile", timeout=1):  # JAX's own lock: nobody is writing
        names = {each.name for each in os.scandir(folder)}
        for name in names:
            if name.endswith(PROGRAM) and name.removesuffix(PROGRAM) + USED not in names:
                (folder / name).unlink(missing_ok=True)
