"""What every command says on the terminal: results on standard output, progress and warnings on standard error."""

import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import timedelta

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

out, err = Console(), Console(stderr=True)


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on a terminal, nothing elsewhere."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, disable=not err.is_terminal, transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def stages() -> Iterator[Callable[[str, float], None]]:
    """What a fit is doing: a bar on a terminal, nothing elsewhere."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, disable=not err.is_terminal, transient=True) as bar:
        task = bar.add_task("fitting", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)


@dataclass
class Pace:
    """How fast colonies grow, and how long the rest takes at most: `most` of them in all, of which `done` were there.

    Seconds count from `began`, whatever else they were spent on.
    """

    most: int
    done: int
    began: float = field(default_factory=lambda: clock.perf_counter())
    grown: int = 0

    @property
    def share(self) -> float:
        """Of the whole."""
        return min((self.done + self.grown) / self.most, 1.0)

    def __str__(self) -> str:
        """For a terminal; nothing before there is anything to tell."""
        if not self.grown:
            return ""
        each = self.grown / (clock.perf_counter() - self.began)
        left = timedelta(seconds=round(max(self.most - self.done - self.grown, 0) / each))
        return f"{self.grown} colonies, {each:.1f} a second, at most {left} left"


@contextmanager
def growing(most: int, done: int) -> Iterator[tuple[Callable[[int], None], Callable[[str, float], None]]]:
    """What a sampler is doing, with the pace of its colonies; nothing but on a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[pace]}"), TimeElapsedColumn())
    with Progress(*columns, console=err, disable=not err.is_terminal, transient=True) as bar:
        pace = Pace(most, done)
        task = bar.add_task("sampling", total=1.0, pace="")
        bar.update(task, completed=pace.share)

        def tell(rows: int) -> None:
            pace.grown += rows
            bar.update(task, completed=pace.share, pace=str(pace))

        yield tell, lambda what, share: bar.update(task, description=what)


def warn(lines: list[str]) -> None:
    """Each on a line of its own."""
    for line in lines:
        err.print(f"warning: {line}", markup=False, highlight=False, soft_wrap=True)


def fail(lines: list[str]) -> None:
    """Says these, and ends with exit code 2."""
    for line in lines:
        err.print(f"error: {line}", markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(2)
