"""Options that several commands share, and how their text is read."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from yeastfit.errors import InputError
from yeastfit.measure.statistics.registry import measurement_errors, most_telling_first, names_with
from yeastfit.measure.statistics.statistic import Statistic
from yeastfit.numbers import SEEDS, number_of
from yeastfit.text import quoted

SMOOTH = ", ".join(most_telling_first(names_with("smooth")))


def folder_option(text: str, **more: Any) -> Any:
    """The option --out of a command, with its help and what else typer is told of it."""
    return typer.Option("--out", metavar="FOLDER", help=text, **more)


RESULTS = "Folder for the results. It is made if it does not exist."
Out = Annotated[Path, folder_option(RESULTS, show_default=False)]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace results of another command in the folder, and results that were changed since. Only files that "
        "its manifest.json lists are removed.",
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed", min=0, max=SEEDS.high, help="Seed of the random numbers. The same seed gives the same results."
    ),
]
Truth = Annotated[
    bool, typer.Option("--truth", help="Show the true parameters beside the results (synthetic data sets only).")
]
Jobs = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=10_000,
        help="How many micrographs to measure at once. By default one per processor.",
        show_default=False,
    ),
]
_ERRORS = ", ".join(f"{error:g} for {name}" for name, error in measurement_errors().items())
MeasurementError = Annotated[
    float | None,
    typer.Option(
        min=0,
        max=1,
        help="Relative error of measuring a mean curve (0.02 is 2 %), in addition to the variation between colonies. "
        f"By default {_ERRORS} and {Statistic.measurement_error:g} for other statistics; for the off-lattice model "
        "and with --match area what outlines of photographs leave open, such as 0.044 for I_F.",
        show_default=False,
    ),
]


def names_in(text: str | None) -> tuple[str, ...]:
    """Read names separated by commas, none where nothing is given; a minus stands for an underscore."""
    return tuple(part.strip().replace("-", "_") for part in text.split(",")) if text is not None else ()


def check_once(option: str, given: Iterable[str | float]) -> None:
    """Raise `InputError` where something is given twice.

    Arguments:
        option: Its name, for the error.
        given: Names or numbers.
    """
    seen = set[str | float]()
    for one in given:
        if one in seen:
            raise InputError(f"{option} has {one if isinstance(one, str) else f'{one:g}'} twice: leave out one")
        seen.add(one)


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
    numbers = [] if text.strip() == "none" else [number_of(part) for part in text.split(",")]
    if not all(map(math.isfinite, numbers)):
        raise InputError(f"{option} is {quoted(text)}, it must be numbers with commas, such as 2.5,4.5,6.5")
    return numbers


def named_pairs_in(
    option: str, texts: Sequence[str], what: str, example: str = "mobility=0.5:2"
) -> dict[str, tuple[float, float]]:
    """Read an option NAME=A:B that may be given several times.

    Arguments:
        option: Its name, for the error.
        texts: What was given.
        what: What A and B are, for the error.
        example: For the error.

    Returns:
        Pairs by name.

    Raises:
        InputError: Something else was given.
    """
    found = dict[str, tuple[float, float]]()
    for text in texts:
        name, sign, pair = text.rpartition("=")  # names of conditions may hold one, too
        numbers = [number_of(part) for part in pair.split(":")]
        if not sign or len(numbers) != 2 or not all(map(math.isfinite, numbers)):
            raise InputError(f"{option} is {quoted(text)}, it must be a name and {what}, such as {example}")
        parameter, of, condition = name.strip().partition(" of ")  # whose names may have a minus
        key = parameter.replace("-", "_") + of + condition
        if key in found:
            raise InputError(f"{option} is given twice for {key}, {quoted(text)} is the second: leave out one")
        found[key] = (numbers[0], numbers[1])
    return found
