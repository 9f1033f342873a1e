"""The command line: the commands, each imported when it is run, and what happens to errors."""

import errno
import importlib
import inspect
import os
import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from yeastfit.commands.console import signals
from yeastfit.commands.console.failures import UsageError, explained
from yeastfit.commands.console.program_cache import keep_programs
from yeastfit.commands.console.strict_numbers import strictly
from yeastfit.commands.generated.options import with_options
from yeastfit.errors import InputError

HELP = """Estimate how yeast colonies grow from micrographs: simulate, measure, fit, infer.

Results come with a manifest.json that says how they were made. Bad input ends with one line and exit code 2.
"""
COMMANDS = {
    "demo": "Fit 110 photographs of ten synthetic colonies and show the fitted parameters beside the true ones.",
    "simulate": "Simulate growing colonies.",
    "manifest": "Write manifest.csv for a folder of images, from the names of its files.",
    "measure": "Outline the colony in each micrograph and measure its shape; lengths are in µm.",
    "synthesize": "Make synthetic micrographs of simulated colonies.",
    "fit": "Fit the model's parameters to the colonies of a data set, with standard errors.",
    "infer": "Infer which model parameters the data leave possible (posterior.csv, posterior.npz, index.html).",
    "compare": "Compare posteriors: models on the same colonies, and conditions under the same model.",
    "gradcheck": "Check the derivatives of a colony's statistics.",
    "design": "Find the measurement that would reduce the errors of the parameters most.",
}
"""First paragraph of each command's help, shown without importing what the command needs."""
SUBJECT = re.compile(r"[a-z_]\w*((: | and )[a-z_]\w*)?(?=( \([^)]*\))? (is|are|of|names) | ['\"].*['\"]: )")
"""Of an error's sentence: a name, two, or a rule and its setting, perhaps with a unit, or its value."""
RULE = re.compile(r"\b(\w+)(?:: rule)? '([\w-]+)'")
"""In an error's sentence: the question that a rule answers, and its name."""
INTERRUPTED = 130  # what typer makes of `KeyboardInterrupt`
NO_FILES = (errno.EMFILE, errno.ENFILE)  # no more files can be opened, of the process or of the machine
UNREAD = 141  # what a shell says of a program whose output nobody reads


@dataclass
class Running:
    """The folder for the results of the command that is run, once it is known."""

    folder: Path | None = None


class _Command(TyperCommand):
    """A command that tells of repeated options, says where its results go, and names options as they are typed."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse them, with a warning of what is given again although it counts once."""
        self.flags = {one.partition("=")[0] for one in args if one.startswith("--")}
        texts, _, given = self.make_parser(ctx).parse_args(args=list(args))
        options = [one for one in given if isinstance(one, TyperOption) and not one.multiple]
        once = [one for one in options if not one.is_flag or one.secondary_opts]  # --hard --relaxed
        for name in dict.fromkeys(one.opts[0] for one in once if once.count(one) > 1):
            print(f"warning: {name} is given more than once, the last one counts", file=sys.stderr)
        rest = super().parse_args(ctx, args)
        for one in given:  # an empty name, of a variable that is not set, perhaps, would be the current folder
            if "" in _each(texts[one.name]) and any(isinstance(read, Path) for read in _each(ctx.params[one.name])):
                raise UsageError(f"{one.opts[0]} is '', need a file or folder; . is the current one")
        return rest

    def invoke(self, ctx: Any) -> Any:
        """Run it."""
        if isinstance(ctx.obj, Running):
            ctx.obj.folder = ctx.params.get("folder")
        try:
            return super().invoke(ctx)
        except InputError as error:
            said, typed = str(error), self._typed()
            if (rule := RULE.match(said)) and rule[1] in typed:  # "births: rule 'walkers' needs" an option, too
                raise InputError(RULE.sub(partial(_as_option, typed), said)) from None
            subject = SUBJECT.match(said)  # "contact_width is -1" begins with a name in Python
            names = subject[0].replace(": ", "_").split(" and ") if subject else []
            if subject is None or not all(name in typed for name in names):
                raise
            raise InputError(" and ".join(typed[name] for name in names) + said[subject.end() :]) from None

    def _typed(self) -> dict[str, str]:
        """Options by their names in Python, each as it was typed."""
        options = [one for one in self.params if one.param_type_name == "option"]
        return {one.name: next((flag for flag in one.opts if flag in self.flags), one.opts[0]) for one in options}


def _as_option(typed: Mapping[str, str], rule: re.Match[str]) -> str:
    """A rule as the option that chooses it."""
    return f"{typed[rule[1]]} {rule[2]}" if rule[1] in typed else rule[0]


def _each(value: Any) -> Sequence[Any]:
    """What is given once or several times."""
    return value if isinstance(value, list | tuple) else [value]


class _Commands(TyperGroup):
    """The group of all commands: help knows them by name, and the one that is run is imported."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that is run and its arguments."""
        name, command, rest = super().resolve_command(ctx, args)
        if ctx.params["cache"]:
            keep_programs()  # before the command imports JAX
        return name, command and loaded(name or "", rest), rest


app = typer.Typer(cls=_Commands, pretty_exceptions_enable=False)


def print_version(wanted: bool) -> bool:
    """Print the version and end, before any command is looked at."""
    if wanted:
        typer.echo(f"yeastfit {version('yeastfit')}")
        raise typer.Exit
    return wanted


@app.callback(help=HELP)
def options(
    wanted: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=print_version, is_eager=True)
    ] = False,
    cache: Annotated[
        bool, typer.Option(help="Keep compiled programs in your cache folder, so that the next run starts sooner.")
    ] = True,
) -> None:
    """Options that come before a command."""


for name, summary in COMMANDS.items():
    app.command(name, help=summary)(lambda: None)


def loaded(name: str, arguments: Sequence[str] = ()) -> Any:
    """Import a command of `COMMANDS` and make typer's object of it, with the options that these arguments bring."""
    command = getattr(importlib.import_module(f"yeastfit.commands.{name}"), name)
    # each paragraph in one line: typer breaks lines where the docstring does
    text = re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.getdoc(command) or "")
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command(name, cls=_Command, help=text)(strictly(with_options(command, arguments)))
    return typer.main.get_command(alone)


def run(arguments: list[str] | None = None) -> int:
    """Run one command.

    Arguments:
        arguments: The command and its options; by default those on the command line.

    Returns:
        The exit code: 0; 1 where a result is to be doubted or a computation failed; 2 for what the user gave;
        70 for a fault of yeastfit; 130, 143 and 129 after Ctrl-C, SIGTERM and SIGHUP.
    """
    signals.forget()
    running, given = Running(), sys.argv[1:] if arguments is None else arguments
    try:
        code = app(given or ["--help"], prog_name="yeastfit", standalone_mode=False, obj=running)
        sys.stdout.flush()
    except SystemExit as finished:  # after completing in a shell, and where nobody reads what typer writes
        return UNREAD if isinstance(finished.__context__, BrokenPipeError) else int(finished.code or 0)
    except Exception as error:
        if not signals.current.received:  # else an import, for instance, made something else of the signal
            return _failed(error, running.folder)
        code = INTERRUPTED
    if signals.current.received or code == INTERRUPTED:
        return signals.current.tell()
    return int(code or 0) if given else 2


def _failed(error: Exception, folder: Path | None) -> int:
    """Say in one line what went wrong; the exit code."""
    if isinstance(error, OSError) and error.errno not in (None, *NO_FILES) and error.filename is None:
        # all files are written under their names
        error.filename = "standard output"
        _drop_output()
    if isinstance(error, BrokenPipeError):
        return UNREAD
    code, line = explained(error, folder)
    with suppress(OSError):
        print(f"error: {line}", file=sys.stderr, flush=True)
    return code


def _drop_output() -> None:
    """Where standard output takes no more, drop what is left, which Python would write at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
