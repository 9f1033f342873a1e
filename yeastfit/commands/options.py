"""Options that several commands share, those of a model's parameters, and how their text is read."""

import functools
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.errors import InputError
from yeastfit.measure.statistics.registry import measurement_errors, most_telling_first, names_with
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.numbers import SEEDS
from yeastfit.parameter_set import Parameter, ParameterSet

SMOOTH = ", ".join(most_telling_first(names_with("smooth")))
Out = Annotated[
    Path, typer.Option("--out", help="Folder for the results. It is made if it does not exist.", show_default=False)
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed", min=0, max=SEEDS.high, help="Seed of the random numbers. The same seed gives the same results."
    ),
]
Rate = Annotated[
    float, typer.Option("--rate", help="Maximal growth rate μ* of the cells, per hour. Model time is in units of 1/μ*.")
]
Length = Annotated[
    float, typer.Option("--length", help="Mean length L0 of a cell, in µm. Model lengths are in units of L0.")
]
Truth = Annotated[
    bool, typer.Option("--truth", help="Show the true parameters beside the results (synthetic data sets only).")
]
Jobs = Annotated[
    int | None,
    typer.Option(
        min=1, help="How many micrographs to measure at once. By default one per processor.", show_default=False
    ),
]
_ERRORS = ", ".join(f"{error:g} for {name}" for name, error in measurement_errors().items())
MeasurementError = Annotated[
    float | None,
    typer.Option(
        min=0,
        help="Relative error of measuring a mean curve (0.02 is 2 %), in addition to the variation between colonies. "
        f"By default {_ERRORS} and {Statistic.measurement_error:g} for other statistics.",
        show_default=False,
    ),
]


def with_parameters(parameters: ParameterSet) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command an option for each parameter of a model.

    Arguments:
        parameters: The model's parameters.

    Returns:
        A decorator. The command receives the values as one dictionary, `parameters`.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def wrapped(**given: Any) -> None:
            values = {name: given.pop(name) for name in parameters}
            command(**given, parameters=values)

        signature = inspect.signature(command)
        own = [each for each in signature.parameters.values() if each.name != "parameters"]
        kind = inspect.Parameter.KEYWORD_ONLY
        options = [
            inspect.Parameter(one.name, kind, default=one.default, annotation=Annotated[float, _option(one)])
            for one in parameters.values()
        ]
        together = [each.replace(kind=kind) for each in own] + options
        wrapped.__signature__ = signature.replace(parameters=together)  # type: ignore[attr-defined]
        wrapped.__annotations__ = {each.name: each.annotation for each in together}
        return wrapped

    return decorate


def _option(parameter: Parameter) -> Any:
    """An option that says what the parameter means and which values make sense."""
    low, high = parameter.plausible
    unit = f" {parameter.unit}" if parameter.unit else ""
    text = f"{parameter.symbol}, {parameter.meaning}. Plausible: {low:g} to {high:g}{unit}."
    return typer.Option(f"--{parameter.name.replace('_', '-')}", help=text, rich_help_panel="Model parameters")


def names_in(text: str) -> tuple[str, ...]:
    """Read names separated by commas; a minus stands for an underscore."""
    return tuple(part.strip().replace("-", "_") for part in text.split(","))


def numbers_in(option: str, text: str) -> list[float]:
    """Read numbers separated by commas; "none" is no number.

    Arguments:
        option: Its name, for the error.
        text: What was given.

    Returns:
        The numbers in their order.

    Raises:
        InputError: Something else was given.
    """
    try:
        return [] if text.strip() == "none" else [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} is {text!r}, it must be numbers with commas, such as 2.5,4.5,6.5") from None


def named_pairs_in(option: str, texts: Sequence[str], what: str) -> dict[str, tuple[float, float]]:
    """Read an option NAME=A:B that may be given several times.

    Arguments:
        option: Its name, for the error.
        texts: What was given.
        what: What A and B are, for the error.

    Returns:
        Pairs by name.

    Raises:
        InputError: Something else was given.
    """
    found = {}
    for text in texts:
        name, _, pair = text.partition("=")
        try:
            first, second = (float(part) for part in pair.split(":"))
        except ValueError:
            raise InputError(f"{option} is {text!r}, it must be a name and {what}, such as mobility=0.5:2") from None
        found[name.strip().replace("-", "_")] = (first, second)
    return found
