"""Options of `yeastfit infer` that follow from what is registered: settings of samplers, parameters of models."""

import functools
import inspect
import typing
from collections.abc import Callable
from dataclasses import MISSING, Field, fields
from types import NoneType
from typing import Annotated, Any, Literal, get_args

import typer

from yeastfit.inference.forward_models import FORWARD_MODELS
from yeastfit.inference.posterior.settings import Setting
from yeastfit.inference.samplers import SAMPLERS

PLAIN = (bool, int, float, str)


class WithGeneratedOptions:
    """A command that also takes an option for each setting of a sampler and each parameter of a model.

    It receives those that are given in two dictionaries, `settings` and `fixed`. Typer asks for the signature whenever
    the command line is run, so that whatever is registered by then has its options.
    """

    __name__: str

    def __init__(self, command: Callable[..., None]) -> None:
        functools.update_wrapper(self, command, assigned=("__module__", "__name__", "__qualname__", "__doc__"))
        self.command = command

    def __call__(self, **options: Any) -> None:
        """Run the command."""
        settings, fixed = ({name: options.pop(name, None) for name in names} for names in (_settings(), _parameters()))
        chosen = ({name: value for name, value in each.items() if value is not None} for each in (settings, fixed))
        self.command(**options, **dict(zip(("settings", "fixed"), chosen, strict=True)))

    @property
    def __signature__(self) -> inspect.Signature:
        own = [
            one for name, one in inspect.signature(self.command).parameters.items() if name not in ("settings", "fixed")
        ]
        generated = {**_parameters(), **_settings()}
        kind = inspect.Parameter.KEYWORD_ONLY
        more = [inspect.Parameter(name, kind, default=None, annotation=one) for name, one in generated.items()]
        return inspect.Signature([*(one.replace(kind=kind) for one in own), *more])

    @property
    def __annotations__(self) -> dict[str, Any]:  # type: ignore[override]
        return {name: one.annotation for name, one in self.__signature__.parameters.items()}


def extending(method: str) -> tuple[str, ...]:
    """Settings of a method that merely make a run longer."""
    return tuple(name for name, (_, one) in _fields(method).items() if one.extends)


def _fields(method: str) -> dict[str, tuple[Field, Setting]]:
    """A sampler's fields, with what is said of them."""
    hints = typing.get_type_hints(SAMPLERS[method], include_extras=True)
    annotated = {one.name: getattr(hints[one.name], "__metadata__", ()) for one in fields(SAMPLERS[method])}  # type: ignore[arg-type]
    return {
        one.name: (one, next((data for data in annotated[one.name] if isinstance(data, Setting)), Setting("")))
        for one in fields(SAMPLERS[method])  # type: ignore[arg-type]
    }


def _settings() -> dict[str, Any]:
    """Annotations of the settings' options, each of all methods that have it."""
    options = dict[str, Any]()
    for method in SAMPLERS:
        hints = typing.get_type_hints(SAMPLERS[method])
        for name, (_, setting) in _fields(method).items():
            kind, choices = _plain(hints[name])
            if kind is None or name in options:
                continue
            flags = [f"--{one.replace('_', '-')}" for one in (name, *setting.aliases)]
            flags = [f"{flag}/--no-{flag[2:]}" for flag in flags] if kind is bool else flags
            help = f"{setting.help} {_defaults(name)}".strip()
            option = typer.Option(
                *flags,
                help=help,
                show_default=False,
                rich_help_panel="Settings of the method",
                metavar="|".join(choices) or None,
            )
            options[name] = Annotated[kind | None, option]
    return options


def _defaults(name: str) -> str:
    """Methods that have a setting, with their defaults."""
    owners = {method: _fields(method)[name][0].default for method in SAMPLERS if name in _fields(method)}
    each = [method if one in (None, MISSING) else f"{method} {one}" for method, one in owners.items()]
    return f"({', '.join(each)})"


def _plain(hint: Any) -> tuple[Any, tuple[str, ...]]:
    """The type of an option, and its choices; None where the command line cannot give such a value."""
    parts = [one for one in get_args(hint) or (hint,) if one is not NoneType]
    if typing.get_origin(hint) is Literal:
        return str, get_args(hint)
    for part in parts:
        if typing.get_origin(part) is Literal:
            return str, get_args(part)
    return (parts[0], ()) if len(parts) == 1 and parts[0] in PLAIN else (None, ())


def _parameters() -> dict[str, Any]:
    """Annotations of the options that hold parameters."""
    options = dict[str, Any]()
    for model in FORWARD_MODELS.values():
        for name, one in model.parameters.items():
            low, high = one.plausible
            text = f"{one.symbol}: {one.meaning}; {one.default:g} by default, plausible {low:g} to {high:g}."
            panel = "Parameters of the model, where they are not free"
            flag = f"--{name.replace('_', '-')}"
            options.setdefault(
                name, Annotated[float | None, typer.Option(flag, help=text, show_default=False, rich_help_panel=panel)]
            )
    return {name: one for name, one in options.items() if name not in _settings()}
