"""The source's problem as compiled programs, with their compile and run times."""

import resource
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import cKDTree

from yeastfit.measure.statistics.smooth_statistics import SmoothStatistics
from yeastfit.model.colony import Colony, start
from yeastfit.model.numerics import Numerics, map_members, on_one_device
from yeastfit.model.parameters import PARAMETERS, Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.simulate import Observe, Schedule, trajectory
from yeastfit.simulation.simulate import member_keys

LAMBDA = dict(zip(PARAMETERS.names, (0.1, 5.0, 5.0, 0.5, 1.0, 1.0, 0.7), strict=True))
SOURCE = Numerics()  # 401 × 401 points, 500 nodes
STATISTICS = SmoothStatistics(SOURCE.domain, SOURCE.spacing)
STEPS = 805  # 35 hours
PART = 100  # steps of a shorter measurement
MIDDLE = 410  # the step from which a colony has about as many nodes (250) as in the mean over the 805


@dataclass
class Program:
    """A compiled function and its arguments. Times in seconds: `tracing`, `compiling`, and `wall` once it is timed."""

    run: Any
    arguments: tuple[Any, ...]
    tracing: float
    compiling: float
    wall: float = field(default=np.nan)
    longest: ClassVar[float] = 0.0  # compile time of any program so far

    @staticmethod
    def of(function: Callable[..., Any], *arguments: Any) -> "Program":
        """Trace and compile without running."""
        began = time.perf_counter()
        lowered = jax.jit(function).lower(*arguments)
        traced = time.perf_counter()
        program = Program(lowered.compile(), arguments, traced - began, time.perf_counter() - traced)
        Program.longest = max(Program.longest, program.compile_time)
        return program

    @property
    def compile_time(self) -> float:
        """How much longer the first call takes than the second."""
        return self.tracing + self.compiling

    def timed(self, repeats: int = 3) -> tuple[Any, float]:
        """The result, and the number of busy cores; the median time is kept in `wall`."""
        walls, busy = [], time.process_time()
        for _ in range(repeats):
            began = time.perf_counter()
            result = jax.block_until_ready(self.run(*self.arguments))
            walls.append(time.perf_counter() - began)
        self.wall = statistics.median(walls)
        return on_one_device(result), (time.process_time() - busy) / sum(walls)

    @property
    def memory(self) -> float:
        """Bytes of arguments, results and temporaries by XLA's count; NaN if it has none."""
        size = self.run.memory_analysis()
        if size is None:
            return np.nan
        return float(size.argument_size_in_bytes + size.output_size_in_bytes + size.temp_size_in_bytes)


def whole_runs(members: int, every: int, steps: int = STEPS) -> Program:
    """An ensemble from its start, as `yeastfit.simulate` runs it; statistics every `every` steps."""

    def run(parameters: Parameters, keys: jax.Array, at: Schedule) -> Any:
        rules = Relaxation(), SOURCE, STATISTICS
        return map_members(lambda p, k: trajectory(p, start(k, SOURCE), at, *rules), parameters, keys)

    return Program.of(run, _shared(members), member_keys(0, members), samples(steps, every))


def further_steps(
    grown: Colony,
    members: int,
    every: int,
    steps: int,
    values: Mapping[str, Any] = LAMBDA,
    numerics: Numerics = SOURCE,
    observe: Observe = STATISTICS,
) -> Program:
    """Further steps of a grown colony, the same for every member; by default of the source's problem."""

    def run(parameters: Parameters, colonies: Colony, at: Schedule) -> Any:
        rules = Relaxation(), numerics, observe
        return map_members(lambda p, c: trajectory(p, c, at, *rules), parameters, colonies)

    colonies = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (members, *leaf.shape)), grown)
    return Program.of(run, _shared(members, values), colonies, samples(steps, every, int(grown.step)))


def samples(steps: int, every: int, since: int = 0) -> Schedule:
    """Every `every`-th step, and the last, after `since` steps already done."""
    return Schedule.of(since + np.unique(np.append(np.arange(every, steps + 1, every), steps)), since)


def numerics_for(nodes: int) -> Numerics:
    """A domain with as many nodes per area as the source's."""
    intervals = round(SOURCE.domain / SOURCE.spacing * (nodes / SOURCE.room) ** 0.5)
    return Numerics(domain=intervals * SOURCE.spacing, capacity=nodes)


def placed(nodes: int, density: float, spread: float, length: float, nutrient: np.ndarray) -> Colony:
    """A star of eight arms with `density` nodes per area inside and `spread` in the surrounding disc; scaled nutrient.

    Nodes lie on a jittered lattice, each joined to one closer to the centre and about `length` away.
    """
    rng, spacing, arms = np.random.default_rng(0), density**-0.5, 8
    line = spacing * np.arange(-2 * int(nodes**0.5), 2 * int(nodes**0.5) + 1)
    sites = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    sites += rng.uniform(-0.3, 0.3, sites.shape) * spacing
    share = spread / density
    hub = np.hypot(*sites.T) < arms * spacing / (np.pi * share)  # where arms are less than two sites wide
    sites = sites[hub | (np.arctan2(*sites.T) * arms / (2 * np.pi) % 1.0 < share)]
    positions = sites[np.argsort(np.hypot(*sites.T))[:nodes]]
    apart, other = cKDTree(positions).query(positions, k=24)
    misfit = np.where(other < np.arange(nodes)[:, None], np.abs(apart - length), np.inf)
    parents = other[np.arange(nodes), np.argmin(misfit, axis=1)]
    parents[0] = -1
    numerics = numerics_for(nodes)
    empty = start(jax.random.key(0), numerics)
    return Colony(
        positions=jnp.asarray(positions, empty.positions.dtype),
        parents=jnp.asarray(parents, empty.parents.dtype),
        weights=jnp.ones_like(empty.weights),
        lineages=jnp.asarray(rng.integers(0, 2**32, (nodes, 2), dtype=np.uint32)),
        count=jnp.asarray(nodes, empty.count.dtype),
        nutrient=jax.image.resize(jnp.asarray(nutrient), empty.nutrient.shape, "linear"),
        step=jnp.asarray(numerics.steps_per_event - 20, empty.step.dtype),
        problems=empty.problems,
    )


def peak_memory() -> float:
    """Peak memory of this process in bytes. On Linux not `ru_maxrss`, which starts from that of the parent process."""
    status = Path("/proc/self/status")
    if status.is_file():
        return next(1024.0 * int(line.split()[1]) for line in status.open() if line.startswith("VmHWM"))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1.0 if sys.platform == "darwin" else 1024.0)


def _shared(members: int, values: Mapping[str, Any] = LAMBDA) -> Parameters:
    return jax.tree.map(lambda value: jnp.full(members, value), Parameters(**values))
