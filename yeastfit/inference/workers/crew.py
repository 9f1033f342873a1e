"""Who simulates: processes that are asked by name, and answer in any order or never.

`Crew` is all that the distribution of blocks (`dispatch`) knows of them, so that it runs on Dask and, in tests, on
workers that fail as they are told to.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable


class SchedulerLost(Exception):
    """The connection to all workers is gone; `Crew.reconnect` may bring it back."""


@dataclass(frozen=True)
class Answer:
    """What came of one request.

    Attributes:
        ticket: Of the request.
        value: What the function returned; None where it failed.
        error: What it raised, or why nothing came; None where it did not fail.
    """

    ticket: int
    value: Any = None
    error: Exception | None = None


@runtime_checkable
class Crew(Protocol):
    """Workers that come and go."""

    @property
    def where(self) -> str:
        """Where they are, in words."""

    def workers(self) -> Mapping[str, str]:
        """Those that are there: the machine of each, by address.

        Raises:
            SchedulerLost: Nobody can tell.
        """

    def send(self, worker: str, function: Callable[..., Any], *arguments: Any) -> int:
        """Ask a worker to call a function; requests to one worker are done one after the other. The ticket."""

    def wait(self, seconds: float) -> list[Answer]:
        """What has come, at the latest after so many seconds, when it may be nothing.

        Raises:
            SchedulerLost: Nothing will come any more.
        """

    def drop(self, ticket: int) -> None:
        """Want no answer any more."""

    def reconnect(self) -> bool:
        """Try once to reach the workers again."""

    def close(self) -> None:
        """End the connection, and workers that were started for it."""
