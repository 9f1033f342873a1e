"""The command line: the commands, what happens to errors, and the entry point `yeastfit`."""

import inspect
import re
import sys
from importlib.metadata import version
from typing import Annotated

import jax
import typer

from yeastfit.commands.demo import demo
from yeastfit.commands.design import design
from yeastfit.commands.fit import fit
from yeastfit.commands.gradcheck import gradcheck
from yeastfit.commands.infer import infer
from yeastfit.commands.measure import measure
from yeastfit.commands.simulate import simulate
from yeastfit.commands.synthesize import synthesize
from yeastfit.commands.terminal import err
from yeastfit.errors import InputError, SimulationError
from yeastfit.processors import available_processors

HELP = """Estimate how yeast colonies grow from micrographs: simulate, measure, fit, infer.

Every command leaves a manifest.json that says how its results were made. Bad input ends with one line and exit code 2.
"""
COMMANDS = (demo, simulate, measure, synthesize, fit, infer, gradcheck, design)
INTERRUPTED = 130  # typer's exit code after Ctrl-C

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)


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
) -> None:
    """Options that come before a command."""


for command in COMMANDS:
    # each paragraph in one line: typer breaks lines where the docstring does
    app.command(help=re.sub(r"(?<!\n)\n(?!\n)", " ", inspect.getdoc(command) or ""))(command)


def run(arguments: list[str] | None = None) -> int:
    """Run one command.

    Arguments:
        arguments: The command and its options; by default those on the command line.

    Returns:
        The exit code: 0, 1 where a result is to be doubted, 2 where there is none.
    """
    try:
        app(arguments)
    except (InputError, SimulationError) as error:
        err.print(f"error: {error}", markup=False, highlight=False, soft_wrap=True)
        return 2
    except SystemExit as finished:
        if finished.code == INTERRUPTED:
            err.print("interrupted: what stands in the folder without a manifest.json is not a result")
        return int(finished.code or 0)
    return 0


def main() -> None:
    """Entry point of `yeastfit`."""
    # one JAX device per processor, over which ensembles are shared out
    jax.config.update("jax_num_cpu_devices", available_processors())
    sys.exit(run())
