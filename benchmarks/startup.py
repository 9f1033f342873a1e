"""How long commands take before they compute: the interpreter, imports, and programs compiled anew or kept.

Each command runs as a process of its own, several times; its time is the shortest. Beside the time on the clock stands
the processors' time, which a busy machine changes less. `yeastfit` keeps compiled programs in the user's cache folder;
here it is an empty one, in which the first of two small simulations leaves what the second takes. `yeastfit measure` of
one image does without JAX. Targets: 0.5 s for `yeastfit --help`, 1 s for `import yeastfit`, 3 s for the second small
simulation (one colony to 15 cells).

    python -m benchmarks.startup [--quick] [--json FILE]
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.report import Report, command
from yeastfit.commands.console.program_cache import MOST_BYTES, SHORTEST

TIMES = 5
SMALL = ("simulate", "--members", "1", "--time", "3")
PYTHON = {
    "python -c pass": ("-c", "pass"),
    "import yeastfit": ("-c", "import yeastfit"),
    "import jax": ("-c", "import jax"),
    "yeastfit --help": ("-m", "yeastfit", "--help"),
    "yeastfit measure --help": ("-m", "yeastfit", "measure", "--help"),
}
TARGETS = {"import yeastfit": 1.0, "yeastfit --help": 0.5, "second small simulation": 3.0}


@dataclass(frozen=True)
class Took:
    """Seconds of one process: on the clock, and of processors."""

    wall: float
    processors: float


def took(*arguments: str, environment: dict[str, str]) -> Took:
    """Run Python once."""
    before, began = os.times(), time.perf_counter()
    subprocess.run([sys.executable, *arguments], env=environment, stdout=subprocess.DEVNULL, check=True)
    wall, after = time.perf_counter() - began, os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return Took(wall, used)


def shortest(*arguments: str, environment: dict[str, str], times: int) -> Took:
    """Of several runs, by either measure."""
    runs = [took(*arguments, environment=environment) for _ in range(times)]
    return Took(min(one.wall for one in runs), min(one.processors for one in runs))


def disc(side: int = 400) -> np.ndarray:
    """A dark disc on bright, noisy ground."""
    x = np.arange(side) - 0.5 * side
    noise = np.random.default_rng(0).normal(0, 2, (side, side))
    return (np.where(np.hypot(x[:, None], x) <= 0.3 * side, 60, 180) + noise).astype(np.uint8)


def run(report: Report, quick: bool) -> None:
    """Measure every command."""
    times = 2 if quick else TIMES
    with tempfile.TemporaryDirectory() as folder:
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "XLA_"))}
        kept = {
            **environment,
            "JAX_COMPILATION_CACHE_DIR": str(Path(folder) / "programs"),
            "JAX_COMPILATION_CACHE_MAX_SIZE": str(MOST_BYTES),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": str(SHORTEST),
        }
        found = {}
        for name, arguments in PYTHON.items():
            report.stage(name)
            found[name] = shortest(*arguments, environment=environment, times=times)
        image = str(Path(folder) / "disc.png")
        Image.fromarray(disc()).save(image)
        report.stage("yeastfit measure")
        measure = ("-m", "yeastfit", "measure", image, "--pixel-size", "1.6", "--out", str(Path(folder) / "measured"))
        found["yeastfit measure, one image"] = shortest(*measure, environment=environment, times=times)
        simulate = ("-m", "yeastfit", *SMALL, "--out", str(Path(folder) / "simulated"))
        report.stage("first small simulation")
        found["first small simulation"] = took(*simulate, environment=kept)
        report.stage("second small simulation")
        found["second small simulation"] = shortest(*simulate, environment=kept, times=times)
    for name, each in found.items():
        note = f"{each.processors:.2f} s of processors"
        report.add(name, each.wall, "s", TARGETS.get(name), at_least=False, note=note)


if __name__ == "__main__":
    command("startup", run)
