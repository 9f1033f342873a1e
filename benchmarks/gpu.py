"""Colonies of real size on a GPU, one and many at once, what its kernels keep busy, and the training of an emulator.

The colony is that of `benchmarks.large`, grown as a user grows it, to given numbers of nodes and then until an area of
24 500 L0². At each size further steps, one division event among them, are timed for one colony and for several equal
ones together; their cost, interpolated between the sizes, gives the time in which so many grow to the end. Kernels are
those of a trace by JAX's profiler: how many a step runs, for which share of the time one is running, and the occupancy
that their registers and threads allow, the share of a multiprocessor's warps, in the mean over that time. The emulator
is trained on draws of normal distributions whose means and widths depend on three parameters.

Runs on a CPU, too, without the kernels, several colonies at once being one after another there. With --quick colonies
end at 1000 nodes. The machine should be otherwise idle.

    python -m benchmarks.gpu [--quick] [--json FILE]
"""

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.profiler import ProfileData

from benchmarks.large import AREA, LARGE, NODES, NUMERICS, Growth
from benchmarks.programs import Program, further_steps, whole_runs
from benchmarks.report import Report, command
from yeastfit.inference.neural_likelihood.training import train
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.inference.prior.prior import Prior

MEMBERS = 64
STEPS = NUMERICS.steps_per_event
SIMULATIONS, STATISTICS = 3000, 30
DEVICE, OCCUPANCY = "/device:GPU", "theoretical_occupancy_pct"  # as JAX's profiler names them


def kernels(program: Program, steps: int) -> dict[str, Any]:
    """Of a program that does so many steps and has run before."""
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            jax.block_until_ready(program.run(*program.arguments))
        trace = ProfileData.from_file(str(next(Path(folder).rglob("*.xplane.pb"))))
    lines = [line for plane in trace.planes if plane.name.startswith(DEVICE) for line in plane.lines]
    found = [event for line in lines if line.name.startswith("Stream") for event in line.events]
    began, length = (np.array([getattr(one, name) for one in found]) for name in ("start_ns", "duration_ns"))
    known = np.array([float(dict(one.stats).get(OCCUPANCY) or np.nan) for one in found])  # copies have none
    counted = np.isfinite(known)
    return {
        "kernels a step": len(found) / steps,
        "µs a kernel": 1e-3 * float(length.mean()),
        "running, %": 100 * float(length.sum() / ((began + length).max() - began.min())),
        "occupancy, %": float(np.average(known[counted], weights=length[counted])) if counted.any() else np.nan,
    }


def grow(report: Report, quick: bool, members: int) -> None:
    """One colony to real size, and steps of one and of several on the way."""
    growth, rows, traced = Growth(), [], []
    for size in [{"nodes": count} for count in (NODES[:1] if quick else NODES)] + ([] if quick else [{"area": AREA}]):
        report.stage(", ".join(f"{name} {value:g}" for name, value in size.items()))
        area = float(growth.until(**size).statistics["area"][0])
        assert growth.colony is not None
        row: dict[str, Any] = {"nodes": int(growth.colony.count), "area": area, "seconds so far": growth.seconds}
        row["time"] = float(growth.colony.step) * NUMERICS.dt
        numerics = replace(NUMERICS, capacity=growth.colony.parents.shape[0])
        for count in (1, members):
            program = further_steps(growth.colony, count, STEPS, STEPS, LARGE.values, numerics, lambda _: None)
            program.timed(1)
            program.timed(1 if count > 1 else 3)
            row[f"ms a step, {count}"] = 1e3 * program.wall / STEPS
            if on_gpu():
                of: dict[str, Any] = {"nodes": row["nodes"], "colonies": count}
                traced.append(of | kernels(program, STEPS))
                report.row(traced[-1])
        rows.append(row | {"arrays of all, GB": program.memory / 1e9})
        report.row(rows[-1])
    report.table(f"a step as the colony grows, of one and of {members} together", rows)
    if traced:
        report.table("kernels of a step", traced)
    note = f"{rows[-1]['nodes']} nodes, compiling included"
    report.add(f"one colony until {rows[-1]['area']:.0f} L0²", growth.seconds, "s", note=note)
    for count in (1, members):
        cost = [row[f"ms a step, {count}"] for row in rows]
        times = [0.0, *(row["time"] for row in rows)]
        spent = 1e-3 / NUMERICS.dt * float(np.trapezoid([cost[0], *cost], times))
        report.add(f"steps of {count}, until then", spent, "s", note=f"{spent / count:.3g} s a colony")


def busy(report: Report, members: int, steps: int) -> None:
    """Kernels of an ensemble of the source's problem, in its middle."""
    report.stage("kernels of the source's problem")
    grown = jax.tree.map(lambda leaf: leaf[0], whole_runs(1, steps, steps).timed(1)[0][0])
    rows = []
    for count in (1, members):
        program = further_steps(grown, count, 10, 50)
        program.timed(1)
        rows.append({"colonies": count} | kernels(program, 50))
    report.table("kernels of a step of the source's problem, with statistics at every tenth", rows)


def training(report: Report, quick: bool) -> None:
    """An emulator, twice: the second time nothing is compiled."""
    report.stage("training of an emulator")
    rng, count = np.random.default_rng(0), 300 if quick else SIMULATIONS
    prior = Prior(
        {
            name: Distribution("uniform", {"low": 0.5, "high": 2.0})
            for name in ("mobility", "metabolic_rate", "aspect_ratio")
        }
    )
    values = prior.sample(count, rng)
    slopes, widths = rng.normal(size=(2, 3, STATISTICS))
    scatter = 0.1 * np.exp(0.3 * np.tanh(values @ widths))
    statistics = np.sin(values @ slopes) + scatter * rng.normal(size=(count, STATISTICS))
    labels, spent = [f"statistic {k}" for k in range(STATISTICS)], []
    for seed in range(2):
        began = time.perf_counter()
        found = train(values, statistics, prior=prior, labels=labels, seed=seed)
        jax.block_until_ready(found.ensemble)
        spent.append(time.perf_counter() - began)
    note = f"{count} simulations of {STATISTICS} statistics; {spent[0]:.3g} s with compiling"
    report.add("training of an emulator", spent[1], "s", note=note)


def on_gpu() -> bool:
    """Whether JAX computes on one."""
    return jax.default_backend() == "gpu"


def run(report: Report, quick: bool) -> None:
    """Run all parts."""
    members = 4 if quick else MEMBERS if on_gpu() else 1
    training(report, quick)
    if on_gpu():
        busy(report, members, 50 if quick else 410)
    grow(report, quick, members)


if __name__ == "__main__":
    command("gpu", run)
