"""What every command says on the terminal: results on standard output, progress and warnings on standard error."""

import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

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


@contextmanager
def growing() -> Iterator[tuple[Callable[[int], None], Callable[[str, float], None]]]:
    """What a sampler is doing, with colonies grown a second and the time that is left; nothing but on a terminal."""
    columns = (
        *(TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[grown]}")),
        *(TimeElapsedColumn(), TimeRemainingColumn(elapsed_when_finished=True)),
    )
    with Progress(*columns, console=err, disable=not err.is_terminal, transient=True) as bar:
        task = bar.add_task("sampling", total=1.0, grown="")
        began, grown = clock.perf_counter(), 0

        def tell(rows: int) -> None:
            nonlocal grown
            grown += rows
            each = grown / (clock.perf_counter() - began)
            bar.update(task, grown=f"{grown} colonies, {each:.1f} a second")

        yield tell, lambda what, share: bar.update(task, description=what, completed=share)


def warn(lines: list[str]) -> None:
    """Each on a line of its own."""
    for line in lines:
        err.print(f"warning: {line}", markup=False, highlight=False, soft_wrap=True)


def fail(lines: list[str]) -> None:
    """Says these, and ends with exit code 2."""
    for line in lines:
        err.print(f"error: {line}", markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(2)
