"""Options that several commands have, and those of the model's parameters."""

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.model.parameters import NAMES, PARAMETERS

Out = Annotated[Path, typer.Option("--out", help="Folder for the results; made if missing.", show_default=False)]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Random seed: same seed, same result.")]
Rate = Annotated[float, typer.Option("--rate", help="Maximal growth rate μ* per hour; the unit of time is 1/μ*.")]
Truth = Annotated[bool, typer.Option("--truth", help="Show the true parameters beside, of synthetic data.")]
Jobs = Annotated[
    int | None, typer.Option(min=1, help="Most processes that measure; by default one a core.", show_default=False)
]
MeasurementError = Annotated[
    float | None,
    typer.Option(min=0, help="Relative, beside the scatter of colonies; by default 0.02 of compactness, else 0.01."),
]
Length = Annotated[float, typer.Option("--length", help="Cell length L0 in µm: the model's unit of length.")]

DEFAULT = {name: info.default for name, info in PARAMETERS.items()}


def with_parameters(command: Callable[..., None]) -> Callable[..., None]:
    """Gives a command an option for each of λ1 … λ7; it receives them in one dictionary, `parameters`."""

    @functools.wraps(command)
    def wrapped(**given: Any) -> None:
        parameters = {name: given.pop(name) for name in NAMES}
        command(**given, parameters=parameters)

    signature = inspect.signature(command)
    own = [each for each in signature.parameters.values() if each.name != "parameters"]
    kind = inspect.Parameter.KEYWORD_ONLY
    options = [
        inspect.Parameter(name, kind, default=DEFAULT[name], annotation=Annotated[float, _option(name)])
        for name in NAMES
    ]
    wrapped.__signature__ = signature.replace(parameters=[each.replace(kind=kind) for each in own] + options)  # type: ignore[attr-defined]
    wrapped.__annotations__ = {each.name: each.annotation for each in [*own, *options]}
    return wrapped


def _option(name: str) -> Any:
    info = PARAMETERS[name]
    text = f"{info.symbol}: {info.meaning}; plausible {info.plausible[0]:g} to {info.plausible[1]:g}."
    return typer.Option(f"--{name.replace('_', '-')}", help=text, rich_help_panel="Model parameters (dimensionless)")
