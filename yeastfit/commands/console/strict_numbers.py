"""Numbers on the command line: decimal digits within a range, never `nan`, `inf`, `1_0` or digits of other scripts."""

import copy
import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, get_args, get_origin

from typer.models import OptionInfo

from yeastfit.commands.console.failures import UsageError
from yeastfit.errors import InputError
from yeastfit.numbers import Range

KINDS = {float: "<float>", int: "<int>"}  # in the help


def strictly(command: Callable[..., None]) -> Callable[..., None]:
    """Make a command read its numbers by `Range.read`.

    Arguments:
        command: Its options have `Annotated` types.

    Returns:
        The same command; smallest and largest values that its options state are their ranges.
    """

    @functools.wraps(command, assigned=("__module__", "__name__", "__qualname__", "__doc__"))
    def read(**given: Any) -> None:
        command(**given)

    signature = inspect.signature(command, eval_str=True)
    parameters = [each.replace(annotation=_strict(each)) for each in signature.parameters.values()]
    read.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    read.__annotations__ = {each.name: each.annotation for each in parameters}
    return read


def _strict(parameter: inspect.Parameter) -> Any:
    """The annotation of an option, with a parser where it is a number."""
    if get_origin(parameter.annotation) is not Annotated:
        return parameter.annotation
    hint, *notes = get_args(parameter.annotation)
    kind = next((each for each in KINDS if each in (hint, *get_args(hint))), None)
    if kind is None or not isinstance(notes[0], OptionInfo):
        return parameter.annotation
    option = copy.copy(notes[0])
    name = next((each for each in option.param_decls or () if each.startswith("--")), f"--{parameter.name}")
    low, high = -inf if option.min is None else option.min, inf if option.max is None else option.max
    option.parser = _Reader(name.replace("_", "-"), Range(low, high), kind)
    option.min = option.max = None
    option.metavar = option.metavar or KINDS[kind]
    return Annotated[hint, option]


@dataclass(frozen=True)
class _Reader:
    """The parser of a number."""

    option: str
    admissible: Range
    kind: type

    def __call__(self, value: Any) -> float:
        """Read it; typer would replace the message of a `ValueError`."""
        try:
            return (self.admissible.read_whole if self.kind is int else self.admissible.read)(value, self.option)
        except InputError as error:
            raise UsageError(str(error)) from None
