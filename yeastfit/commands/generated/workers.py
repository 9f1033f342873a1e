"""Options for workers: processes on this machine, or those of a scheduler."""

from collections.abc import Mapping, Sequence
from typing import Any

from yeastfit.commands.console.terminal import Pace, err
from yeastfit.commands.generated.options import Option
from yeastfit.errors import InputError
from yeastfit.inference.workers.dask_crew import imported
from yeastfit.inference.workers.spread import BLOCK, PROCESS, Workers
from yeastfit.memory import check_count
from yeastfit.progress import Progress

PANEL = "Workers"


class WorkerOptions:
    """The command receives `Workers`, or None where none are asked for."""

    def options(self, arguments: Sequence[str]) -> list[Option]:
        """Four."""
        return [
            Option("workers", int, "Processes on this machine that simulate, each on one processor.", PANEL),
            Option("scheduler", str, "Or: tcp://HOST:PORT of a scheduler of Dask, whose workers simulate.", PANEL),
            Option(
                "mixed_arithmetic",
                bool,
                "Accept workers whose processor or libraries compute other colonies of the same parameters and seed; "
                "the manifest then names them.",
                PANEL,
                ("--mixed-arithmetic",),
            ),
            Option(
                "block",
                int,
                "Simulations that a worker runs at a time; no result depends on it.",
                PANEL,
                shown=str(BLOCK),
            ),
        ]

    def read(self, given: Mapping[str, Any]) -> Workers | None:
        """What was given, checked.

        Raises:
            InputError: Options do not go together, a number is below 1, or Dask is not installed.
        """
        for name in ("workers", "block"):
            if given.get(name, 1) < 1:
                raise InputError(f"--{name} is {given[name]}, it must be a whole number of at least 1")
        if "workers" in given and "scheduler" in given:
            raise InputError("--workers and --scheduler are given, need one of the two")
        if "workers" not in given and "scheduler" not in given:
            for name in ("mixed_arithmetic", "block"):
                if name in given:
                    raise InputError(f"--{name.replace('_', '-')} is given without --workers or --scheduler: add one")
            return None
        check_count("--workers", given.get("workers", 1), PROCESS)
        imported()
        more = {name: given[name] for name in ("mixed_arithmetic", "block") if name in given}
        return Workers(given.get("workers"), given.get("scheduler"), say=_said, **more)


def paced(progress: Progress, workers: Workers | None, noun: str) -> Progress:
    """A `progress` that also tells how fast workers simulate, how many there are and what is in flight.

    Arguments:
        progress: Where it is shown.
        workers: None where there are none: then it stays as it is.
        noun: What simulations are called.
    """
    if workers is None:
        return progress
    pace = Pace(None, 0, noun, progress, aside=lambda: workers.status)
    workers.tell = pace.count
    return pace


def _said(line: str) -> None:
    err.print(line, highlight=False, soft_wrap=True)
