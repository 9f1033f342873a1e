"""Options of a forward model: which one, its settings, its rules, and the parameters that it and the rules have."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from typing import Annotated, Any, get_origin

import typer

from yeastfit.commands.generated.options import Option, flag_of, hints_of, plain_kind, taken_name
from yeastfit.commands.generated.rules import (
    Brought,
    check_brought,
    check_effective,
    parameter_options,
    rule_options,
    rule_parameters,
    rules_from,
)
from yeastfit.commands.options import SMOOTH, numbers_in
from yeastfit.errors import InputError
from yeastfit.inference.models.forward_model import ForwardModel, settings_of
from yeastfit.inference.models.registry import DEFAULT, FORWARD_MODELS, model_named
from yeastfit.model.model import Model

PANEL = "Model"


def _free(default: Callable[[type[ForwardModel]], Sequence[str]]) -> Any:
    """The option --free, which says what is free by default."""
    by_model = "; ".join(f"{', '.join(default(one))} for {name}" for name, one in FORWARD_MODELS.items())
    words = f"Names of the free parameters, with commas; the others keep the values given below. By default {by_model}."
    return typer.Option(help=words, show_default=False)


Fitted = Annotated[str | None, _free(lambda model: model.fitted or model.free)]
Inferred = Annotated[str | None, _free(lambda model: model.free)]


def _statistics(default: Callable[[type[ForwardModel]], Sequence[str]]) -> Any:
    """The option --statistics, which says what is compared by default."""
    by_model = "; ".join(f"{', '.join(default(one))} for {name}" for name, one in FORWARD_MODELS.items())
    words = (
        f"Statistics that are compared, with commas: {SMOOTH}, or any other column of measurements.csv that the model "
        "has; of the off-lattice model li2024 stands for the indices of Li et al. 2024, texture for nine of shape and "
        f"texture. By default {by_model}."
    )
    return typer.Option(help=words, show_default=False)


Statistics = Annotated[str | None, _statistics(lambda model: model.statistics)]
DesignedStatistics = Annotated[str | None, _statistics(lambda model: model.designed)]


@dataclass(frozen=True)
class ChosenModel:
    """The model that a command line names.

    Attributes:
        name: In `FORWARD_MODELS`.
        forward: The model with its settings.
        values: Of parameters, as far as they are given.
        given: Names of all its options that are given.
    """

    name: str
    forward: ForwardModel
    values: dict[str, float]
    given: tuple[str, ...]

    def check_free(self, free: Sequence[str]) -> None:
        """Raise `InputError` for a free parameter that has a value, or no effect with the model's rules."""
        for name in free:
            if isinstance(rules := getattr(self.forward, "rules", None), Model):
                check_effective(name, f"--free: {name}", rules)
            if name in self.values:
                raise InputError(
                    f"{flag_of(name)} is {self.values[name]:g}, but {name} is free: leave out the value, or hold it by "
                    "--free with the names of the others"
                )

    def configuration(self, command: str) -> dict[str, Any]:
        """Which model, and its settings, for a manifest."""
        return {"model": self.name, **self.forward.settings(command)}


@dataclass(frozen=True)
class ModelOptions:
    """Options of a command for a model; the command receives a `ChosenModel`.

    Attributes:
        command: Its name.
        only: Name of the only model that the command takes; None for any, by --model.
    """

    command: str
    only: str | None = None

    def options(self, arguments: Sequence[str]) -> list[Option]:
        """Those of the model that is named; hidden, those of the others."""
        name = self.only or _named_in(arguments) or DEFAULT
        kind = model_named(name)
        if self.only:
            return list(self._of(kind).values())
        each = {model: self._of(kind) for model, kind in FORWARD_MODELS.items()}
        own = each[name]
        others = {key: replace(option, hidden=True) for model in each.values() for key, option in model.items()}
        choices = f"Which model grows the colonies; with --help after it, its options. {', '.join(FORWARD_MODELS)}."
        which = Option("model", str, choices, PANEL, (), DEFAULT, ("NAME",), tuple(FORWARD_MODELS))
        return [which, *({**others, **own}[key] for key in {**own, **others})]

    def read(self, given: Mapping[str, Any]) -> ChosenModel:
        """The model with its settings, and values of its parameters.

        Raises:
            InputError: A model, a rule or an option is unknown, or is not one of this model and these rules; or a value
                is not admissible.
        """
        name = self.only or given.get("model", DEFAULT)
        kind, options = model_named(name), dict(given)
        options.pop("model", None)
        own = self._of(kind)
        for option in options:
            if option not in own:
                raise InputError(f"{flag_of(option)} is an option of --model {self._owners(option)}, not of {name}")
        settings = self._settings(kind, options)
        forward = kind(**settings)
        values = {option: value for option, value in options.items() if option not in settings_of(kind, self.command)}
        values = {option: value for option, value in values.items() if option in self._parameters(kind)}
        for rules in (one for one in settings.values() if isinstance(one, Model)):
            check_brought(values, rules)
        forward.parameters.check(values)
        return ChosenModel(name, forward, values, tuple(options))

    def _settings(self, kind: type[ForwardModel], options: Mapping[str, Any]) -> dict[str, Any]:
        """Values of a model's settings: those given, and the command's own defaults."""
        found, hints = dict[str, Any](), hints_of(kind)
        for name, setting in settings_of(kind, self.command).items():
            if hints[name] is Model:
                found[name] = rules_from(options)
            elif name in options:
                value, several = options[name], get_origin(hints[name]) is tuple
                found[name] = tuple(numbers_in(flag_of(name), value)) if several else value
            elif self.command in setting.defaults:
                found[name] = setting.defaults[self.command]
        return found

    def _of(self, kind: type[ForwardModel]) -> dict[str, Option]:
        """All options of one model by name."""
        found, hints = dict[str, Option](), hints_of(kind)
        for name, setting in settings_of(kind, self.command).items():
            if hints[name] is Model:
                found |= {one.name: one for one in rule_options()}
                continue
            plain, choices = plain_kind(hints[name])
            if plain is None:
                continue
            flags = tuple(flag_of(one) for one in (name, *setting.aliases))
            if plain is bool:
                flags = (f"{flags[0]}/--{setting.negative or 'no-' + name.replace('_', '-')}",)
            shown = _shown(setting.defaults.get(self.command, _default(kind, name)))
            found[name] = Option(name, plain, setting.help, PANEL, flags, shown, choices)
        for one in parameter_options(self._parameters(kind), defaults=True):
            if one.name in found:
                raise taken_name(one, self.command)
            found[one.name] = one
        return found

    def _parameters(self, kind: type[ForwardModel]) -> dict[str, Brought]:
        """Parameters of a model by name, and the rules that bring them; those of any rule that may be chosen."""
        hints = hints_of(kind)
        found: dict[str, Brought] = {name: (one, ()) for name, one in kind().parameters.items()}
        if any(hints[name] is Model for name in settings_of(kind, self.command)):
            found |= rule_parameters()
        return found

    def _owners(self, option: str) -> str:
        return " or ".join(name for name, kind in FORWARD_MODELS.items() if option in self._of(kind))


def _default(kind: type[ForwardModel], name: str) -> Any:
    (one,) = (each for each in fields(kind) if each.name == name)
    return None if one.default is MISSING else one.default


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ",".join(_shown(one) for one in value)
    if value is None or isinstance(value, bool):
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _named_in(arguments: Sequence[str]) -> str | None:
    """The value of --model on a command line, where there is one."""
    for number, one in enumerate(arguments):
        if one.startswith("--model="):
            return one.partition("=")[2]
        if one == "--model" and number + 1 < len(arguments):
            return arguments[number + 1]
    return None
