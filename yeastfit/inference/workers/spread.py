"""A simulator whose rows are simulated by workers, in blocks, and the workers themselves.

A wave, the rows that somebody proposes together, is cut into blocks of `block` rows in the order proposed; neither
rows nor size of a block depend on how many workers there are. Blocks come back in any order and are accepted in the
order proposed. So a wave has the same bits with one worker and with 200, and a store of simulations the same bytes.

The process that asks simulates the first two blocks itself: workers have to repeat them bit by bit (`dispatch`), and
what a block takes here and there tells what is to be gained.
"""

import logging
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any

import numpy as np

from yeastfit.errors import InputError
from yeastfit.inference.simulator import Rows, Seeds, Simulator, Values, Wrapper, problems_of
from yeastfit.inference.workers.admission import Patience, Reference
from yeastfit.inference.workers.arithmetic import Arithmetic, xla_threads
from yeastfit.inference.workers.crew import Crew
from yeastfit.inference.workers.dask_crew import imported, local_crew, remote_crew
from yeastfit.inference.workers.dispatch import Dispatch
from yeastfit.inference.workers.worker import Block, in_full
from yeastfit.memory import check_count
from yeastfit.numbers import AT_LEAST_ONE
from yeastfit.specification import Specification
from yeastfit.text import quoted

BLOCK = 8  # rows: 1.6 s where a colony takes 0.2 s, some hundred times what sending them takes
PROCESS = 2e8  # bytes that a worker process takes at least
ADDRESS, LAST_PORT = re.compile(r"(tcp|tls)://[^\s/]+:(?P<port>[0-9]{1,5})"), 65535
ALONE = 120.0  # seconds without any worker on this machine, where they start within a minute
FIRST = 2  # blocks that the asking process simulates itself

Say = Callable[[str], None]


def _nobody(rows: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True, eq=False)
class Spread(Wrapper):
    """A simulator whose rows are simulated by workers. Made by `Workers.spread`.

    Attributes:
        simulator: The one around which it is. It tells by its `specification` how workers make it.
        crew: The workers.
        block: Rows that are simulated together.
        mixed: Whether workers of other arithmetic are accepted.
        say: Is told what a user should know.
        tell: Is told the rows of each block that has come.
        patience: When workers and blocks count as lost.
        counted: What simulations ran into, where the simulator does not count that itself.

    Raises:
        InputError: The simulator does not tell how it is made.
    """

    crew: Crew
    block: int = BLOCK
    mixed: bool = False
    say: Say = field(default=logging.getLogger("yeastfit").warning)
    tell: Callable[[int], None] = _nobody
    patience: Patience = field(default_factory=Patience)
    counted: Counter[str] = field(default_factory=Counter)
    _dispatch: list[Dispatch] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.block < 1:
            raise InputError(f"block is {self.block}, it must be at least 1")
        specification_of(self.simulator)

    @property
    def problems(self) -> Counter[str]:
        """What simulations ran into, here and on workers."""
        return problems_of(self.simulator) if hasattr(self.simulator, "problems") else self.counted

    @property
    def status(self) -> str:
        """How many workers there are, and what is in flight."""
        return self._dispatch[0].status if self._dispatch else "no worker yet"

    @property
    def unlike(self) -> list[str]:
        """Workers of other arithmetic that were accepted, in words."""
        return self._dispatch[0].unlike if self._dispatch else []

    def __call__(self, values: Values, seeds: Seeds) -> Rows:
        """Rows of the simulator inside."""
        nothing = np.empty((0, len(self.observables)))
        return np.concatenate([nothing, *self.blocks(values, seeds)])

    def blocks(self, values: Values, seeds: Seeds, size: int = 0) -> Iterator[Rows]:
        """Rows block by block, each as soon as it and all before it are there.

        Arguments:
            values: As in a call.
            seeds: Likewise.
            size: What the caller would take at a time; blocks have their own size.

        Yields:
            Rows of the next block.

        Raises:
            SimulationError: A block failed too often, or there is nobody to ask.
        """
        starts = range(0, len(seeds), self.block)
        cut = [(values[k : k + self.block], seeds[k : k + self.block]) for k in starts]
        if cut and not self._dispatch:
            reference = self._reference(cut[:FIRST])
            yield from reference.rows[: len(cut)]
            cut = cut[FIRST:]
        if not cut:
            return
        for found in self._dispatch[0].results(cut):
            self.problems.update(found["problems"])
            self.tell(len(found["rows"]))
            yield found["rows"]

    def _reference(self, blocks: list[Block]) -> Reference:
        """Simulate the first blocks here; the last of them, or the only one once more, is timed."""
        own = getattr(self.simulator, "in_blocks_of", None)
        simulator = self.simulator if own is None else own(self.block)
        rows = [in_full(simulator, self.block, *block) for block in blocks[:1]]
        began = time.perf_counter()
        rows += [in_full(simulator, self.block, *block) for block in blocks[1:]]
        if len(blocks) < FIRST:
            met = self.problems.copy()
            in_full(simulator, self.block, *blocks[0])
            self.problems.clear()
            self.problems.update(met)
        seconds = time.perf_counter() - began
        reference = Reference(blocks, rows, Arithmetic.of_this_process(), seconds)
        specification = specification_of(self.simulator)
        about = specification.text, specification.digest, self.block, reference, self.mixed
        self._dispatch.append(Dispatch(self.crew, *about, self.say, self._begin, self.patience))
        return reference

    def _begin(self, seconds: list[float]) -> None:
        """Say what is to be gained."""
        here, there = self._dispatch[0].reference.seconds, float(np.median(seconds))
        gain = sum(here / max(one, 1e-9) for one in seconds)
        together = f" where {len(seconds)} blocks are asked for at once" if len(seconds) > 1 else ""
        self.say(
            f"{len(seconds)} worker{'' if len(seconds) == 1 else 's'}, blocks of {self.block}: one takes {there:.3g} s "
            f"on a worker and {here:.3g} s without workers, {gain:.1f} times as fast is expected{together}"
        )


@dataclass
class Workers:
    """Workers on this machine, or those of a scheduler of Dask. A context manager; needs the extra `cluster`.

        with yeastfit.Workers(8) as workers:
            posterior = yeastfit.infer(workers.spread(simulator), prior, targets, store="simulations.h5")

    Attributes:
        processes: How many to start on this machine.
        scheduler: Or: `tcp://host:port` of a scheduler whose workers are used.
        mixed_arithmetic: Whether workers are accepted that compute other bits than this process.
        block: Rows that are simulated together. No result depends on it.
        say: Is told, a sentence at a time, what was lost and what is expected; by default the log "yeastfit".
        tell: Is told the rows of each block that has come.
        patience: When workers and blocks count as lost.

    Raises:
        InputError: Neither or both of `processes` and `scheduler` are given, or a number is not admissible. On
            entering: Dask is not installed, or no scheduler answers.
    """

    processes: int | None = None
    scheduler: str | None = None
    mixed_arithmetic: bool = False
    block: int = BLOCK
    say: Say = field(default=logging.getLogger("yeastfit").warning)
    tell: Callable[[int], None] = _nobody
    patience: Patience = field(default_factory=Patience)
    spreads: list[Spread] = field(default_factory=list)
    _crew: Crew | None = None

    def __post_init__(self) -> None:
        if (self.processes is None) == (self.scheduler is None):
            raise InputError("processes and scheduler: need one of the two")
        if self.scheduler is not None:
            found = ADDRESS.fullmatch(self.scheduler)
            if not found or not 0 < int(found["port"]) <= LAST_PORT:
                raise InputError(f"scheduler is {quoted(self.scheduler)}, it must be like tcp://host:8786")
        for name, value in (("processes", self.processes), ("block", self.block)):
            if value is not None:
                check_count(name, AT_LEAST_ONE.read_whole(value, name))
        if self.processes is not None:
            check_count("processes", self.processes, PROCESS)

    def check(self) -> None:
        """Raise `InputError` where Dask is not installed, or no scheduler answers."""
        if self.scheduler is None:
            imported()
        else:
            with self:
                pass

    def __enter__(self) -> "Workers":
        if self.scheduler is None:
            self._crew = local_crew(self.processes or 1, xla_threads())
        else:
            self._crew = remote_crew(self.scheduler)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._crew is not None:
            self._crew.close()
        self._crew = None

    def spread(self, simulator: Simulator) -> Spread:
        """A simulator whose rows these workers simulate.

        Raises:
            InputError: It does not tell how it is made (`specification`), or the workers are closed.
        """
        if self._crew is None:
            raise InputError("workers are not open: use them as a context manager, `with Workers(8) as workers:`")
        alone = self.patience.alone if self.processes is None else min(ALONE, self.patience.alone)
        how: dict[str, Any] = {"say": self.say, "tell": self._tell, "patience": replace(self.patience, alone=alone)}
        self.spreads.append(Spread(simulator, self._crew, self.block, self.mixed_arithmetic, **how))
        return self.spreads[-1]

    def asdict(self) -> dict[str, Any]:
        """For a manifest: what was asked for, and which workers of other arithmetic were accepted."""
        asked = {"processes": self.processes, "scheduler": self.scheduler, "block": self.block}
        return {**asked, "mixed_arithmetic": self.unlike}

    @property
    def status(self) -> str:
        """How many workers there are, and what is in flight."""
        return next((one.status for one in reversed(self.spreads) if one._dispatch), "no worker yet")

    @property
    def unlike(self) -> list[str]:
        """Workers of other arithmetic that were accepted, in words, each once."""
        return list(dict.fromkeys(line for one in self.spreads for line in one.unlike))

    def _tell(self, rows: int) -> None:
        self.tell(rows)


def specification_of(simulator: Simulator) -> Specification:
    """How workers make a simulator.

    Raises:
        InputError: It does not say so.
    """
    found = getattr(simulator, "specification", None)
    if not isinstance(found, Specification):
        raise InputError(
            f"simulator: {type(simulator).__name__} has no `specification`, by which workers make one like it: give it "
            "a property that returns a yeastfit.Specification of its function's path and arguments"
        )
    return found
