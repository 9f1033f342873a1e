"""Workers of Dask: processes that are started on this machine, or those of a scheduler anywhere.

Each request is for one worker by address, so that Dask decides nothing: which block goes where, what is done about
lost workers and which worker is trusted is decided in `dispatch`. Dask carries messages, watches connections, starts
processes (spawned, never forked) and starts them again where they die.
"""

import itertools
import logging
import queue
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, partial
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.workers.crew import Answer, SchedulerLost
from yeastfit.worker_processes import interrupts_held_back

POLL = 1.0  # seconds between two looks at who is there
FETCH = 15.0  # seconds for a result of some kilobytes, after which its worker counts as lost
LOST = "5 s"  # after which a worker that died while it started is given up
STARTS = 3  # of all workers, where one ends while it starts
CONNECT = 10.0  # seconds for reaching a scheduler
MISSING = "the extra `cluster` is not installed: pip install 'yeastfit[cluster]'"


@dataclass
class DaskCrew:
    """Workers of one scheduler. Made by `local_crew` and `remote_crew`.

    Attributes:
        where: In words.
        connect: Makes a client.
        owned: A cluster of this process, which ends with the crew.
        scratch: The folder of that cluster's files, likewise.
        wanted: How many workers it has to have: one that dies while it starts is not started again by itself.
    """

    where: str
    connect: Callable[[], Any]
    owned: Any = None
    scratch: TemporaryDirectory[str] | None = None
    wanted: int = 0
    _client: Any = None
    _futures: dict[int, Any] = field(default_factory=dict)
    _tickets: Any = field(default_factory=itertools.count)
    _done: "queue.SimpleQueue[int]" = field(default_factory=queue.SimpleQueue)
    _seen: tuple[float, dict[str, str]] = (-POLL, {})
    _run: str = field(default_factory=lambda: uuid4().hex[:12])

    def __post_init__(self) -> None:
        self._client = self.connect()

    def workers(self) -> Mapping[str, str]:
        """By address, the machine of each; looked up once a second."""
        if time.monotonic() - self._seen[0] > POLL:
            self._check()
            try:
                addresses = self._client.nthreads()
            except (OSError, RuntimeError, ValueError) as error:
                raise SchedulerLost(str(error)) from error
            if len(addresses) < self.wanted:
                self.owned.scale(self.wanted)
            self._seen = time.monotonic(), {one: one.rpartition(":")[0] for one in addresses}
        return self._seen[1]

    def send(self, worker: str, function: Callable[..., Any], *arguments: Any) -> int:
        """See `Crew`."""
        ticket = next(self._tickets)
        self._check()
        key = f"yeastfit-{self._run}-{ticket}"
        how: dict[str, Any] = {"workers": [worker], "allow_other_workers": False, "pure": False, "key": key}
        self._futures[ticket] = self._client.submit(function, *arguments, **how)
        self._futures[ticket].add_done_callback(lambda _: self._done.put(ticket))
        return ticket

    def wait(self, seconds: float) -> list[Answer]:
        """See `Crew`."""
        tickets = []
        with suppress(queue.Empty):
            tickets.append(self._done.get(timeout=seconds))
            while True:
                tickets.append(self._done.get_nowait())
        self._check()
        futures = [(ticket, self._futures.pop(ticket)) for ticket in tickets if ticket in self._futures]
        return [self._answer(*one) for one in futures]

    def drop(self, ticket: int) -> None:
        """See `Crew`."""
        future = self._futures.pop(ticket, None)
        if future is not None:
            with suppress(Exception):  # of a scheduler that is gone
                future.cancel()

    def reconnect(self) -> bool:
        """See `Crew`."""
        self._forget()
        try:
            self._client = self.connect()
        except (OSError, InputError):
            return False
        return True

    def close(self) -> None:
        """See `Crew`."""
        self._forget()
        if self.owned is not None:
            with suppress(TimeoutError):  # on a busy machine it goes on closing behind what comes next
                self.owned.close(timeout=5)
        if self.scratch is not None:
            self.scratch.cleanup()

    def _forget(self) -> None:
        self._futures.clear()
        self._seen = -POLL, {}
        if self._client is not None:
            with suppress(Exception):  # whatever is wrong with it, it is not used any more
                self._client.close(timeout=2)
        self._client = None

    def _check(self) -> None:
        if self._client is None or self._client.status != "running":
            raise SchedulerLost("the connection is closed")

    def _answer(self, ticket: int, future: Any) -> Answer:
        if future.status == "error":
            return Answer(ticket, error=future.exception(timeout=FETCH))
        try:
            return Answer(ticket, future.result(timeout=FETCH))
        except Exception as error:  # cancelled, or its worker died with the result
            return Answer(ticket, error=LookupError(f"its result was lost ({type(error).__name__})"))
        finally:
            future.release()


def local_crew(count: int, threads: int = 1) -> DaskCrew:
    """Processes on this machine, which end with this one. Others on it cannot talk to them: connections have keys.

    Arguments:
        count: How many.
        threads: Of XLA's pool in each.

    Raises:
        InputError: Dask is not installed.
        SimulationError: Processes end while they start.
    """
    distributed = imported()
    import dask

    quiet()
    scratch = TemporaryDirectory(prefix="yeastfit-workers-", ignore_cleanup_errors=True)
    dask.config.set({"distributed.deploy.lost-worker-timeout": LOST, "temporary-directory": scratch.name})
    environment = {"NPROC": str(threads), "JAX_NUM_CPU_DEVICES": "1"}
    security = distributed.Security.temporary()
    start = partial(
        distributed.LocalCluster,
        loop=_loop_deaf_to_ctrl_c(),
        preload="yeastfit.inference.workers.with_parent",
        n_workers=count,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        protocol="tls",
        security=security,
        dashboard_address="127.0.0.1:0",  # any free port; None would be 8787 on all interfaces
        silence_logs=logging.CRITICAL,
        memory_limit=0,
        env=environment,
    )
    for left in reversed(range(STARTS)):
        try:
            cluster = start()
            break
        except RuntimeError as error:  # one that ends while it starts, for lack of memory, for instance
            if not left:
                scratch.cleanup()
                raise SimulationError(
                    f"a worker process ended while it started, {STARTS} times: with too little memory, perhaps, for "
                    f"{count} of them ({' '.join(str(error).split())})"
                ) from error
    how: dict[str, Any] = {"set_as_default": False, "timeout": CONNECT, "security": security}
    return DaskCrew("this machine", lambda: distributed.Client(cluster, **how), cluster, scratch, count)


@cache
def _loop_deaf_to_ctrl_c() -> Any:
    """An event loop, one for all crews, in a thread that blocks SIGINT, which the processes that it starts inherit.

    Ctrl-C in a terminal goes to all processes of a command. This one answers, and the workers end with it; each would
    write a traceback besides.
    """
    from distributed.utils import LoopRunner

    runner = LoopRunner()
    with interrupts_held_back():
        runner.start()
    return runner.loop


def remote_crew(address: str) -> DaskCrew:
    """Those of a scheduler.

    Arguments:
        address: `tcp://host:port`, or `tls://` with keys from Dask's configuration.

    Raises:
        InputError: Dask is not installed, or there is no scheduler.
    """
    distributed = imported()
    quiet()

    def connect() -> Any:
        try:
            return distributed.Client(address, set_as_default=False, timeout=CONNECT)
        except (OSError, ValueError, TypeError) as error:
            what = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"--scheduler is {address}, no scheduler of Dask answers there: {what}") from error

    return DaskCrew(address, connect)


def imported() -> Any:
    """The package `distributed`.

    Raises:
        InputError: It is not installed.
    """
    try:
        import distributed
    except ImportError:
        raise InputError(MISSING) from None
    return distributed


def quiet() -> None:
    """Dask's own log is not for the terminal: what matters is said in words of this package."""
    theirs = ("distributed", "tornado", "asyncio")
    own = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in theirs]  # have own levels
    for name in (*theirs, *own):
        logging.getLogger(name).setLevel(logging.CRITICAL)
