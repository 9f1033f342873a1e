"""`yeastfit demo`: fit the synthetic photographs that come with the package."""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated

import typer

from yeastfit.commands.fit import fit
from yeastfit.commands.generated.options import with_options
from yeastfit.commands.options import RESULTS, Jobs, Overwrite, folder_option
from yeastfit.errors import InputError

IN_WHEEL = files("yeastfit") / "demo"
IN_CLONE = Path(__file__).parents[2] / "data" / "synthetic" / "demo"
QUICK = ["--starts", "1"]


def demo(
    folder: Annotated[
        Path,
        folder_option(RESULTS),
    ] = Path("out/demo"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Start the fit from one place of the search range instead of several.")
    ] = False,
    overwrite: Overwrite = False,
    jobs: Jobs = None,
) -> None:
    """Fit 110 photographs of ten synthetic colonies and show the fitted parameters beside the true ones.

    The same as `yeastfit fit` on that data set with --truth; it replaces the results of an earlier fit in its folder.
    """
    source = IN_WHEEL if IN_WHEEL.is_dir() else IN_CLONE
    if not source.is_dir():
        raise InputError(f"{IN_CLONE} is missing: neither a wheel of yeastfit nor a whole clone is installed")
    options = [*(QUICK if quick else []), *(["--jobs", str(jobs)] if jobs else [])]
    options += ["--overwrite"] if overwrite else []
    command = typer.Typer(pretty_exceptions_enable=False)
    command.command()(with_options(fit, options))
    with as_file(source) as images:
        code = command([str(images), "--out", str(folder), "--truth", *options], standalone_mode=False)
    raise typer.Exit(code or 0)
