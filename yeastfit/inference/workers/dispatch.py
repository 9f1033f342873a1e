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
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from yeastfit.errors import SimulationError
from yeastfit.inference.workers.admission import Member, Patience, Reference, reasons_against
from yeastfit.inference.workers.crew import Answer, Crew, SchedulerLost
from yeastfit.inference.workers.worker import Block, NotMade, admit, simulate

AHEAD = 4  # blocks a worker that may wait for an earlier one
WAIT = 0.5  # seconds, while nothing comes
NAMED = 3  # workers that a sentence names
RESUME = "what has been simulated is kept where there is a store: repeat the run to go on, a command with --resume"


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
    _owners: dict[int, str] = field(default_factory=dict)
    _free: tuple[dict[str, None], dict[str, None]] = field(default_factory=lambda: ({}, {}))
    _admitted: dict[str, None] = field(default_factory=dict)
    _numbers: dict[int, int] = field(default_factory=dict)
    _begun: bool = False
    _looked: float = -math.inf
    _longest: float = 0.0

    @property
    def status(self) -> str:
        """As in "8 workers, 16 blocks in flight"."""
        counts = (len(self._admitted), "worker"), (len(self._numbers), "block")
        return ", ".join(f"{n} {what}{'' if n == 1 else 's'}" for n, what in counts) + " in flight"

    def results(self, blocks: Sequence[Block]) -> Iterator[dict[str, Any]]:
        """What `worker.simulate` returns for each block, in their order.

        Raises:
            SimulationError: A block failed too often, or there is nobody to ask.
        """
        self._blocks, self._waiting, self._accepted = blocks, list(range(len(blocks))), 0
        self._done = dict[int, dict[str, Any]]()
        self._failures = Counter[int]()
        self._started = self._alone = time.monotonic()  # of waiting for the first workers; when one was there last
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
        now = time.monotonic()
        if now - self._looked < self.patience.look and self._begun:
            return
        there, self._looked = self.crew.workers(), now
        self._lose([address for address in self.members if address not in there])
        for address, host in there.items():
            if address not in self.members and self._may_begin(host):
                self._ask(address, host)
        limit = max(self.patience.least, self.patience.slack * self._longest)
        for address, member in self.members.items():
            if member.tickets and now - member.since > (self.patience.admission if member.state == "asked" else limit):
                self._overdue(address, member, now - member.since)
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
        self._send(address, admit, *about)

    def _give(self) -> None:
        """Ask admitted workers for blocks, once it is known what is to be gained."""
        workers = len(self._admitted)
        if not self._begun:
            waiting = any(one.state == "asked" for one in self.members.values())
            if not workers or (waiting and time.monotonic() - self._started < self.patience.start):
                return
            self._begun = True
            self.begin([self.members[address].seconds for address in self._admitted])
        while self._waiting and self._waiting[0] < self._accepted + AHEAD * workers:
            idle, busy = self._free
            if not idle and (not busy or len(self._waiting) <= 2 * workers):
                break
            number = self._waiting[0]
            ticket = self._send(next(iter(idle or busy)), simulate, self.digest, self.size, *self._blocks[number])
            self._numbers[ticket] = heapq.heappop(self._waiting)

    def _send(self, address: str, function: Callable[..., Any], *arguments: Any) -> int:
        """Ask a worker; the ticket."""
        member = self.members[address]
        if not member.tickets:
            member.since = time.monotonic()
        ticket = self.crew.send(address, function, *arguments)
        member.tickets.append(ticket)
        self._owners[ticket] = address
        self._note(address)
        return ticket

    def _note(self, address: str) -> None:
        """Keep in mind which workers have nothing to do, and which have one block only."""
        for each in self._free:
            each.pop(address, None)
        member = self.members.get(address)
        if member is None or member.state != "admitted":
            self._admitted.pop(address, None)
            return
        self._admitted[address] = None
        if len(member.tickets) < len(self._free):
            self._free[len(member.tickets)][address] = None

    def _take(self, answer: Answer) -> None:
        """One answer, unless nobody waits for it."""
        address = self._owners.pop(answer.ticket, None)
        if address is None:
            return
        member = self.members[address]
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
        self._note(address)

    def _judge(self, address: str, member: Member, answer: Answer) -> None:
        """Admit a worker, or not."""
        if answer.error is not None:
            member.failures += 1
            if member.failures < self.patience.tries:
                self._ask(address, member.host)
                return
            self._refuse(member, [f"it cannot simulate: {_in_words(answer.error)}"])
            return
        member.name, member.seconds = answer.value["name"], answer.value["seconds"]
        unfit, reasons = reasons_against(answer.value, self.reference)
        if unfit or (reasons and not self.mixed):
            self._refuse(member, unfit + reasons, otherwise=not unfit)
            return
        member.state = "admitted"
        self._longest = max(self._longest, member.seconds)
        if reasons:
            self.unlike.append(f"{member.name}: {'; '.join(reasons)}")
            self.say(f"worker {member.name} computes otherwise: {'; '.join(reasons)}")

    def _refuse(self, member: Member, reasons: list[str], otherwise: bool = False) -> None:
        """Ask a worker nothing more. otherwise: for no other reason than that it computes other bits."""
        member.state, member.refusal, member.otherwise = "refused", "; ".join(reasons), otherwise
        self.say(f"worker {member.name} is refused: {member.refusal}")

    def _lose(self, addresses: Sequence[str]) -> None:
        """Give others what workers had that are gone. The block at hand of each counts as failed, it may be why."""
        if not addresses:
            return
        gone = [self.members.pop(address) for address in addresses]
        for address in addresses:
            self._note(address)
        blocks = [ticket for one in gone for ticket in one.tickets if ticket in self._numbers]
        names = ", ".join(one.name for one in gone[:NAMED]) + (" and others" if len(gone) > NAMED else "")
        self.say(f"{len(gone)} of the workers gone: {names}; their blocks, {len(blocks)}, are given to others")
        for member in gone:
            for number in self._taken_back(member)[:1]:
                self._failed(number, f"its worker {member.name} went away", said=True)

    def _overdue(self, address: str, member: Member, seconds: float) -> None:
        """Ask a worker no more that does not answer."""
        self.say(f"worker {member.name} has not answered for {seconds:.0f} s: it is asked no more")
        member.state = "silent"
        self._note(address)
        for number in self._taken_back(member)[:1]:
            self._failed(number, f"worker {member.name} did not answer for {seconds:.0f} s", said=True)

    def _taken_back(self, member: Member) -> list[int]:
        """Numbers of the blocks that a worker had, which are waiting again."""
        numbers = [self._numbers.pop(ticket) for ticket in member.tickets if ticket in self._numbers]
        for ticket in member.tickets:
            self._owners.pop(ticket, None)
            self.crew.drop(ticket)
        member.tickets.clear()
        for number in numbers:
            heapq.heappush(self._waiting, number)
        return numbers

    def _forget(self, address: str) -> None:
        self._taken_back(self.members.pop(address))
        self._note(address)

    def _failed(self, number: int, how: str, said: bool = False) -> None:
        """Count a failure of a block."""
        self._failures[number] += 1
        if self._failures[number] >= self.patience.tries:
            values, seeds = self._blocks[number]
            raise SimulationError(
                f"{self._failures[number]} times {len(seeds)} simulations failed, the last time {how}; the "
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
        self._started = self._alone = time.monotonic()

    def _give_up(self, seconds: float) -> None:
        if self.members:
            members = self.members.values()
            why = next((f", one as {one.refusal}" for one in members if one.refusal), "")
            way = ": start this command on a machine like theirs, with the same libraries, or give --mixed-arithmetic"
            raise SimulationError(
                f"all {len(members)} workers at {self.crew.where} were refused or do not answer{why}"
                f"{way if any(one.otherwise for one in members) else ''}. {RESUME}"
            )
        raise SimulationError(f"there has been no worker at {self.crew.where} for {seconds:.0f} s: {RESUME}")

    def _leave(self) -> None:
        """Nothing is asked for any more. Who was being admitted begins anew in the next wave, as do silent workers."""
        for address, member in list(self.members.items()):
            if member.tickets or member.state == "silent":
                self._taken_back(member)
                if member.state != "admitted":
                    del self.members[address]
                self._note(address)
        self._owners, self._numbers = {}, {}


def _in_words(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
