"""Colonies of real size: what a step costs as they grow, with compiled contact and with the plain one.

One colony grows as `yeastfit simulate --relaxed --capacity 200000 --domain 300 --spacing 0.4 --dt 0.025 --mobility 1.3
--metabolic-rate 0.9 --aspect-ratio 0.65` grows it, seed 0, to given numbers of nodes and then until an area of 24 500
L0², that of a photographed colony. At each size, 20 further steps are timed with compiled contact and by the plain
switch (`Numerics.compiled`), after both programs have been compiled. A second colony, whose cells need more nutrient
and are rounder (λ6 = 1.8, λ7 = 0.9), comes to the same area with a third of the cells. Targets:

- until the area, births not cut: at most 90 s, of the second one 40 s, compiling included;
- 500 hard colonies of that area in at most 10 hours, by the default steps of a wide dish, each core one at a time;
- with --against: at least 8 times as fast as older code;
- cost of a step against nodes: exponent at most 1.0;
- memory of the process at most 24 GB.

The plain colony is not grown as a whole: its time is that of the compiled one's steps at the plain cost, which is
interpolated between the sizes. With --against the command above, to the time at which the first colony came to the
area, runs as a user would run it: with this code, then with that of a checkout of another commit, by the same Python.
With --quick the colony ends at 4000 nodes, which is mostly compiling. The machine should be otherwise idle.

    python -m benchmarks.large [--quick] [--json FILE] [--against CHECKOUT]
"""

import argparse
import csv
import os
import subprocess
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jax
import numpy as np

from benchmarks.programs import peak_memory
from benchmarks.report import Report, command
from yeastfit.model.colony import Colony
from yeastfit.model.model import Model
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Snapshot
from yeastfit.simulation.result import Simulation
from yeastfit.simulation.segments import Segments
from yeastfit.simulation.simulate import member_keys, simulate

NUMERICS = Numerics(domain=300.0, spacing=0.4, dt=0.025, capacity=200_000)
LARGE = Parameters(mobility=1.3, metabolic_rate=0.9, aspect_ratio=0.65)
HUNGRY = Parameters(mobility=1.3, metabolic_rate=1.8, aspect_ratio=0.9)
NODES = (1000, 4000, 16_000, 64_000)
AREA = 24_500.0  # L0², of the smallest set of photographed colonies
COLUMNS = {"cells": "cell_count", "area": "area"}
POSTERIOR = 500  # colonies of a posterior
HERE = Path(__file__).parents[1]
STEPS, LATEST = 20, 200.0  # further steps that are timed; a time that no colony comes to


@dataclass
class Growth:
    """One colony as it grows, and what that has taken."""

    parameters: Parameters = LARGE
    colony: Colony | None = None
    seconds: float = 0.0
    processor: float = 0.0
    costs: list[dict[str, float]] = field(default_factory=list)

    def until(self, **size: float) -> Simulation:
        """Grow further."""
        begin: dict[str, Any] = {"keys": member_keys(0, 1)[0]} if self.colony is None else {"start": self.colony}
        wall, busy = time.perf_counter(), time.process_time()
        grown = simulate(self.parameters, **begin, times=[LATEST], until=size, numerics=NUMERICS)
        self.seconds += time.perf_counter() - wall
        self.processor += time.process_time() - busy
        self.colony = grown.colony
        return grown

    def timed(self, area: float) -> None:
        """What a step costs at the present size, by either sum."""
        assert self.colony is not None
        row = {"nodes": int(self.colony.count), "time": float(self.colony.step) * NUMERICS.dt, "area": area}
        for name, compiled in (("ms compiled", True), ("ms plain", False)):
            row[name] = 1e3 * _step(self.colony, compiled)
        row["ratio"] = row["ms plain"] / row["ms compiled"]
        self.costs.append(row | {"seconds so far": self.seconds, "processor s so far": self.processor})


def _step(colony: Colony, compiled: bool) -> float:
    """Seconds a step, over the next `STEPS`."""
    model = Model()
    how = Segments(model.complete(LARGE), Relaxation(), replace(NUMERICS, compiled=compiled), _growth_rate, model)
    spent = []
    for _ in range(2):  # the first one compiles
        began = time.perf_counter()
        jax.block_until_ready(how.grown(colony, [int(colony.step) + STEPS]))
        spent.append(time.perf_counter() - began)
    return spent[-1] / STEPS


def _growth_rate(snapshot: Snapshot) -> jax.Array:
    return snapshot.growth_rate


def plain_seconds(costs: list[dict[str, float]], seconds: float) -> float:
    """The time of all steps at the plain cost, where they have taken `seconds` at the compiled one.

    Costs are interpolated in time between the sizes; below the smallest they are those of the smallest.
    """
    times = np.array([0.0, *(row["time"] for row in costs)])
    ours, plain = (np.array([costs[0][name], *(row[name] for row in costs)]) for name in ("ms compiled", "ms plain"))
    steps = 1e-3 / NUMERICS.dt
    return seconds + steps * float(np.trapezoid(plain - ours, times))


def command_run(code: Path, *options: str) -> dict[str, float]:
    """Seconds of `yeastfit simulate` with the code of a folder, and the mean of its colonies at their end.

    Raises:
        CalledProcessError: The command failed.
    """
    given = [*options, "--seed", "0", "--domain", f"{NUMERICS.domain:g}"]
    for name in ("mobility", "metabolic_rate", "aspect_ratio"):
        given += [f"--{name.replace('_', '-')}", f"{float(getattr(LARGE, name)):g}"]
    with TemporaryDirectory() as folder:
        out = Path(folder) / "colony"
        arguments = [sys.executable, "-m", "yeastfit", "simulate", "--out", str(out), *given]
        began = time.perf_counter()
        subprocess.run(arguments, cwd=folder, env=os.environ | {"PYTHONPATH": str(code.resolve())}, check=True)
        seconds = time.perf_counter() - began
        with (out / "curves.csv").open(encoding="utf-8") as file:
            ends = {row["member"]: row for row in csv.DictReader(file)}.values()
    means = {name: float(np.mean([float(row[column]) for row in ends])) for name, column in COLUMNS.items()}
    return {"colonies": len(ends), "seconds": seconds, **means}


def compare(report: Report, against: Path, end: float, quick: bool) -> None:
    """The command with this code and with that of another checkout."""
    steps = [f"--{name}={getattr(NUMERICS, name):g}" for name in ("spacing", "dt", "capacity")]
    runs = {}
    for name, code in (("this code", HERE), ("the other", against)):
        report.stage(f"the command to t = {end:g}, {name}")
        runs[name] = command_run(code, "--relaxed", "--members=1", f"--time={end:g}", *steps)
    report.table(f"the command to t = {end:g}", [{"code": name} | one for name, one in runs.items()])
    ratio = runs["the other"]["seconds"] / runs["this code"]["seconds"]
    report.add("the other code, the command", ratio, "×", None if quick else 8, note="times as long")


def posterior(report: Report) -> None:
    """What the colonies of a posterior take: two hard ones, as they are compared with photographs, on all cores."""
    report.stage("two hard colonies by the default steps")
    pair = command_run(HERE, "--hard", "--members=2", f"--until-area={AREA:g}", f"--time={LATEST:g}")
    note = f"by two of {pair['cells']:.0f} cells on average, which take {pair['seconds']:.0f} s together"
    hours = POSTERIOR / 2 * pair["seconds"] / 3600
    report.add(f"{POSTERIOR} colonies of that area", hours, "h", 10, at_least=False, note=note)


def run(report: Report, quick: bool, against: Path | None) -> None:
    """Grow, and time steps on the way."""
    growth, area = Growth(), np.nan
    for nodes in NODES[:2] if quick else NODES:
        report.stage(f"{nodes} nodes")
        area = float(growth.until(nodes=nodes).statistics["area"][0])
        growth.timed(area)
    if not quick:
        report.stage(f"{AREA:g} L0²")
        grown = growth.until(area=AREA)
        area = float(grown.statistics["area"][0])
        growth.timed(area)
        report.add("births cut", float(grown.capacity_reached.any()), "", 0, at_least=False)
    costs = growth.costs
    report.table("a step as the colony grows", costs)
    note = f"{costs[-1]['nodes']} nodes, t = {costs[-1]['time']:.4g}, {growth.processor:.0f} processor seconds"
    report.add(f"until {area:.0f} L0²", growth.seconds, "s", None if quick else 90, at_least=False, note=note)
    ratio = plain_seconds(costs, growth.seconds) / growth.seconds
    report.add("plain contact, the whole colony", ratio, "×", note="times as long")
    for name in ("compiled", "plain"):
        x, y = np.log([(row["nodes"], row[f"ms {name}"]) for row in costs]).T
        target = 1.0 if name == "compiled" else None
        report.add(f"exponent in nodes, {name}", float(np.polyfit(x, y, 1)[0]), "", target, at_least=False)
    if not quick:
        report.stage(f"the colony of hungry cells, {AREA:g} L0²")
        hungry = Growth(HUNGRY)
        cut = hungry.until(area=AREA).capacity_reached.any()
        assert hungry.colony is not None
        at = float(hungry.colony.step) * NUMERICS.dt
        cells = f"{float(np.sum(hungry.colony.weights)):.0f} cells on {int(hungry.colony.count)} nodes"
        note = f"{cells}, t = {at:.4g}" + (", births cut" if cut else "")
        report.add("hungry cells, until the area", hungry.seconds, "s", 40, at_least=False, note=note)
        posterior(report)
    report.add("peak memory of the process", peak_memory() / 1e9, "GB", 24, at_least=False)
    if against is not None:
        compare(report, against, round(costs[-1]["time"], 1), quick)


def main(arguments: list[str] | None = None) -> None:
    """Run the command: parse the options of this benchmark, then those of every benchmark."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--against", type=Path)
    own, others = parser.parse_known_args(arguments)
    if own.against is not None and not (own.against / "yeastfit").is_dir():
        parser.error(f"--against: {own.against} is no checkout, it has no folder yeastfit")
    command("large", lambda report, quick: run(report, quick, own.against), others)


if __name__ == "__main__":
    main()
