"""Colonies of real size: what a step costs as they grow, with compiled contact and with the plain one.

One colony grows as `yeastfit simulate --relaxed --capacity 200000 --domain 300 --spacing 0.4 --dt 0.025 --mobility 1.3
--metabolic-rate 0.9 --aspect-ratio 0.65` grows it, seed 0, to given numbers of nodes and then until an area of 24 500
L0², that of a photographed colony. At each size, 20 further steps are timed with compiled contact and by the plain
switch (`Numerics.compiled`), after both programs have been compiled. Targets:

- until the area, births not cut: at most 90 s, compiling included, and at least 8 times as fast as plain;
- cost of a step against nodes: exponent at most 1.0;
- memory of the process at most 24 GB.

The plain colony is not grown as a whole: its time is that of the compiled one's steps at the plain cost, which is
interpolated between the sizes. With --quick the colony ends at 4000 nodes, which is mostly compiling.
The machine should be otherwise idle.

    python -m benchmarks.large [--quick] [--json FILE]
"""

import time
from dataclasses import dataclass, field, replace
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
NODES = (1000, 4000, 16_000, 64_000)
AREA = 24_500.0  # L0², of the smallest set of photographed colonies
STEPS, LATEST = 20, 200.0  # further steps that are timed; a time that no colony comes to


@dataclass
class Growth:
    """One colony as it grows, and what that has taken."""

    colony: Colony | None = None
    seconds: float = 0.0
    processor: float = 0.0
    costs: list[dict[str, float]] = field(default_factory=list)

    def until(self, **size: float) -> Simulation:
        """Grow further."""
        begin: dict[str, Any] = {"keys": member_keys(0, 1)[0]} if self.colony is None else {"start": self.colony}
        wall, busy = time.perf_counter(), time.process_time()
        grown = simulate(LARGE, **begin, times=[LATEST], until=size, numerics=NUMERICS)
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


def run(report: Report, quick: bool) -> None:
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
    report.add("plain contact, the whole colony", ratio, "×", None if quick else 8, note="times as long")
    for name in ("compiled", "plain"):
        x, y = np.log([(row["nodes"], row[f"ms {name}"]) for row in costs]).T
        target = 1.0 if name == "compiled" else None
        report.add(f"exponent in nodes, {name}", float(np.polyfit(x, y, 1)[0]), "", target, at_least=False)
    report.add("peak memory of the process", peak_memory() / 1e9, "GB", 24, at_least=False)


if __name__ == "__main__":
    command("large", run)
