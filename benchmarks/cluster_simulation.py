"""A run on many workers by discrete events: the distribution of blocks as it is, workers and clock made up.

`SimulatedCrew` answers when a worker would have. The asking process is a single server: every block costs it
`parent` seconds, for sending, receiving and storing, and the clock does not go on without it.
"""

import heapq
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.inference.workers.admission import Patience, Reference
from yeastfit.inference.workers.arithmetic import Arithmetic
from yeastfit.inference.workers.crew import Answer
from yeastfit.inference.workers.dispatch import Dispatch
from yeastfit.inference.workers.worker import admit

SAME = Arithmetic("cpu", "cpu", 1, "made up", 1, False, {})
NOTHING = (np.zeros((1, 1)), np.zeros(1, dtype=np.uint64))


@dataclass
class SimulatedCrew:
    """Workers that take as long for a block as they are told.

    Attributes:
        count: How many.
        seconds: Of each block, by the number that stands in its seeds.
        parent: Seconds that the asking process spends on a block.
        latency: Of a message, one way, seconds.
        now: The time.
        busy: Seconds that workers have worked.
        where: In words.
    """

    count: int
    seconds: Float[np.ndarray, " block"]
    parent: float
    latency: float
    now: float = 0.0
    busy: float = 0.0
    where: str = "a made-up cluster"
    _free: dict[str, float] = field(default_factory=dict)
    _coming: list[tuple[float, int, Any]] = field(default_factory=list)
    _tickets: int = 0

    def __post_init__(self) -> None:
        self._free = {f"worker{number}:1": 0.0 for number in range(self.count)}

    def workers(self) -> Mapping[str, str]:
        """All, each on a machine of its own."""
        return {address: address for address in self._free}

    def send(self, worker: str, function: Callable[..., Any], *arguments: Any) -> int:
        """A block, which begins when it has come and the worker is free."""
        self._tickets += 1
        if function is admit:
            value = {"arithmetic": SAME.asdict(), "name": worker, "tasks": 1, "rows": [NOTHING[0]], "seconds": 1.0}
            heapq.heappush(self._coming, (self.now, self._tickets, value))
            return self._tickets
        taken = float(self.seconds[int(arguments[2][0])])
        end = max(self._free[worker], self.now + self.latency) + taken
        self._free[worker], self.busy = end, self.busy + taken
        value = {"rows": NOTHING[0], "problems": {}, "seconds": taken}
        heapq.heappush(self._coming, (end + self.latency, self._tickets, value))
        return self._tickets

    def wait(self, seconds: float) -> list[Answer]:
        """What has come by now; the clock goes on to the next answer where that is nothing."""
        if not self._coming:
            return []
        self.now = max(self.now, self._coming[0][0])
        found = []
        while self._coming and self._coming[0][0] <= self.now:
            _, ticket, value = heapq.heappop(self._coming)
            found.append(Answer(ticket, value))
            if "problems" in value:
                self.now += self.parent
        return found

    def drop(self, ticket: int) -> None:
        """Nothing is ever dropped."""

    def reconnect(self) -> bool:
        """The scheduler never goes away."""
        return True

    def close(self) -> None:
        """Nothing is open."""


def simulated(
    colonies: int, workers: int, block: int, wave: int, colony: float, scatter: float, parent: float, latency: float
) -> dict[str, float]:
    """A run on a cluster.

    Arguments:
        colonies: In all.
        workers: How many.
        block: Colonies of a block.
        wave: Colonies that are proposed together.
        colony: Mean seconds of one.
        scatter: Their standard deviation over the mean; they are log-normal.
        parent: See `SimulatedCrew`.
        latency: Likewise.

    Returns:
        `efficiency`, the workers' time spent on colonies; `hours`; `parent_busy`, the share of the time in which the
        asking process works; and `dispatch`, the seconds a block that the distribution took on this machine.
    """
    rng, width = np.random.default_rng(1), np.sqrt(np.log1p(scatter**2))
    blocks = -(-colonies // block)
    each = colony * np.exp(width * rng.standard_normal((blocks, block)) - 0.5 * width**2)
    crew = SimulatedCrew(workers, each.sum(axis=1), parent, latency)
    reference = Reference([NOTHING], [NOTHING[0]], SAME, 1.0)
    patience = Patience(look=np.inf)
    dispatch = Dispatch(crew, "", "", block, reference, False, lambda line: None, lambda seconds: None, patience)
    began, together = time.perf_counter(), max(1, wave // block)
    for first in range(0, blocks, together):
        numbers = range(first, min(first + together, blocks))
        for _ in dispatch.results([(NOTHING[0], np.array([number])) for number in numbers]):
            pass
    return {
        "efficiency": crew.busy / (workers * crew.now),
        "hours": crew.now / 3600,
        "parent_busy": min(blocks * parent / crew.now, 1.0),
        "dispatch": (time.perf_counter() - began) / blocks,
    }
