"""Speed of the off-lattice model: growth compared with C, measurement, cost against the number of cells, and threads.

Growth is timed at the means of Li et al.'s published posteriors for each of their three sets of colonies, in turn with
a C program of the same algorithm and random numbers (`offlattice.c`, compiled if there is a `cc`). Both must produce
the same colony, and the shortest of several times counts. Measurement is that of Li et al.: bins, the search for the
area with about six masks, and the statistics. Times are processor time of one core; those of threads are wall-clock
times and need an idle machine: how much faster two threads compute checksums, which share nothing, stands beside.

    python -m benchmarks.offlattice [--quick] [--json FILE]
"""

import hashlib
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from benchmarks.report import Report, command
from yeastfit.offlattice.colony import DELAY, OfflatticeColony, grow, grow_many, in_threads
from yeastfit.offlattice.masks.area_matching import match_exactly, search_from_below
from yeastfit.offlattice.masks.ellipse_mask import Ellipses
from yeastfit.offlattice.masks.li2024_mask import BinnedOutlines
from yeastfit.offlattice.random_numbers import seeded
from yeastfit.offlattice.statistics.li2024_statistics import li2024_statistics

SETS = {  # posterior means, cells and area in pixels: Li et al. 2024
    "AWRI 796, 50 µM": ((0.6332, 0.6145, 0.2521, 0.1321, 0.1174), 45_000, 573_920.0),
    "AWRI 796, 500 µM": ((0.8054, 0.5507, 0.1631, 0.2554, 0.1674), 90_000, 1_052_300.0),
    "Simi White, 50 µM": ((0.5648, 0.6921, 0.1931, 0.1779, 0.1558), 65_000, 825_329.0),
}
FIRST = "AWRI 796, 50 µM"
SIZES = (1_000, 10_000, 100_000, 1_000_000)
MANY = 8  # colonies, or checksums, on two threads
BLOCK = 4_000_000  # bytes of a checksum, which takes about as long as a colony
Result = TypeVar("Result")
FLAGS = ("-O3", "-march=native", "-ffp-contract=off", "-std=c11")  # no fused operations: the same bits


def run(report: Report, quick: bool) -> None:
    """Measure growth, measuring, sizes and threads."""
    repeats = 5 if quick else 25
    with tempfile.TemporaryDirectory() as folder:
        program = compiled(Path(folder))
        report.stage("growth" if program else "growth, without a C compiler")
        growth(report, repeats, program)
    report.stage("measuring")
    measuring(report, repeats)
    report.stage("sizes")
    sizes(report, SIZES[:3] if quick else SIZES)
    report.stage("threads")
    threads(report, 5 if quick else 50)


def growth(report: Report, repeats: int, program: Path | None) -> None:
    """Measure the seconds a colony takes, here and in C in turn, each the least of two times."""
    rows: list[dict[str, Any]] = []
    for name, (values, cells, _) in SETS.items():
        grow(values, cells=cells)
        ours, theirs = [], []
        for seed in range(repeats):
            (first, colony), (second, _) = (timed(grow, values, cells=cells, seed=seed) for _ in range(2))
            seconds = min(first, second)
            ours.append((seconds, 1e9 * seconds / colony.attempts))
            theirs.append(in_c(program, colony, seed) if program else np.nan)
        least, nanoseconds = np.min(ours, axis=0)
        row = {"set": name, "cells": cells, "seconds": least, "ns an attempt": nanoseconds}
        rows.append(row | {"seconds in C": min(theirs), "ratio": least / min(theirs)})
    report.table("growth", rows)
    report.add("45 000 cells grown", rows[0]["seconds"], "s", 0.05, at_least=False)
    if program:
        worst = max(row["ratio"] for row in rows)
        report.add("growth over that in C", worst, "×", 1.2, at_least=False, note="the worst of three sets")


def compiled(folder: Path) -> Path | None:
    """Compile the C program; None without a compiler."""
    if not (compiler := shutil.which("cc")):
        return None
    source, program = Path(__file__).with_suffix(".c"), folder / "offlattice"
    subprocess.run([compiler, *FLAGS, str(source), "-o", str(program), "-lm"], check=True)
    return program


def in_c(program: Path, colony: OfflatticeColony, seed: int) -> float:
    """Return the seconds that the C program takes for this colony, the least of two times.

    Raises:
        AssertionError: It came to another colony.
    """
    state = seeded(seed).state.tolist()
    numbers = (2, colony.cells, DELAY, *colony.rates, *state)
    run = subprocess.run([str(program), *map(repr, numbers)], capture_output=True, text=True, check=True)
    seconds, attempts, x, y, direction = (float(word) for word in run.stdout.split())
    assert (attempts, direction) == (colony.attempts, colony.direction[-1])
    assert (x, y) == (np.cumsum(colony.x)[-1], np.cumsum(colony.y)[-1])
    return seconds


def measuring(report: Report, repeats: int) -> None:
    """Measure each step from growth to the statistics, for each set."""
    rows: list[dict[str, Any]] = []
    for name, (values, cells, area) in SETS.items():
        found = [steps(values, cells, area, seed) for seed in range(repeats + 1)][1:]  # the first compiles
        least = {step: min(one[step] for one in found) for step in found[0]}
        rows.append({"set": name, "cells": cells} | {f"{step}, ms": 1e3 * seconds for step, seconds in least.items()})
    report.table("from growth to statistics", rows)
    whole = 1e-3 * rows[0]["Li et al.'s in all, ms"]
    report.add("45 000 cells with mask and all statistics of Li et al.", whole, "s", 0.15, at_least=False)


def steps(values: tuple[float, ...], cells: int, area: float, seed: int) -> dict[str, float]:
    """Return the seconds of each step of one colony."""
    grown, colony = timed(grow, values, cells=cells, seed=seed)
    binned, outlines = timed(BinnedOutlines.of, colony)
    searched, matched = timed(search_from_below, outlines.mask, cells, area)
    measured, _ = timed(li2024_statistics, matched.mask)
    drawn, ellipses = timed(Ellipses.of, colony)
    exactly, _ = timed(match_exactly, ellipses.mask, cells, 0.8 * area)
    return {
        "growth": grown,
        "bins": binned,
        "area search": searched,
        "statistics": measured,
        "Li et al.'s in all": grown + binned + searched + measured,
        "ellipses, gaps closed": drawn,
        "area matched exactly": exactly,
    }


def sizes(report: Report, counts: tuple[int, ...]) -> None:
    """Fit the exponent of the time against the number of cells, and that of the attempts that the model makes.

    Eight colonies of each size, three times: a machine may be slow for longer than the small ones take.
    """
    values = SETS[FIRST][0]
    found: dict[int, list[tuple[float, int]]] = {cells: [] for cells in counts}
    for first in (0, 8, 16):
        for cells, seed in product(counts, range(first, first + 8)):
            seconds, colony = timed(grow, values, cells=cells, seed=seed)
            found[cells].append((seconds / colony.attempts, colony.attempts))
    rows: list[dict[str, Any]] = []
    for cells, grown in found.items():
        each, attempts = np.array(grown).T
        rows.append({"cells": cells, "attempts a cell": attempts.mean() / cells, "ns an attempt": 1e9 * each.min()})
    report.table("against the number of cells", rows)
    size = np.array([row["cells"] for row in rows], dtype=float)
    tries = size * [row["attempts a cell"] for row in rows]
    seconds = tries * [1e-9 * row["ns an attempt"] for row in rows]
    report.add(
        "exponent of the attempts", slope(size, tries), "", note="the model's own: crowded colonies try more often"
    )
    report.add("exponent of the time", slope(size, seconds), "", 1.1, at_least=False)


def slope(x: np.ndarray, y: np.ndarray) -> float:
    """Return that of log y against log x."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def threads(report: Report, repeats: int) -> None:
    """Measure how much faster two threads grow colonies than one, in short runs one after the other.

    The median of such pairs counts. A processor that is alone may be clocked higher for a moment, which a shortest time
    of one thread is about.
    """
    values, cells, _ = SETS[FIRST]
    rows, seeds, block = np.tile(values, (MANY, 1)), range(MANY), bytes(BLOCK)
    work: dict[int, list[float]] = {1: [], 2: []}
    clock: dict[tuple[str, int], list[float]] = {key: [] for key in product(("colonies", "checksums"), work)}
    for _ in range(repeats):
        for count in work:
            began, worked = time.perf_counter(), time.process_time()
            grow_many(rows, seeds, cells=cells, threads=count)
            clock["colonies", count].append(time.perf_counter() - began)
            work[count].append(time.process_time() - worked)
            began = time.perf_counter()
            in_threads(hashlib.sha256, [block] * MANY, count)
            clock["checksums", count].append(time.perf_counter() - began)
    gains = {of: np.divide(clock[of, 1], clock[of, 2]) for of in ("colonies", "checksums")}
    least = min(clock["colonies", 1]) / min(clock["colonies", 2])
    note = f"{MANY} colonies, by the clock, on one thread and then on two; the median of {repeats} such pairs"
    report.add("two threads over one", float(np.median(gains["colonies"])), "×", 1.8, note=note)
    report.add("the same of the shortest times", least, "×", note="of one thread and of two, whenever each was")
    note = f"{MANY} checksums (SHA-256), likewise by pairs: what this machine gives two threads"
    report.add("the same of checksums", float(np.median(gains["checksums"])), "×", note=note)
    note = "what two threads cost more in all, waiting apart"
    report.add("processor time of two threads over that of one", min(work[2]) / min(work[1]), "×", note=note)


def timed(action: Callable[..., Result], *args: Any, **kwargs: Any) -> tuple[float, Result]:
    """Return the seconds of processor time that it takes, and what it returns."""
    began = time.thread_time()
    result = action(*args, **kwargs)
    return time.thread_time() - began, result


if __name__ == "__main__":
    command("offlattice", run)
