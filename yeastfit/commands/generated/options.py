"""Options that follow from what is registered, made when a command line is read.

A command names groups of them, and receives what each makes of those that were given:

    @generated(model=ModelOptions("fit"), settings=SamplerOptions())
    def fit(..., *, model: ChosenModel, settings: dict[str, Any]) -> None
"""

import functools
import inspect
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import NoneType
from typing import Annotated, Any, Literal, Protocol, get_args, get_origin, runtime_checkable

import typer

from yeastfit.errors import InputError

PLAIN = (bool, int, float, str)


@dataclass(frozen=True)
class Option:
    """One option.

    Attributes:
        name: As in Python.
        kind: bool, int, float or str.
        help: One line.
        panel: Under which heading `--help` has it.
        flags: All its names on the command line, with dashes.
        shown: Its default for `--help`; empty for none.
        choices: What it may be, or a word for it, as `--help` shows it.
        completed: What the Tab key offers, where that is more than `choices`.
        hidden: Whether `--help` leaves it out.
    """

    name: str
    kind: type
    help: str
    panel: str
    flags: tuple[str, ...] = ()
    shown: str = ""
    choices: tuple[str, ...] = ()
    completed: tuple[str, ...] = ()
    hidden: bool = False

    @property
    def annotation(self) -> Any:
        """For typer: None where it is not given."""
        option = typer.Option(
            *(self.flags or (flag_of(self.name),)),
            help=f"{self.help} Default: {self.shown}." if self.shown else self.help,
            show_default=False,
            rich_help_panel=self.panel,
            metavar="|".join(self.choices) or None,
            hidden=self.hidden,
            autocompletion=completion(self.completed or self.choices),
        )
        return Annotated[self.kind | None, option]


def completion(values: Iterable[str]) -> Callable[[str], list[str]] | None:
    """What the Tab key offers for the beginning of a value; None where nothing is known."""
    known = tuple(values)
    return (lambda incomplete: [one for one in known if one.startswith(incomplete)]) if known else None


@runtime_checkable
class Group(Protocol):
    """Options that are read together."""

    def options(self, arguments: Sequence[str]) -> list[Option]:
        """Those of a command line, whose arguments may decide which there are."""

    def read(self, given: Mapping[str, Any]) -> Any:
        """What the command receives, from those that were given."""


class Generated:
    """A command with groups of generated options; made by `generated`."""

    __name__: str

    def __init__(self, command: Callable[..., None], groups: Mapping[str, Group]) -> None:
        self.command, self.groups = command, groups
        self.__name__, self.__doc__ = command.__name__, command.__doc__

    def called_with(self, arguments: Sequence[str]) -> Callable[..., None]:
        """The command with the options of one command line, for typer.

        Raises:
            InputError: One of them is called like an option that the command has anyway.
        """
        own = [one for name, one in inspect.signature(self.command).parameters.items() if name not in self.groups]
        taken = {one.name for one in own}.union(*(_flags(one) for one in own))
        owners = dict[str, str]()
        options = list[Option]()
        for group, each in self.groups.items():
            for one in each.options(arguments):
                names = {one.name, *(one.flags or (flag_of(one.name),))}
                if taken & names:
                    raise taken_name(one, self.__name__.replace("_", "-"))
                taken |= names
                owners[one.name] = group
                options.append(one)

        @functools.wraps(self.command)
        def called(**values: Any) -> None:
            given: dict[str, dict[str, Any]] = {name: {} for name in self.groups}
            for name in [name for name in values if name in owners]:
                value = values.pop(name)
                if value is not None:
                    given[owners[name]][name] = value
            self.command(**values, **{name: group.read(given[name]) for name, group in self.groups.items()})

        kind = inspect.Parameter.KEYWORD_ONLY
        more = [inspect.Parameter(one.name, kind, default=None, annotation=one.annotation) for one in options]
        together = [*(one.replace(kind=kind) for one in own), *more]
        called.__signature__ = inspect.Signature(together)  # type: ignore[attr-defined]
        called.__annotations__ = {one.name: one.annotation for one in together}
        return called


def generated(**groups: Group) -> Callable[[Callable[..., None]], Generated]:
    """Give a command groups of options, under the names of the arguments by which it receives them."""
    return lambda command: Generated(command, groups)


def with_options(command: Callable[..., None] | Generated, arguments: Sequence[str]) -> Callable[..., None]:
    """A command with the options that its arguments bring; as it is where it generates none."""
    return command.called_with(arguments) if isinstance(command, Generated) else command


def taken_name(option: Option, command: str) -> InputError:
    """That a setting or parameter of somebody's own is called like an option that a command has."""
    return InputError(
        f"{option.name!r} ({option.help}) is a setting or parameter called like an option that yeastfit {command} has "
        f"anyway, {flag_of(option.name)}: rename it"
    )


def _flags(parameter: inspect.Parameter) -> set[str]:
    """Of a command's own option: those that it is declared with, or that of its name."""
    declared = [flag for one in get_args(parameter.annotation)[1:] for flag in getattr(one, "param_decls", None) or ()]
    return {part for flag in declared or [flag_of(parameter.name)] for part in flag.split("/")}


def flag_of(name: str) -> str:
    """The option of a name."""
    return f"--{name.replace('_', '-')}"


def plain_kind(hint: Any) -> tuple[Any, tuple[str, ...]]:
    """The type of an option, and its choices; None where the command line cannot give such a value.

    Numbers in a tuple are given as text, with commas.
    """
    if get_origin(hint) is Literal:
        return str, get_args(hint)
    parts = [one for one in get_args(hint) or (hint,) if one is not NoneType]
    for part in parts:
        if get_origin(part) is Literal:
            return str, get_args(part)
    if get_origin(hint) is tuple:
        return str, ()
    return (parts[0], ()) if len(parts) == 1 and parts[0] in PLAIN else (None, ())


@functools.cache
def hints_of(kind: type) -> dict[str, Any]:
    """Types of a class's fields, without what is annotated."""
    return typing.get_type_hints(kind)
