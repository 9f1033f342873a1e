"""The terminal: results go to standard output, progress, warnings and errors to standard error.

Whatever is printed is data: markup and names of emoji mean nothing in it, and nothing in it acts on the terminal.
"""

import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.text import Text

from yeastfit.progress import Progress, silent
from yeastfit.text import shown


class TextConsole(Console):
    """A console that shows strings as `yeastfit.text.shown` does, in tables too."""

    def render_str(self, text: str, **options: Any) -> Text:
        """What rich prints of a string."""
        return super().render_str(shown(text), **{**options, "markup": False, "emoji": False})


out, err = TextConsole(), TextConsole(stderr=True)
APART = 600.0  # seconds between lines of progress in a file: a run of hours leaves some dozens


@contextmanager
def shown_progress(what: str) -> Iterator[Progress]:
    """Show on a terminal what a computation is doing and how far it is; in a file say so every `APART` seconds.

    Arguments:
        what: Shown until the computation says something itself.

    Yields:
        What to hand to the computation as its `progress`.
    """
    if not err.is_terminal:
        yield _said_at_times()
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=err, transient=True) as bar:
        task = bar.add_task(shown(what), total=1.0)
        yield lambda doing, share: bar.update(task, description=shown(doing), completed=share)


def _said_at_times() -> Progress:
    """A `progress` of lines that are at least `APART` seconds apart."""
    began = last = clock.perf_counter()

    def say(doing: str, share: float) -> None:
        nonlocal last
        now = clock.perf_counter()
        if now - last >= APART:
            last, spent = now, timedelta(seconds=round(now - began))
            err.print(f"after {spent}: {doing}, {100 * share:.0f} %", highlight=False, soft_wrap=True)

    return say


@dataclass
class Pace:
    """A sampler's `progress` that also tells how fast simulations run, and how long the rest takes at most.

    Attributes:
        most: Simulations in all, at most; None where nobody knows.
        done: How many of them were there before.
        noun: What they are called.
        progress: Where it is shown.
        doing: What the sampler is doing.
        began: Seconds count from here, whatever else they are spent on.
        grown: Simulations since then.
        aside: What else is shown beside the pace, such as how many workers there are.
        given: The share that the sampler tells, which counts where nobody knows how many simulations there will be.
    """

    most: int | None
    done: int
    noun: str = "simulations"
    progress: Progress = silent
    doing: str = "sampling"
    began: float = field(default_factory=lambda: clock.perf_counter())
    grown: int = 0
    aside: Callable[[], str] = str
    given: float = 0.0

    def __call__(self, what: str, share: float) -> None:
        """Show what the sampler is doing; the share that counts is that of the simulations."""
        self.doing, self.given = what, share
        self._show()

    def count(self, simulations: int) -> None:
        """Show that so many more have run."""
        self.grown += simulations
        self._show()

    def _show(self) -> None:
        self.progress(f"{self.doing}: {self}" if self.grown else self.doing, self.share)

    @property
    def share(self) -> float:
        """Of the whole."""
        return min((self.done + self.grown) / self.most, 1.0) if self.most else self.given

    def __str__(self) -> str:
        """For a terminal; nothing before there is anything to say."""
        if not self.grown:
            return ""
        each = self.grown / (clock.perf_counter() - self.began)
        pace = f"{self.grown} {self.noun}, {each:.1f} a second"
        pace += f", {self.aside()}" if self.aside() else ""
        if self.most is None or self.done + self.grown > self.most:  # draws that failed are made up for
            return pace
        left = timedelta(seconds=round((self.most - self.done - self.grown) / each))
        return f"{pace}, at most {left} left"


def warn(lines: list[str]) -> None:
    """Print warnings on standard error, each on a line of its own."""
    for line in lines:
        err.print(f"warning: {line}", highlight=False, soft_wrap=True)


def fail(lines: list[str]) -> None:
    """Print errors on standard error, each on a line of its own, and end with exit code 2."""
    for line in lines:
        err.print(f"error: {line}", highlight=False, soft_wrap=True)
    raise typer.Exit(2)
