"""Which worker simulates which block, and what is done when workers are lost, late, unlike or come back.

Blocks are numbered as they were proposed. A worker is asked for the lowest number that nobody has, and for one more
ahead of that while many are left, so that it need not wait for messages. Results are handed on in the order of their
numbers, whatever order they come in; no more than `AHEAD` blocks a worker are held back at a time.

Before its first block a worker is **admitted**: it makes the simulator and repeats blocks that the asking process has
simulated itself. One that computes other bits, or has other libraries, is refused. On each machine one worker begins,
so that programs are compiled once there.

A block whose worker is gone, answers with an error, or takes `Patience.slack` times as long as the longest so far, is
given to another one. When that has happened `Patience.tries` times to one block, or nobody is there for
`Patience.alone` seconds, the wave ends with an error.
"""

import heapq
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from yeastfit.errors import SimulationError
from yeastfit.inference.workers.arithmetic import Arithmetic, first_difference
from yeastfit.inference.workers.crew import Answer, Crew, SchedulerLost
from yeastfit.inference.workers.worker import Block, NotMade, admit, simulate

AHEAD = 4  # blocks a worker that may wait for an earlier one
WAIT = 0.5  # seconds between two looks at who is there, while nothing comes
NAMED = 3  # workers that a sentence names
RESUME = "what has been simulated so far is kept where there is a store: repeat the run to go on"


@dataclass(frozen=True)
class Patience:
    """When something counts as lost.

    Attributes:
        tries: Failures of one block.
        alone: Seconds without any worker, or without the scheduler.
        least: Seconds that a block may take at least.
        slack: Times the longest block so far that one may take.
        admission: Seconds for making the simulator and the first blocks, compiling included.
        retry: Seconds between two attempts to reach a scheduler.
    """

    tries: int = 3
    alone: float = 600.0
    least: float = 60.0
    slack: float = 20.0
    admission: float = 900.0
    retry: float = 2.0


@dataclass(frozen=True)
class Reference:
    """What workers are compared with: blocks, their rows and the arithmetic of the process that asks.

    Attributes:
        blocks: Values and seeds.
        rows: Of each block.
        arithmetic: That they were computed with.
        seconds: Of the last.
    """

    blocks: list[Block]
    rows: list[np.ndarray]
    arithmetic: Arithmetic
    seconds: float


@dataclass
class Member:
    """A worker.

    Attributes:
        host: Its machine.
        name: For people; its address until it has said more.
        state: "asked", "admitted", "refused" or "silent".
        tickets: Of what it was asked for, in order.
        since: When it began with the first of these.
        seconds: Of the block that was timed.
        failures: Of being admitted.
    """

    host: str
    name: str
    state: str = "asked"
    tickets: deque[int] = field(default_factory=deque)
    since: float = field(default_factory=time.monotonic)
    seconds: float = 0.0
    failures: int = 0


@dataclass
class Dispatch:
    """The blocks of one simulator; admitted workers stay so from wave to wave.

    Attributes:
        crew: The workers.
        text: Of the simulator's specification.
        digest: Of that text.
        size: Rows of a block.
        reference: What workers are compared with.
        mixed: Whether workers of other arithmetic are accepted.
        say: Is told what a user should know, a sentence at a time.
        begin: Is told, once, the seconds of a block on each of the first workers.
        patience: When something counts as lost.
        unlike: Workers of other arithmetic that were accepted, in words.
    """

    crew: Crew
    text: str
    digest: str
    size: int
    reference: Reference
    mixed: bool
    say: Callable[[str], None]
    begin: Callable[[list[float]], None]
    patience: Patience = field(default_factory=Patience)
    unlike: list[str] = field(default_factory=list)
    members: dict[str, Member] = field(default_factory=dict)
    _begun: bool = False
    _longest: float = 0.0

    @property
    def status(self) -> str:
        """As in "8 workers, 16 blocks in flight"."""
        admitted = [one for one in self.members.values() if one.state == "admitted"]
        flying = sum(len(one.tickets) for one in admitted)
        workers, blocks = (
            f"{n} {what}{'' if n == 1 else 's'}" for n, what in ((len(admitted), "worker"), (flying, "block"))
        )
        return f"{workers}, {blocks} in flight"

    def results(self, blocks: Sequence[Block]) -> Iterator[dict[str, Any]]:
        """What `worker.simulate` returns for each block, in their order.

        Raises:
            SimulationError: A block failed too often, or there is nobody to ask.
        """
        self._blocks, self._waiting, self._accepted = blocks, list(range(len(blocks))), 0
        self._numbers, self._done = dict[int, int](), dict[int, dict[str, Any]]()
        self._failures, self._alone = Counter[int](), time.monotonic()
        try:
            while self._accepted < len(blocks):
                try:
                    self._muster()
                    self._give()
                    for answer in self.crew.wait(WAIT):
                        self._take(answer)
                except SchedulerLost as lost:
                    self._regain(lost)
                while self._accepted in self._done:
                    yield self._done.pop(self._accepted)
                    self._accepted += 1
        finally:
            self._leave()

    def _muster(self) -> None:
        """Notice who has come, who is gone and who is late."""
        there, now = self.crew.workers(), time.monotonic()
        self._lose([address for address in self.members if address not in there])
        for address, host in there.items():
            if address not in self.members and self._may_begin(host):
                self._ask(address, host)
        limit = max(self.patience.least, self.patience.slack * self._longest)
        for member in self.members.values():
            if member.tickets and now - member.since > (self.patience.admission if member.state == "asked" else limit):
                self._overdue(member, now - member.since)
        if any(one.state in ("asked", "admitted") for one in self.members.values()):
            self._alone = now
        elif now - self._alone > self.patience.alone or (self.members and set(there) <= set(self.members)):
            self._give_up(now - self._alone)

    def _may_begin(self, host: str) -> bool:
        """On each machine one worker begins alone."""
        states = [one.state for one in self.members.values() if one.host == host]
        return "admitted" in states or "asked" not in states

    def _ask(self, address: str, host: str) -> None:
        mine = self.reference.arithmetic
        self.members.setdefault(address, Member(host, address))
        about = self.text, self.size, mine.threads, mine.double, self.reference.blocks
        self.members[address].tickets.append(self.crew.send(address, admit, *about))

    def _give(self) -> None:
        """Ask admitted workers for blocks, once it is known what is to be gained."""
        admitted = {address: one for address, one in self.members.items() if one.state == "admitted"}
        if not self._begun:
            if not admitted or any(one.state == "asked" for one in self.members.values()):
                return
            self._begun = True
            self.begin([one.seconds for one in admitted.values()])
        depth = 2 if len(self._waiting) > 2 * len(admitted) else 1
        for queue in range(depth):
            for address, member in admitted.items():
                end = self._accepted + AHEAD * len(admitted)
                if len(member.tickets) <= queue and self._waiting and self._waiting[0] < end:
                    number = heapq.heappop(self._waiting)
                    ticket = self.crew.send(address, simulate, self.digest, *self._blocks[number])
                    if not member.tickets:
                        member.since = time.monotonic()
                    member.tickets.append(ticket)
                    self._numbers[ticket] = number

    def _take(self, answer: Answer) -> None:
        """One answer, unless nobody waits for it."""
        found = next(((a, one) for a, one in self.members.items() if answer.ticket in one.tickets), None)
        if found is None:
            return
        address, member = found
        member.tickets.remove(answer.ticket)
        member.since = time.monotonic()
        number = self._numbers.pop(answer.ticket, None)
        if number is None:
            self._judge(address, member, answer)
        elif answer.error is None:
            self._done[number] = answer.value
            self._longest = max(self._longest, answer.value["seconds"])
        else:
            heapq.heappush(self._waiting, number)
            if isinstance(answer.error, NotMade):
                self._forget(address)  # a process that took the place of another: it is admitted first
            else:
                self._failed(number, f"on worker {member.name}: {_in_words(answer.error)}")

    def _judge(self, address: str, member: Member, answer: Answer) -> None:
        """Admit a worker, or not."""
        if answer.error is not None:
            member.failures += 1
            if member.failures < self.patience.tries:
                self._ask(address, member.host)
                return
            member.state = "refused"
            self.say(f"worker {member.name} is refused, it cannot simulate: {_in_words(answer.error)}")
            return
        value, mine = answer.value, self.reference
        other = Arithmetic(**value["arithmetic"])
        member.name, member.seconds = value["name"], value["seconds"]
        unfit = [f"jax has {other.devices} devices there, not one a process"] if other.devices > 1 else []
        if value["tasks"] > 1:
            unfit.append(f"it does {value['tasks']} tasks at once: start it with --nthreads 1")
        reasons = mine.arithmetic.differences(other)
        bits = next(filter(None, map(first_difference, mine.rows, value["rows"])), "")
        if bits and not reasons:
            reasons = [
                f"its processor, {other.processor}, computes other bits than {mine.arithmetic.processor}: {bits}"
            ]
        if unfit or (reasons and not self.mixed):
            member.state = "refused"
            self.say(f"worker {member.name} is refused: {'; '.join(unfit + reasons)}")
            return
        member.state = "admitted"
        self._longest = max(self._longest, member.seconds)
        if reasons:
            self.unlike.append(f"{member.name}: {'; '.join(reasons)}")
            self.say(f"worker {member.name} computes otherwise: {'; '.join(reasons)}")

    def _lose(self, addresses: Sequence[str]) -> None:
        """Give others what workers had that are gone. The block at hand of each counts as failed, it may be why."""
        gone = [self.members.pop(address) for address in addresses]
        blocks = [ticket for one in gone for ticket in one.tickets if ticket in self._numbers]
        if gone:
            names = ", ".join(one.name for one in gone[:NAMED]) + (" and others" if len(gone) > NAMED else "")
            self.say(f"{len(gone)} of the workers gone: {names}; their blocks, {len(blocks)}, are given to others")
        for member in gone:
            first = next(iter(member.tickets), None)
            numbers = self._taken_back(member)
            if first is not None and numbers:
                self._failed(numbers[0], f"its worker {member.name} went away", said=True)

    def _overdue(self, member: Member, seconds: float) -> None:
        """Ask a worker no more that does not answer."""
        self.say(f"worker {member.name} has not answered for {seconds:.0f} s: it is asked no more")
        member.state = "silent"
        for number in self._taken_back(member)[:1]:
            self._failed(number, f"worker {member.name} did not answer for {seconds:.0f} s", said=True)

    def _taken_back(self, member: Member) -> list[int]:
        """Numbers of the blocks that a worker had, which are waiting again."""
        numbers = [self._numbers.pop(ticket) for ticket in member.tickets if ticket in self._numbers]
        for ticket in member.tickets:
            self.crew.drop(ticket)
        member.tickets.clear()
        for number in numbers:
            heapq.heappush(self._waiting, number)
        return numbers

    def _forget(self, address: str) -> None:
        self._taken_back(self.members.pop(address))

    def _failed(self, number: int, how: str, said: bool = False) -> None:
        """Count a failure of a block."""
        self._failures[number] += 1
        if self._failures[number] >= self.patience.tries:
            values, seeds = self._blocks[number]
            raise SimulationError(
                f"{self._failures[number]} times {len(seeds)} simulations came to nothing, the last time {how}; the "
                f"first has parameters {values[0].tolist()} and seed {int(seeds[0])}: {RESUME}"
            )
        if not said:
            self.say(f"{len(self._blocks[number][1])} simulations failed {how}: they are given to another worker")

    def _regain(self, lost: SchedulerLost) -> None:
        """Wait for the scheduler, and begin anew with all that is not there."""
        self.say(f"the scheduler at {self.crew.where} is gone ({lost}): trying to reach it")
        for address in list(self.members):
            self._forget(address)
        began = time.monotonic()
        while not self.crew.reconnect():
            if time.monotonic() - began > self.patience.alone:
                raise SimulationError(
                    f"the scheduler at {self.crew.where} has been gone for {self.patience.alone:.0f} s: {RESUME}"
                )
            time.sleep(self.patience.retry)
        self.say(f"the scheduler at {self.crew.where} is there again")
        self._alone = time.monotonic()

    def _give_up(self, seconds: float) -> None:
        if self.members:
            raise SimulationError(
                f"all {len(self.members)} workers at {self.crew.where} were refused or do not answer: start this "
                f"command on a machine like theirs, with the same libraries, or give --mixed-arithmetic. {RESUME}"
            )
        raise SimulationError(f"there has been no worker at {self.crew.where} for {seconds:.0f} s: {RESUME}")

    def _leave(self) -> None:
        """Nothing is asked for any more. Who was being admitted begins anew in the next wave, as do silent workers."""
        for address, member in list(self.members.items()):
            if member.tickets or member.state == "silent":
                self._taken_back(member)
                if member.state != "admitted":
                    del self.members[address]


def _in_words(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
