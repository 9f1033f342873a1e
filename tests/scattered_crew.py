"""A `Crew` without processes, whose workers answer in random order, fail, die, hang and come back as chance has it."""

from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from yeastfit.inference.workers.arithmetic import Arithmetic
from yeastfit.inference.workers.crew import Answer, SchedulerLost
from yeastfit.inference.workers.worker import NotMade, admit
from yeastfit.specification import Specification

MINE = Arithmetic("cpu", "cpu", 1, "a processor", 1, False, {"jaxlib": "1.0"})


@dataclass
class Scattered:
    """Probabilities are of each answer: `failing` raises, `dying` takes its worker along, `losing` the scheduler.

    hanging: workers that are admitted and answer no more. others: arithmetic of workers that is not the usual one, by
    address. away: calls of `reconnect` that fail. tasks: of each at once.
    """

    count: int
    seed: int = 0
    failing: float = 0.0
    dying: float = 0.0
    losing: float = 0.0
    hanging: Collection[str] = ()
    others: Mapping[str, Arithmetic] = field(default_factory=dict)
    shift: Mapping[str, float] = field(default_factory=dict)
    away: int = 0
    tasks: int = 1
    where: str = "nowhere"
    requests: list[tuple[int, ...]] = field(default_factory=list)
    order: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng, self.tickets, self.next = np.random.default_rng(self.seed), 0, 0
        self.queues, self.made = dict[str, deque](), dict[str, dict[tuple[str, int], Any]]()
        self.deaths = self.losses = 0

    def workers(self) -> Mapping[str, str]:
        while len(self.queues) < self.count:
            self.queues[f"w{self.next}:1"] = deque()
            self.next += 1
        return {one: f"host{int(one[1:-2]) % 2}" for one in self.queues}

    def send(self, worker: str, function: Callable[..., Any], *arguments: Any) -> int:
        if self.rng.random() < 0.1 * self.losing:
            self._lose()
        self.tickets += 1
        if worker in self.queues:  # else it died a moment ago, which nobody knows yet
            self.queues[worker].append((self.tickets, function, arguments))
        return self.tickets

    def wait(self, seconds: float) -> list[Answer]:
        if self.rng.random() < self.losing:
            self._lose()
        busy = [one for one, queue in self.queues.items() if queue and not (one in self.hanging and one in self.made)]
        if not busy:
            return []
        worker = busy[self.rng.integers(len(busy))]
        ticket, function, arguments = self.queues[worker].popleft()
        if self.rng.random() < self.dying:
            self.deaths += 1
            del self.queues[worker]
            return []
        if self.rng.random() < self.failing:
            return [Answer(ticket, error=MemoryError("of a worker"))]
        self.order.append(ticket)
        try:
            return [Answer(ticket, self._done(worker, function, arguments))]
        except Exception as error:
            return [Answer(ticket, error=error)]

    def drop(self, ticket: int) -> None:
        for worker, queue in self.queues.items():
            self.queues[worker] = deque(one for one in queue if one[0] != ticket)

    def reconnect(self) -> bool:
        self.away -= 1
        return self.away < 0

    def close(self) -> None:
        pass

    def _lose(self) -> None:
        self.losses += 1
        self.queues.clear()
        raise SchedulerLost("killed")

    def _done(self, worker: str, function: Callable[..., Any], arguments: tuple) -> Any:
        made = self.made.setdefault(worker, {})
        if function is admit:
            text, size, _, _, blocks = arguments
            specification = Specification.read(text)
            made[specification.digest, size] = simulator = specification.made()
            rows = [simulator(*block) + self.shift.get(worker, 0.0) for block in blocks]
            arithmetic = self.others.get(worker, MINE).asdict()
            return {"arithmetic": arithmetic, "name": worker, "tasks": self.tasks, "rows": rows, "seconds": 0.01}
        digest, size, values, seeds = arguments
        if (digest, size) not in made:
            raise NotMade(digest)
        simulator = made[digest, size]
        self.requests.append(tuple(map(int, seeds)))
        before = simulator.problems.copy()
        rows = simulator(values, seeds) + self.shift.get(worker, 0.0)
        return {"rows": rows, "problems": dict(simulator.problems - before), "seconds": 0.01}


def other_jaxlib(version: str = "0.0.1") -> Arithmetic:
    return replace(MINE, versions={"jaxlib": version})
