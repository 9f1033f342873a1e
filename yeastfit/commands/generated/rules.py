"""Options for the rules that the algebraic model is composed of: which, their settings, and what they bring."""

import dataclasses
import functools
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from yeastfit.commands.generated.options import Option, flag_of, hints_of, plain_kind
from yeastfit.errors import InputError
from yeastfit.model.model import BASES, RULES, Model, check_registered
from yeastfit.model.parameters import PARAMETERS
from yeastfit.model.rules import Rule
from yeastfit.parameter_set import Parameter
from yeastfit.simulation.recipe import Recipe

PANEL, PARAMETER_PANEL = "Rules of the model", "Model parameters"

Brought = tuple[Parameter, tuple[str, ...]]
"""A parameter, and the options that choose a rule which brings it; none where every model has it."""


class RecipeOptions:
    """Rules and parameters of a recipe, for `synthesize`; the command receives what is to be changed of one."""

    def options(self, arguments: Sequence[str]) -> list[Option]:
        """Of all rules and all parameters."""
        known: dict[str, Brought] = {name: (one, ()) for name, one in PARAMETERS.items()}
        return [*rule_options(), *parameter_options(known | rule_parameters())]

    def read(self, given: Mapping[str, Any]) -> Callable[[Recipe], Recipe]:
        """A function that changes a recipe; it raises `InputError` for what its rules do not have."""
        values = {name: value for name, value in given.items() if name in PARAMETERS or name in rule_parameters()}

        def changed(recipe: Recipe) -> Recipe:
            model = rules_from(given, recipe.model)
            check_brought(values, model)
            for name in recipe.parameters:
                if name not in model.parameters:
                    owners = " or ".join(rule_parameters()[name][1])
                    raise InputError(f"the recipe has {name}, a parameter of {owners}: choose that rule, or edit it")
            return replace(recipe, model=model, parameters={**recipe.parameters, **values})

        return changed


def rule_options() -> list[Option]:
    """An option for each question, and one for each setting of a rule, named after its question."""
    found, defaults = dict[str, Option](), Model().rules
    for question, base in BASES.items():
        names, default = _choosable(question), defaults[question].name
        each = "; ".join(f"{name} – {_first_clause(rule)}" for name, rule in names.items())
        text = f"{_first_clause(base)}. {each}."
        found[question] = Option(question, str, text, PANEL, (), default, ("RULE",), tuple(names))
        for rule in names.values():
            for setting, kind in _settings(rule).items():
                option = f"{question}_{setting}"
                text = f"{_described(rule, setting)} Of {flag_of(question)} {' and '.join(_owners(question)[setting])}."
                found.setdefault(option, Option(option, kind, text, PANEL))
    return list(found.values())


def parameter_options(known: Mapping[str, Brought], *, defaults: bool = False) -> list[Option]:
    """An option for each parameter, with the rules that bring it."""
    found = list[Option]()
    for name, (one, owners) in known.items():
        low, high = one.plausible
        unit, brought = f" {one.unit}" if one.unit else "", f" Of {' and '.join(owners)}." if owners else ""
        text = f"{one.symbol}, {one.meaning}. Plausible: {low:g} to {high:g}{unit}.{brought}"
        found.append(Option(name, float, text, PARAMETER_PANEL, shown=f"{one.default:g}" if defaults else ""))
    return found


def check_brought(values: Iterable[str], model: Model) -> None:
    """Raise `InputError` for a parameter that no rule of a model brings, or that has no effect with its rules."""
    for name in values:
        check_effective(name, flag_of(name), model)
        if name not in model.parameters:
            _, owners = rule_parameters()[name]
            raise InputError(
                f"{flag_of(name)} is a parameter of {' or '.join(owners)}: choose that rule, or leave it out"
            )


def check_effective(name: str, what: str, model: Model) -> None:
    """Raise `InputError` for a parameter that has no effect with one of a model's rules."""
    for question, rule in model.rules.items():
        if name in rule.idle:
            raise InputError(f"{what} has no effect with {flag_of(question)} {rule.name}: leave it out")


def rule_parameters() -> dict[str, Brought]:
    """What rules bring by name, with the options that choose a rule which brings it."""
    found = dict[str, Brought]()
    for question in BASES:
        for name, rule in _choosable(question).items():
            for one in rule.parameters:
                if one.name in PARAMETERS:
                    continue
                _, owners = found.get(one.name, (one, ()))
                found[one.name] = one, (*owners, f"{flag_of(question)} {name}")
    return found


def rules_from(options: Mapping[str, Any], base: Model | None = None) -> Model:
    """The model that options ask for; for other questions the rules of `base`, or the source's.

    Raises:
        InputError: A rule is unknown, or a setting is not one of the rule that is chosen.
    """
    described = (base or Model()).asdict()
    for question in BASES:
        known = _choosable(question)
        if question in options:
            if options[question] not in known:
                raise InputError(f"{flag_of(question)} is {options[question]!r}, it must be one of {', '.join(known)}")
            described[question] = {"rule": options[question]}
        rule = described[question]["rule"]
        for name, owners in _owners(question).items():
            if (option := f"{question}_{name}") in options:
                if rule not in owners:
                    wanted = " or ".join(f"{flag_of(question)} {one}" for one in owners)
                    raise InputError(f"{flag_of(option)} is a setting of {wanted}: choose that rule, or leave it out")
                described[question][name] = options[option]
    return Model.of(described)


def _choosable(question: str) -> dict[str, type[Rule]]:
    """Rules by name that can be made from numbers and words."""
    for name in RULES[question]:
        check_registered(question, name)
    return {name: rule for name, rule in RULES[question].items() if not _needed(rule) - set(_settings(rule))}


@functools.cache
def _needed(rule: type[Rule]) -> set[str]:
    """Fields without a default."""
    return {
        one.name
        for one in dataclasses.fields(rule)
        if one.default is dataclasses.MISSING and one.default_factory is dataclasses.MISSING
    }


@functools.cache
def _settings(rule: type[Rule]) -> dict[str, type]:
    """Types of the fields that the command line can give."""
    hints = hints_of(rule)
    kinds = {one.name: plain_kind(hints[one.name])[0] for one in dataclasses.fields(rule)}
    return {name: kind for name, kind in kinds.items() if kind is not None}


def _owners(question: str) -> dict[str, list[str]]:
    """Names of rules by the settings that they have."""
    found = dict[str, list[str]]()
    for name, rule in _choosable(question).items():
        for setting in _settings(rule):
            found.setdefault(setting, []).append(name)
    return found


@functools.cache
def _first_clause(kind: type) -> str:
    """Of its docstring."""
    paragraph = (inspect.getdoc(kind) or "").partition("\n\n")[0]
    return re.split(r"[.;](?: |$)", " ".join(paragraph.split()))[0]


@functools.cache
def _described(rule: type[Rule], setting: str) -> str:
    """What the docstring of a rule, or of one that it inherits from, says of one of its attributes."""
    docstrings = (inspect.cleandoc(kind.__doc__ or "") for kind in rule.__mro__)
    found = (re.search(rf"^    {setting}: (.*(?:\n        .*)*)", text, re.MULTILINE) for text in docstrings)
    return next((" ".join(one[1].split()) for one in found if one), "")
