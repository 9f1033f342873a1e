"""Programs for a colony with more room, compiled beside the steps of one with less."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager

import jax


class ProgramsAhead:
    """Compiles programs in a thread of its own, one after the other, in the order in which they are asked for.

    Arguments:
        compiled: Compiles those for so much room, by running them.
    """

    def __init__(self, compiled: Callable[[int], object], pool: ThreadPoolExecutor) -> None:
        self._compiled, self._pool = compiled, pool
        self._device = jax.config.jax_default_device  # type: ignore[attr-defined]
        self._jobs = dict[int, Future[object]]()

    def ask(self, rooms: Iterable[int]) -> None:
        """Begin with those for these, unless that has been asked for."""
        for room in rooms:
            if room not in self._jobs:
                self._jobs[room] = self._pool.submit(self._compile, room)

    def await_for(self, room: int) -> None:
        """Wait for those for so much room; what goes wrong with them comes up again when they are run."""
        if room in self._jobs:
            wait([self._jobs[room]])

    def _compile(self, room: int) -> None:
        with jax.default_device(self._device):
            self._compiled(room)


@contextmanager
def programs_ahead(compiled: Callable[[int], object]) -> Iterator[ProgramsAhead]:
    """`ProgramsAhead`; at the end one that is being compiled is left alone, and no other begins."""
    pool = ThreadPoolExecutor(1)
    try:
        yield ProgramsAhead(compiled, pool)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
