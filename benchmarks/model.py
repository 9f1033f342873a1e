"""How fast the model runs, how its cost and memory grow with nodes and members, and how long it takes to compile.

The source's problem: λ = 0.1, 5, 5, 0.5, 1, 1, 0.7 on 401 × 401 points, 805 steps of 0.02 (35 hours), 500 nodes. Our
model is relaxed, in single precision, with statistics on the whole grid. Targets:

- speed relative to tests/reference/colony.py (plain NumPy and SciPy, hard rules, the same tolerance of the nutrient
  solver, statistics at the same steps, one thread a process): 15 times for one colony, 20 times for 16 against two
  processes at once;
- cost of a step from 10² to 10⁵ nodes, on a domain that grows with them: exponent at most 1.1; 10⁵ nodes within 24 GB;
- compile time at most 15 s; on an H200, 100 runs per second.

Compile time is not included in any other figure. With --quick, speed is measured over 50 steps from the middle of a
run, where a colony has about its average number of nodes, and sizes end at 10⁴. On a GPU, sizes and ensembles are
measured and nothing is compared with NumPy; set JAX_PLATFORMS=cpu for that. The machine should be otherwise idle.
"""

import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.programs import (
    LAMBDA,
    MIDDLE,
    PART,
    SOURCE,
    STEPS,
    Program,
    further_steps,
    numerics_for,
    peak_memory,
    placed,
    samples,
    whole_runs,
)
from benchmarks.report import Report, command
from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import Colony, start
from yeastfit.model.nutrient import sweeps
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import step, trajectory

NOMINAL = {"H200": 4.8e12, "H100": 3.35e12, "A100": 2.0e12}  # bytes per second on the data sheets (SXM cards)
COLUMNS = ("points", "ms a step", "ms with statistics", "compile s", "arrays MB", "grown by MB", "process GB")


def compilation(report: Report, quick: bool) -> dict[int, Program]:
    """Measure compile times, first and so from cold. Returns the single-precision programs of whole runs by members."""
    programs: dict[int, Program] = {}
    rows = []
    for precision, members in (("single", 1), ("single", 16), ("double", 1), ("double", 16))[: 1 if quick else None]:
        report.stage(f"compiling whole runs of {members}, {precision} precision")
        with jax.enable_x64(precision == "double"):
            program = whole_runs(members, 10, MIDDLE if quick else STEPS)
        programs.setdefault(members, program)
        spent = {"tracing s": program.tracing, "compiling s": program.compiling, "both s": program.compile_time}
        rows.append({"members": members, "precision": precision, **spent})
    report.table("compile time of whole runs", rows)
    return programs


def against_reference(report: Report, quick: bool, programs: dict[int, Program], grown: Colony) -> dict[int, Program]:
    """Compare the time per step with the reference's. Returns our programs, statistics every tenth step, by members."""
    steps, rows, timed = PART // 2 if quick else STEPS, [], {}
    for members, processes, every in ((1, 1, 1), (1, 1, 10), (16, 2, 1), (16, 2, 10)):
        if quick and (members, every) == (16, 1):
            continue
        what = f"{members} colonies against {processes} processes" if members > 1 else "one colony against one process"
        report.stage(f"{what}, statistics every {every}")
        if quick:
            program = further_steps(grown, members, every, steps)
        else:
            program = programs[members] if every == 10 else whole_runs(members, every)
        (colony, observed), cores = program.timed()
        nodes = float(np.mean(observed["cell_count"])) + 1.0
        ours = 1e3 * program.wall / steps / members
        theirs = reference(processes, steps, every, grown if quick else None)
        plain = theirs["ms a step and colony"]
        counts = {"mean nodes": nodes, "nodes at the end": float(np.mean(colony.count)), "busy cores": cores}
        row = {"program": "yeastfit", "colonies": members, "statistics every": every, "ms a step and colony": ours}
        rows += [row | counts, row | {"program": "NumPy", "colonies": processes} | theirs]
        note = f"{ours:.3g} ms against {plain:.3g} ms a step and colony, {steps} steps"
        report.add(f"{what}, statistics every {every}", plain / ours, "×", 15 if members == 1 else 20, note=note)
        if every == 10:
            timed[members] = program
    report.table(f"time per step beside the NumPy reference's, over {steps} steps", rows)
    return timed


def reference(processes: int, steps: int, every: int, grown: Colony | None) -> dict[str, float]:
    """Time the NumPy program: one colony per process, all processes at once, one thread each."""
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    state = None
    if grown is not None:
        count = int(grown.count)
        positions, nutrient = (np.asarray(x, np.float64) for x in (grown.positions[:count], grown.nutrient))
        state = (positions, np.asarray(grown.parents[:count], np.int64), nutrient, int(grown.step))
    with spawned(processes) as pool:
        runs = list(pool.map(partial(_reference, steps, every, state), range(processes)))
    began, ended, means, last = zip(*runs, strict=True)
    return {
        "ms a step and colony": 1e3 * (max(ended) - min(began)) / steps / processes,
        "mean nodes": float(np.mean(means)),
        "nodes at the end": float(np.mean(last)),
        "busy cores": float(processes),
    }


def _reference(steps: int, every: int, state: Any, seed: int) -> tuple[float, float, float, int]:
    """In its own process: start and end time (on a clock that all share), mean and final number of nodes."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from reference import colony as plain

    rng = np.random.default_rng(seed)
    parameters, numerics = plain.Parameters(**LAMBDA), plain.Numerics()
    colony = plain.Colony(*state) if state else plain.start(numerics, rng.uniform(0, 2 * np.pi))

    def angles(_: int, parents: Any) -> Any:
        return rng.uniform(0, 2 * np.pi, len(parents))

    plain.step(colony, parameters, numerics, angles)  # its matrices, made once
    began, nodes = time.monotonic(), []
    for number in range(1, steps + 1):
        colony, seen = plain.step(colony, parameters, numerics, angles, cg_tolerance=1e-6)
        if number % every == 0 or number == steps:
            plain.statistics(colony, seen["level_set"], numerics, seen["growth_rate"])
            nodes.append(len(colony.positions))
    return began, time.monotonic(), float(np.mean(nodes)), nodes[-1]


def spawned(processes: int) -> ProcessPoolExecutor:
    """Fresh processes that share nothing with this one and start working when all of them are ready."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(processes, mp_context=context, initializer=context.Barrier(processes).wait)


def sizes(report: Report, quick: bool, grown: Colony, area: float) -> None:
    """Cost and memory of a step against nodes, in colonies as dense and as spread out as a simulated one."""
    nodes = int(grown.count)
    positions, parents = np.asarray(grown.positions[:nodes]), np.asarray(grown.parents[:nodes])
    length = float(np.median(np.hypot(*(positions[1:] - positions[parents[1:]]).T)))
    spread = nodes / float(np.max(np.hypot(*positions.T))) ** 2 / np.pi
    like = (nodes / area, spread, length, np.asarray(grown.nutrient))
    rows: list[dict[str, float]] = []
    for nodes in (10**2, 10**4) if quick else (10**2, 10**3, 10**4, 10**5):
        report.stage(f"{nodes} nodes")
        rows.append(_size(nodes, *like) if _gpu() else _size_apart(nodes, *like))
    shape = f"{like[0]:.2f} an area of colony, {spread:.2f} of the disc around it, cells of {length:.2f} L0"
    report.table(f"a step against nodes: {shape}", rows)

    def exponent(column: str, least: int = 0) -> float:
        x, y = np.log([(row["nodes"], row[column]) for row in rows if row["nodes"] >= least]).T
        return float(np.polyfit(x, y, 1)[0]) if np.isfinite(y).all() else np.nan

    for column in ("ms a step", "ms with statistics", "arrays MB"):
        note = "" if quick else f"10³ nodes and more: {exponent(column, 1000):.3f}"
        report.add(f"exponent in nodes, {column}", exponent(column), "", 1.1, at_least=False, note=note)
    last = rows[-1]
    note = "as the system counts it, with JAX and the compiler"
    report.add(f"peak memory, {last['nodes']} nodes", last["process GB"], "GB", 24, at_least=False, note=note)


def _size_apart(nodes: int, *like: Any) -> dict[str, float]:
    """`_size` in a fresh process; NaN if the system killed it for lack of memory."""
    with spawned(1) as pool:
        try:
            return pool.submit(_size, nodes, *like).result()
        except BrokenProcessPool:
            return {"nodes": nodes, **dict.fromkeys(COLUMNS, np.nan)}


def _size(nodes: int, *like: Any) -> dict[str, float]:
    """20 steps, the last with a mitosis event: time, size of arrays by XLA's count, growth and peak of the process."""
    jax.devices()
    before = peak_memory()
    numerics, colony = numerics_for(nodes), placed(nodes, *like)
    at = samples(20, 1, int(colony.step))
    smooth = SmoothStatistics(numerics.domain, numerics.spacing)
    walls = []
    for observe in (lambda _: None, smooth):
        rules = at, Relaxation(), numerics, observe
        program = Program.of(lambda p, c, rules=rules: trajectory(p, c, *rules), Parameters(**LAMBDA), colony)
        program.timed(1)
        program.timed(3 if nodes < 10**5 else 1)
        walls.append(1e3 * program.wall / at.steps.size)
    memory = program.memory / 1e6, (peak_memory() - before) / 1e6, peak_memory() / 1e9
    return {"nodes": nodes, **dict(zip(COLUMNS, (numerics.points, *walls, program.compile_time, *memory), strict=True))}


def ensembles(report: Report, quick: bool, timed: dict[int, Program], grown: Colony) -> None:
    """Runs per second against the size of the batch, statistics every tenth step.

    On a CPU, whole runs are timed for batches measured before; for the others 100 steps of the grown colony, where a
    step costs most, count as 100 of 805.
    """
    part, whole = PART // 2 if quick else PART, {} if quick else dict(timed)
    rows: list[dict[str, Any]] = []
    later = f"at {int(grown.count)} nodes per s"
    for members in (1, 16) if quick else (1, 4, 16, 64, 256):
        report.stage(f"ensemble of {members}")
        row: dict[str, Any] = {"members": members, "whole runs per s": None, later: None}
        if _gpu() and members not in whole:
            whole[members] = whole_runs(members, 10)
            whole[members].timed(1)
            whole[members].timed()
        if members in whole:
            program = whole[members]
            row["whole runs per s"] = members / program.wall
        if not _gpu():
            program = timed[members] if quick else further_steps(grown, members, 10, part)
            if not quick:
                program.timed(3 if members < 64 else 1)
            row[later] = members / program.wall * part / STEPS
        rows.append(row | {"arrays MB": program.memory / 1e6, "compile s": program.compile_time})
        report.row(rows[-1])
    report.table("ensembles, runs of 805 steps per second", rows)
    column = "whole runs per s" if whole else later
    best = max(row[column] for row in rows if row[column] is not None)
    kind = jax.devices()[0].device_kind
    report.add(
        f"best ensemble on {kind}, {column.removesuffix(' per s')}", best, "runs/s", 100 if "H200" in kind else None
    )
    traffic(report, kind, best * STEPS)


def traffic(report: Report, kind: str, rate: float) -> None:
    """Bytes moved in a step by XLA's count, compared with the measured bandwidth; `rate` in steps per s."""
    one = Program.of(
        lambda p, c: step(c, p, Relaxation(), SOURCE)[0], Parameters(**LAMBDA), start(jax.random.key(0), SOURCE)
    )
    more = int(sweeps(jnp.asarray(LAMBDA["diffusivity"] * SOURCE.dt / SOURCE.spacing**2))[0]) - 2
    field = 4.0 * SOURCE.points**2
    moved = dict(one.run.cost_analysis() or {}).get("bytes accessed", np.nan) + more * 5 * field
    note = f"{moved / field:.0f} times the grid: XLA counts a loop once, {more} more sweeps of 5 fields are added"
    report.add("bytes moved, a step and colony", moved / 1e6, "MB", note=note)
    size, times = 2**26, 20
    copying = Program.of(
        lambda x: jax.lax.fori_loop(0, times, lambda _, y: y + 1.0, x)[0], jnp.zeros(size, jnp.float32)
    )
    copying.timed()
    bandwidth = 2 * 4 * size * times / copying.wall
    nominal = next((f"data sheet: {value / 1e9:g} GB/s" for card, value in NOMINAL.items() if card in kind), "")
    report.add(f"memory bandwidth of {kind}, by copying", bandwidth / 1e9, "GB/s", note=nominal)
    note = "more than 100 where caches serve it"
    report.add("share of it that the best ensemble moves", 100 * moved * rate / bandwidth, "%", note=note)


def _gpu() -> bool:
    return jax.default_backend() == "gpu"


def run(report: Report, quick: bool) -> None:
    """Run all parts; on a GPU, those without NumPy."""
    report.add("load average before", os.getloadavg()[0], "", note="processes that were running: 0 on an idle machine")
    programs = compilation(report, quick)
    colonies, observed = programs[1].timed(1)[0]
    grown = jax.tree.map(lambda leaf: leaf[0], colonies)
    timed = {} if _gpu() else against_reference(report, quick, programs, grown)
    sizes(report, quick, grown, float(observed["area"][0, -1]))
    ensembles(report, quick, timed, grown)
    report.add("longest compile time of all programs", Program.longest, "s", 15, at_least=False)


if __name__ == "__main__":
    command("model", run)
