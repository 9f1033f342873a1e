"""What all benchmarks share: `python -m benchmarks.NAME [--quick] [--json FILE]`.

A benchmark is a module with a function `run(report, quick)`, which measures and calls

    report.add("speed", 14.2, "×", target=12)                   # a Figure; at least the target
    report.add("compile time", 9.1, "s", target=15, at_least=False)
    report.table("against nodes", [{"nodes": 100, "ms": 1.2}])  # rows of numbers behind the figures
    report.stage("ensembles")                                   # what is measured next, on standard error

and the last lines `if __name__ == "__main__": command("NAME", run)`. Tables are printed when they are made, figures on
standard error at once, so that a run that is killed has said what it knew, and all together at the end with the machine
they were measured on. They are written to FILE if given. The exit status is 1 when a target is missed; NaN misses every
target.
"""

import json as json_
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import date
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

import yeastfit
from yeastfit.processors import available_processors
from yeastfit.storage import write_json, written_whole


@dataclass(frozen=True)
class Figure:
    """One measured number. `target` is a lower bound (`at_least`) or an upper one; None for no target."""

    name: str
    value: float
    unit: str
    target: float | None = None
    at_least: bool = True
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the target is met, None without one."""
        if self.target is None:
            return None
        return bool(self.value >= self.target if self.at_least else self.value <= self.target)


@dataclass
class Report:
    """Results of one benchmark, in the order in which they were added.

    Attributes:
        name: Of the benchmark.
        quick: Whether it is a rough measurement.
        docs: Folder for its page.
        partial: File that keeps finished parts of an interrupted run.
        folders: Those given on the command line, for benchmarks that ask for some.
        figures: Measured numbers.
        tables: Rows by title.
        details: Further data for the JSON file, not shown on the terminal.
        began: When it started.
    """

    name: str
    quick: bool = False
    docs: Path | None = None
    partial: Path | None = None
    folders: tuple[Path, ...] = ()
    figures: list[Figure] = field(default_factory=list)
    tables: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    details: dict[str, Any] = field(default_factory=dict)
    began: float = field(default_factory=time.perf_counter)

    def add(
        self, name: str, value: float, unit: str, target: float | None = None, at_least: bool = True, note: str = ""
    ) -> Figure:
        """Add a `Figure`, and say so at once: a run may be killed later. `value` may be a NumPy or JAX scalar."""
        self.figures.append(Figure(name, float(value), unit, target, at_least, note))
        self.stage(f"{name}: {_text(float(value))} {unit}".rstrip())
        return self.figures[-1]

    def table(self, title: str, rows: Sequence[dict[str, Any]]) -> None:
        """Add a table, one dictionary per row with the columns of the first, and print it at once."""
        self.tables[title] = list(rows)
        table = Table(*rows[0], title=title, title_justify="left")
        for row in rows:
            table.add_row(*(_text(value) for value in row.values()))
        _console().print(table)

    def part(self, key: str, make: Callable[[], Any]) -> Any:
        """`make()`, which returns plain data; kept in `partial`, from which an interrupted run continues."""
        kept = json_.loads(self.partial.read_text()) if self.partial and self.partial.is_file() else {}
        if key not in kept:
            kept[key] = make()
            if self.partial:
                with written_whole(self.partial) as temporary:
                    temporary.write_text(json_.dumps(kept))
        return kept[key]

    def stage(self, text: str) -> None:
        """Print what is measured next."""
        print(f"[{time.perf_counter() - self.began:4.0f} s] {text}", file=sys.stderr, flush=True)

    def row(self, row: dict[str, Any]) -> None:
        """Print one row of a table that is being made."""
        self.stage(", ".join(f"{name}: {_text(value)}" for name, value in row.items() if value is not None))

    @property
    def met(self) -> bool:
        """Whether every target is met."""
        return all(figure.met is not False for figure in self.figures)

    def asdict(self) -> dict[str, Any]:
        """Plain data: what `--json` writes."""
        return {
            "benchmark": self.name,
            "quick": self.quick,
            "met": self.met,
            "seconds": time.perf_counter() - self.began,
            "machine": machine(),
            "figures": [{**asdict(figure), "met": figure.met} for figure in self.figures],
            "tables": self.tables,
            **self.details,
        }

    @property
    def origin(self) -> str:
        """When and where a page was written: the line below its title."""
        return f"Written by `python -m benchmarks.{self.name} --docs docs` on {date.today()}. {_about()}."

    def head(self, doc: str | None) -> str:
        """Title, `origin` and text of a page, from a benchmark's docstring up to its command."""
        title, *rest = (doc or "").split("\n\n")
        text = rest[: next(k for k, one in enumerate(rest) if one.startswith("    python -m"))]
        return "\n\n".join([f"# {title.rstrip('.')}", self.origin, *text])

    def sections(self) -> list[str]:
        """Figures and tables as parts of a page in Markdown."""
        figures = [
            {
                "figure": f.name,
                "value": f.value,
                "unit": f.unit,
                "target": "" if f.target is None else f"{'≥' if f.at_least else '≤'} {f.target:g}",
                "met": {True: "yes", False: "**no**", None: ""}[f.met],
                "note": f.note,
            }
            for f in self.figures
        ]
        tables = {"figures": figures, **self.tables}
        return [f"## {title[0].upper()}{title[1:]}\n\n{_markdown(rows)}" for title, rows in tables.items()]

    def print(self) -> None:
        """Figures on the terminal, with the machine above; tables are there already."""
        console = _console()
        console.print(f"benchmarks.{self.name}{' --quick' if self.quick else ''}\n{_about()}", markup=False)
        table = Table("figure", "value", "unit", "target", "", "note")
        for f in self.figures:
            target = "" if f.target is None else f"{'≥' if f.at_least else '≤'} {f.target:g}"
            verdict = {True: "[green]met[/]", False: "[bold red]MISSED[/]", None: ""}[f.met]
            table.add_row(f.name, _text(f.value), f.unit, target, verdict, f.note)
        console.print(table)


def _console() -> Console:
    """Standard output, with room for long notes where that is no terminal."""
    return Console(width=None if sys.stdout.isatty() else 150)


def _markdown(rows: Sequence[dict[str, Any]]) -> str:
    """Rows as a Markdown table, numbers with three digits."""

    def text(value: Any) -> str:
        return "" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)

    head = "| " + " | ".join(str(key).strip() for key in rows[0]) + " |\n" + "|---" * len(rows[0]) + "|\n"
    return head + "\n".join("| " + " | ".join(map(text, row.values())) + " |" for row in rows) + "\n"


def _about() -> str:
    return "; ".join(f"{key} {value}" for key, value in machine().items())


def machine() -> dict[str, Any]:
    """The machine and the versions behind a measurement."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    devices = jax.devices()
    return {
        "cpu": models[0] if models else platform.processor() or platform.machine(),
        "cores": available_processors(),
        "device": f"{len(devices)} × {devices[0].device_kind} ({devices[0].platform})",
        "precision": "double" if jax.config.read("jax_enable_x64") else "single",
        "python": platform.python_version(),
        "yeastfit": measured(),
        **{package.__name__: package.__version__ for package in (jax, np)},
    }


@cache
def measured() -> str:
    """The commit or the version of yeastfit that is measured, as it was when first asked for."""
    return commit(Path(yeastfit.__file__).parent) or yeastfit.__version__


def commit(package: Path) -> str:
    """The commit of the checkout that holds `package`, and whether code was changed since; empty for an installed one.

    The version that was installed names another commit when the environment was made from another one.
    """

    def git(*arguments: str) -> str:
        told = subprocess.run(("git", "-C", package.parent, *arguments), capture_output=True, check=True, text=True)
        return told.stdout.strip()

    try:
        git("ls-files", "--error-unmatch", package.name)  # fails for a package installed inside another checkout
        changed = git("status", "--porcelain", "--", package.name, "benchmarks")
        return f"commit {git('rev-parse', '--short=9', 'HEAD')}{' with changes' if changed else ''}"
    except (OSError, subprocess.CalledProcessError):
        return ""


def command(
    name: str, run: Callable[[Report, bool], None], arguments: list[str] | None = None, folders: tuple[str, ...] = ()
) -> None:
    """Run a benchmark from the command line, or from `arguments`, and exit with its status.

    Arguments:
        name: Of the benchmark.
        run: Measures and fills the report.
        arguments: Instead of those of the command line.
        folders: Names of the folders that the command line must give, in order.
    """

    def main(
        context: typer.Context,
        quick: Annotated[bool, typer.Option("--quick", help="A rougher measurement within about a minute.")] = False,
        json: Annotated[Path | None, typer.Option("--json", help="File for the figures.", show_default=False)] = None,
        docs: Annotated[Path | None, typer.Option("--docs", help="Folder for a page, where there is one.")] = None,
    ) -> None:
        given = tuple(Path(one) for one in context.args)
        if len(given) != len(folders) or not all(one.is_dir() for one in given):
            got = " ".join(map(str, given)) or "nothing"
            raise typer.BadParameter(f"got {got}, need {len(folders)} folders: {' '.join(folders)}")
        measured()  # the checkout may be at another commit when hours later a page is written
        report = Report(name, quick, docs, json and json.with_suffix(".partial"), given)
        try:
            run(report, quick)
        finally:  # what was measured before a failure is still shown
            report.print()
        if json:
            write_json(json, report.asdict())
            json.with_suffix(".partial").unlink(missing_ok=True)
        raise typer.Exit(0 if report.met else 1)

    with suppress(RuntimeError):  # JAX has its devices already
        jax.config.update("jax_num_cpu_devices", available_processors())  # as the command line of yeastfit does
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="markdown")
    app.command(
        help=sys.modules[run.__module__].__doc__,
        options_metavar=" ".join(["[OPTIONS]", *folders]),
        context_settings={"allow_extra_args": bool(folders)},
    )(main)
    app(arguments, prog_name=f"python -m benchmarks.{name}")


@cache
def code() -> str:
    """The version of the code that is measured: eight hexadecimal digits of the SHA-256 of yeastfit's files."""
    folder = Path(yeastfit.__file__).parent
    files = sorted(folder.rglob("*.py"))
    return sha256(b"".join(str(one.relative_to(folder)).encode() + one.read_bytes() for one in files)).hexdigest()[:8]


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "" if value is None else str(value)
