"""Simulations on worker processes, and on a thousand workers by simulation.

Efficiency: waves of colonies that take at least 0.2 s each, on one worker process and on two, in one run and on one
thread each: how many times as fast two are. Colonies are those of the off-lattice model and of the algebraic one.

Overhead: waves of a simulator that computes nothing, on one worker, stored block by block as a run stores them. A block
costs the asking process `parent` seconds of processor time, the scheduler in it included, and comes back every
`round trip` seconds. Bytes are those that pass the loopback, in blocks of 8 rows and of 128, less what passes it when
nothing is simulated: a row's share and a block's.

On paper: 10⁶ colonies on up to 3000 workers by discrete events. Blocks are given out by the program itself, to workers
that take a log-normal time for a colony, its mean and scatter as measured for the off-lattice model; the asking process
takes the measured time for each block and does one thing at a time; messages take 1 ms each way. Efficiency is the
share of the workers' time that is spent on colonies.

Targets: two workers at least 1.7 times as fast as one.

    python -m benchmarks.cluster [--quick] [--json FILE] [--docs DIR]

The machine has to be idle: the page says what it was doing before. --quick: few colonies, and 10⁵ of them on paper.
--docs writes DIR/cluster-benchmark.md.
"""

import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import jax
import numpy as np
import psutil

from benchmarks.cluster_simulation import simulated
from benchmarks.nothing import Nothing
from benchmarks.report import Report, command
from yeastfit.inference.colony_simulator import ColonySimulator
from yeastfit.inference.imaging import Imaging
from yeastfit.inference.resolution import Resolution
from yeastfit.inference.simulator import Simulator, labels_of
from yeastfit.inference.store.cached_simulator import CachedSimulator
from yeastfit.inference.store.simulation_store import Store
from yeastfit.inference.targets import Targets
from yeastfit.inference.workers.spread import BLOCK, Workers
from yeastfit.offlattice.simulator import OfflatticeSimulator

LEAST, FASTER = 0.2, 1.7  # seconds of a colony, and two workers against one
LATENCY = 1e-3
LARGE = 128  # rows of a large block
CROWDS, BLOCKS = (10, 100, 300, 1000, 3000), (8, 32, 128)


def offlattice() -> tuple[Simulator, np.ndarray]:
    """Colonies of 200 000 cells, and their parameters."""
    free = ("transition", "fork")
    simulator = OfflatticeSimulator.of(("compactness", "area"), cells=200_000, free=free, threads=1)
    return simulator, np.random.default_rng(1).uniform(0.1, 0.5, (256, 2))


def algebraic() -> tuple[Simulator, np.ndarray]:
    """Colonies of some hundred cells, and their parameters."""
    times = np.array([3.0, 5.5, 8.0])
    curves = {name: np.ones(len(times)) for name in ("compactness", "radius")}
    targets = Targets.from_means(curves, times, imaging=Imaging(extent=8.0))
    simulator = ColonySimulator.of(targets, ("mobility", "aspect_ratio"), resolution=Resolution(dt=0.01, spacing=0.1))
    rng = np.random.default_rng(1)
    return simulator, np.exp(rng.uniform(np.log([0.5, 0.5]), np.log([2.0, 0.9]), (256, 2)))


def rates(simulator: Simulator, values: np.ndarray, counts: tuple[int, ...]) -> dict[int, tuple[float, np.ndarray]]:
    """Rows a second by number of workers, and what was computed, admission left out."""
    found = {}
    for count in counts:
        with Workers(count, say=_quiet) as workers:
            spread = workers.spread(simulator)
            spread(values[: 4 * BLOCK], np.arange(4 * BLOCK))
            began = time.perf_counter()
            rows = spread(values, np.arange(len(values)))
            found[count] = len(values) / (time.perf_counter() - began), rows
    return found


def efficiency(report: Report, name: str, make: Callable[[], tuple[Simulator, np.ndarray]], quick: bool) -> float:
    """Two workers against one; seconds of a colony."""
    report.stage(f"{name}: one worker and two")
    simulator, values = make()
    values = values[: 32 if quick else len(values)]
    found = rates(simulator, values, (1, 2))
    same = all(rows.tobytes() == found[1][1].tobytes() for _, rows in found.values())
    each = 1 / found[1][0]
    note = f"{each:.2f} s a colony; rows {'the same bits' if same else 'OF OTHER BITS'}; load {os.getloadavg()[0]:.1f}"
    target = FASTER if each >= LEAST and not quick else None
    report.add(f"{name}: two workers against one", found[2][0] / found[1][0], "×", target, note=note)
    return each


def scatter_of(simulator: Simulator, values: np.ndarray) -> float:
    """Standard deviation of a colony's seconds over their mean, here."""
    taken = []
    for number, row in enumerate(values):
        began = time.perf_counter()
        simulator(row[None], np.array([number]))
        taken.append(time.perf_counter() - began)
    return float(np.std(taken[1:]) / np.mean(taken[1:]))


def overhead(report: Report, blocks: int) -> float:
    """Of a block, on one worker; the asking process's seconds."""
    report.stage("overhead and bytes")
    figures: dict[int, dict[str, float]] = {}
    for size in (BLOCK, LARGE):
        with tempfile.TemporaryDirectory() as folder, Workers(1, block=size, say=_quiet) as workers:
            path, simulator = Path(folder) / "simulations.h5", Nothing()
            with Store(path, simulator.parameters.names, labels_of(simulator)) as store:
                cached = CachedSimulator(workers.spread(simulator), size, store)
                cached(*_rows(4 * size, 0))
                idle = _bytes_of(partial(time.sleep, 2.0)) / 2.0
                began, busy = time.perf_counter(), time.process_time()
                through = _bytes_of(partial(cached, *_rows(blocks * size, 1)))
                seconds = time.perf_counter() - began
                figures[size] = {
                    "round trip": seconds / blocks,
                    "parent": (time.process_time() - busy) / blocks,
                    "bytes": max(through - idle * seconds, 0.0) / blocks,
                }
    row = (figures[LARGE]["bytes"] - figures[BLOCK]["bytes"]) / (LARGE - BLOCK)
    parent = figures[BLOCK]["parent"]
    report.add("a block's round trip", 1000 * figures[BLOCK]["round trip"], "ms", note="8 rows, computing nothing")
    report.add("a block in the asking process", 1000 * parent, "ms", note="processor time, with scheduler and store")
    report.add("a row through the asking process", row, "bytes", note="3 parameters, 20 statistics; both ways")
    report.add("a block through it, besides", figures[BLOCK]["bytes"] - BLOCK * row, "bytes")
    report.details["overhead"] = {str(size): each for size, each in figures.items()}
    return parent


def on_paper(report: Report, colony: float, scatter: float, parent: float, colonies: int) -> None:
    """Tables by workers and blocks, for one long wave and for the emulator's."""
    for wave, title in ((colonies, "one wave"), (512, "waves of 512, as the emulator's")):
        rows = []
        for workers, block in product(CROWDS, BLOCKS if wave == colonies else BLOCKS[:1]):
            report.stage(f"{colonies} colonies on {workers} workers, blocks of {block}, {title}")
            count = colonies if wave == colonies else min(colonies, 50_000)
            found = simulated(count, workers, block, wave, colony, scatter, parent, LATENCY)
            rows.append(
                {
                    "workers": workers,
                    "block": block,
                    "efficiency": found["efficiency"],
                    "hours": found["hours"],
                    "asking process busy": found["parent_busy"],
                    "blocks a second": count / block / found["hours"] / 3600,
                    "distribution, ms a block": 1000 * found["dispatch"],
                }
            )
        report.table(f"{count} colonies of {colony:.2g} s ± {100 * scatter:.0f} %, {title}", rows)
        if wave == colonies:
            for block in BLOCKS:
                one = next(row for row in rows if (row["workers"], row["block"]) == (1000, block))
                report.add(f"efficiency of 1000 workers, blocks of {block}, by simulation", one["efficiency"], "")


def measure(report: Report, quick: bool) -> None:
    """All of it."""
    os.environ["NPROC"] = "1"
    jax.config.update("jax_num_cpu_devices", 1)
    load = os.getloadavg()
    report.details["load before"] = load
    report.table(
        "load of the machine before", [{f"{minutes} min": one for minutes, one in zip((1, 5, 15), load, strict=True)}]
    )
    colony = efficiency(report, "off-lattice", offlattice, quick)
    efficiency(report, "algebraic", algebraic, quick)
    simulator, values = offlattice()
    scatter = scatter_of(simulator, values[: 9 if quick else 33])
    parent = overhead(report, 100 if quick else 1000)
    on_paper(report, colony, scatter, parent, 100_000 if quick else 1_000_000)
    if report.docs is not None:
        report.docs.mkdir(parents=True, exist_ok=True)
        text = "\n".join([report.head(__doc__), "", *report.sections(), _limits(report)])
        (report.docs / "cluster-benchmark.md").write_text(text)


def _limits(report: Report) -> str:
    """Where it breaks, from the figures."""
    values = {figure.name: figure.value for figure in report.figures}
    parent = values["a block in the asking process"] / 1000
    row, block = values["a row through the asking process"], values["a block through it, besides"]
    total = 1e6 * row + 1e6 / BLOCK * block
    return f"""## Where it breaks

The asking process is a single server of {1 / parent:.0f} blocks a second. Workers that finish more than that wait:
with blocks of {BLOCK} colonies of one second that is the case from about {BLOCK / parent:.0f} workers on, and
`--block {LARGE}` moves it {LARGE // BLOCK} times as far. 10⁶ colonies send {total / 1e9:.2g} GB through it,
{total / 1e6:.0f} bytes a colony: no network is a limit before the process is.

Waves break it sooner. A wave of 512 is 64 blocks of {BLOCK}: more workers than that have nothing to do, and every wave
ends with its slowest block.

What would be changed for more than some thousand workers, in this order: larger blocks, which need larger waves;
several writers, each with a store of its own for a share of the seeds, read together (`--reuse` reads one other store
today); several asking processes, each with its own scheduler.
"""


def _rows(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.1, 1.0, (count, 3)), rng.integers(0, 2**63, count, dtype=np.uint64)


def _bytes_of(work: Callable[[], Any]) -> float:
    """What passes the loopback meanwhile."""
    loop = next(name for name in psutil.net_io_counters(pernic=True) if name.startswith("lo"))
    before = psutil.net_io_counters(pernic=True)[loop].bytes_sent
    work()
    return float(psutil.net_io_counters(pernic=True)[loop].bytes_sent - before)


def _quiet(line: str) -> None:
    """Say nothing."""


if __name__ == "__main__":
    command("cluster", measure)
