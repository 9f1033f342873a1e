"""A colony model: one rule for each question, and the parameters that they bring.

    Model()                                   the source's model (docs/model.md)
    Model(budding=MyRule(), death=Other())    two rules exchanged

`simulate`, fits, sensitivities, posteriors and `synthesize` take a model; none of them asks which rules it holds.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from yeastfit.errors import InputError
from yeastfit.model.cells import Cells
from yeastfit.model.colony import Colony, start
from yeastfit.model.laws.budding import TurnedBudding, UniformBudding
from yeastfit.model.laws.contact import NodeContact
from yeastfit.model.laws.death import NoDeath
from yeastfit.model.laws.detachment import NoDetachment
from yeastfit.model.laws.fluctuations import NoFluctuation
from yeastfit.model.laws.forces import TreeSprings
from yeastfit.model.laws.growth import GlobalBirths
from yeastfit.model.laws.medium import OneNutrient
from yeastfit.model.laws.motion import DrivenMotion
from yeastfit.model.laws.shape import EllipticalCells
from yeastfit.model.laws.uptake import BiomassUptake
from yeastfit.model.mechanisms import every_rule
from yeastfit.model.numerics import Numerics
from yeastfit.model.parameters import PARAMETERS, Parameters
from yeastfit.model.relaxation import Relaxation
from yeastfit.model.rule_settings import in_a_file
from yeastfit.model.rules import (
    BirthRule,
    BuddingRule,
    ContactRule,
    Context,
    DeathRule,
    DetachmentRule,
    FluctuationRule,
    MediumRule,
    MotionRule,
    Rule,
    ShapeRule,
    SpringRule,
    UptakeRule,
)
from yeastfit.parameter_set import Parameter, ParameterSet
from yeastfit.specification import path_of
from yeastfit.text import quoted

BASES: dict[str, type[Rule]] = {
    base.question: base
    for base in (
        BirthRule,
        BuddingRule,
        ContactRule,
        UptakeRule,
        DeathRule,
        MotionRule,
        FluctuationRule,
        DetachmentRule,
        ShapeRule,
        MediumRule,
        SpringRule,
    )
}
"""The base class of the rules of each question."""

RULES: dict[str, dict[str, type[Rule]]] = {question: {} for question in BASES}
"""Rules by question and name, for recipes, files and the command line. A rule of one's own may be added."""
_SOURCE: list[type[Rule]] = [GlobalBirths, UniformBudding, TurnedBudding, NodeContact, BiomassUptake, NoDeath]
_SOURCE += [DrivenMotion, NoFluctuation, NoDetachment, EllipticalCells, OneNutrient, TreeSprings]
for _rule in _SOURCE + every_rule():
    if (_other := RULES[_rule.question].setdefault(_rule.name, _rule)) is not _rule:
        raise InputError(f"{_rule.question}: rule {_rule.name!r} is in {_other.__module__} and in {_rule.__module__}")


class Model(eqx.Module):
    """A rule for each question; by default the source's.

    Attributes:
        births: Who buds, and when.
        budding: In which direction a child appears.
        contact: How nodes push each other apart.
        uptake: How fast cells take up nutrient.
        death: What becomes of nodes.
        motion: Where a step takes a node, given its velocity.
        fluctuations: What disturbs the nutrient.
        detachment: Which cells let go of their mothers.
        shape: What outline a cell has.
        medium: What cells live on.
        springs: Which nodes cells hold together.

    Raises:
        InputError: What is given for a question is no rule for it, or two rules exclude each other, or bring different
            parameters or two kinds of state under one name.
    """

    births: BirthRule = GlobalBirths()
    budding: BuddingRule = UniformBudding()
    contact: ContactRule = NodeContact()
    uptake: UptakeRule = BiomassUptake()
    death: DeathRule = NoDeath()
    motion: MotionRule = DrivenMotion()
    fluctuations: FluctuationRule = NoFluctuation()
    detachment: DetachmentRule = NoDetachment()
    shape: ShapeRule = EllipticalCells()
    medium: MediumRule = OneNutrient()
    springs: SpringRule = TreeSprings()

    def __check_init__(self) -> None:
        for question, rule in self.rules.items():
            if not isinstance(rule, BASES[question]):
                made = f": write {rule.__name__}()" if isinstance(rule, type) else ""
                raise InputError(f"{question} is {rule!r}, it must be of the class {BASES[question].__name__}{made}")
            if not hasattr(rule, "name"):
                raise InputError(f"{question} is {rule!r}, which has no name: files and warnings call a rule by one")
        for part in self.parts:
            check_name(type(part))
            if not (isinstance(part.parameters, tuple) and all(isinstance(one, Parameter) for one in part.parameters)):
                raise InputError(
                    f"{part.question}: parameters of rule {part.name!r} are {quoted(part.parameters)}, they must be a "
                    "tuple of yeastfit.Parameter, with a comma after a single one"
                )
        for question, rule in self.rules.items():
            objection = rule.objection(self.rules)
            if objection:
                raise InputError(f"{question}: rule {rule.name!r} {objection}")
        states = [name for rule in self.parts for name in rule.node_state()]
        twice = sorted({name for name in states if states.count(name) > 1})
        if twice:
            raise InputError(f"model: two of its rules keep a node state {twice[0]!r}")
        for rule in self.parts:
            _check_alike(rule, self.parts, "model")

    @property
    def rules(self) -> dict[str, Rule]:
        """By question."""
        return {question: getattr(self, question) for question in BASES}

    @property
    def parts(self) -> tuple[Rule, ...]:
        """All rules, with those that they build on."""
        return tuple(part for rule in self.rules.values() for part in rule.parts)

    @property
    def parameters(self) -> ParameterSet:
        """λ1 … λ7, and what the rules bring; a parameter that two rules bring alike is there once."""
        brought = dict.fromkeys(one for rule in self.parts for one in rule.parameters)
        return PARAMETERS + [one for one in brought if one not in PARAMETERS.parameters]

    def complete(self, parameters: Parameters) -> Parameters:
        """Values of exactly this model's parameters, checked, with defaults for those that rules bring.

        Raises:
            InputError: A value belongs to no rule of this model, or is not admissible.
        """
        self.check_brought(parameters.values)
        return parameters.within(self.parameters)

    def check_brought(self, names: Iterable[str]) -> None:
        """Raise `InputError` for a parameter that other rules bring."""
        for name in names:
            owners = [] if name in self.parameters else bringing(name)
            if owners:
                raise InputError(f"{name} is a parameter of {' or '.join(owners)}: choose that rule, or leave it out")

    def node_state(self) -> dict[str, float]:
        """What the rules keep for each node: values of a newborn, by name."""
        return {name: value for rule in self.parts for name, value in rule.node_state().items()}

    def advance(self, context: Context) -> dict[str, Float[Array, " node"]]:
        """The state of all nodes one time step later.

        Raises:
            InputError: A rule answers with another state than it keeps, or one of another shape.
        """
        found = dict[str, Float[Array, " node"]]()
        for rule in self.parts:
            answer, kept = rule.advance(context), rule.node_state()
            if not isinstance(answer, dict) or set(answer) != set(kept):
                got = ", ".join(map(str, answer)) if isinstance(answer, dict) else type(answer).__name__
                raise InputError(
                    f"{rule.question}: advance of rule {rule.name!r} gave {got or 'nothing'}, it must give its state "
                    f"of nodes by name: {', '.join(kept) or 'nothing'}"
                )
            found |= {name: rule.answered(value, context.colony.weights.shape) for name, value in answer.items()}
        return found

    def start(self, key: Array, numerics: Numerics) -> Colony:
        """A new colony of two nodes.

        Arguments:
            key: Of the colony; all its random numbers derive from it.
            numerics: Grid and capacity.

        Returns:
            The colony, with what the rules and the medium keep.
        """
        grid = (numerics.points,) * 2
        fields = {name: jnp.full(grid, value, jnp.result_type(float)) for name, value in self.medium.fields().items()}
        return start(key, numerics, self.node_state(), {**fields, **self.medium.store(key, numerics)})

    def cells(self, colony: Colony, parameters: Parameters, relaxation: Relaxation) -> Cells:
        """Cells of a colony, as they cover the plane. Differentiable.

        Arguments:
            colony: Its state.
            parameters: Values of all the model's parameters.
            relaxation: Smoothing widths.

        Returns:
            One cell for each node but the first; of what dies by degrees and vanishes what is left.
        """
        return self.death.shown(self.shape.cells(colony, parameters), colony, relaxation)

    def resumed(self, colony: Colony) -> Colony:
        """A colony, or an ensemble, with the state that these rules keep; where it has none, that of newborns.

        Raises:
            InputError: The medium, or a rule `from_start`, keeps what a colony of another model does not have.
        """
        for rule in self.parts:
            lacking = [name for name in rule.node_state() if name not in colony.node_state]
            if rule.from_start and lacking:
                raise InputError(
                    f"{rule.question}: rule {rule.name!r} cannot go on from a colony of other {rule.question}, without "
                    f"{lacking[0]}: grow one by it from the start"
                )
        colony = jax.tree.map(_in_this_precision, colony)
        medium = {name: jnp.full_like(colony.nutrient, value) for name, value in self.medium.fields().items()}
        kept = {name: colony.medium.get(name, value) for name, value in medium.items()}
        for name in self.medium.keeps:
            if name not in colony.medium:
                raise InputError(
                    f"medium: rule {self.medium.name!r} cannot go on from a colony of another medium, without {name}"
                )
            kept[name] = colony.medium[name]
        full = {name: jnp.full_like(colony.weights, value) for name, value in self.node_state().items()}
        return dataclasses.replace(
            colony,
            node_state={name: colony.node_state.get(name, value) for name, value in full.items()},
            medium=kept,
        )

    def asdict(self) -> dict[str, dict[str, Any]]:
        """Names of the rules and their settings by question, for files; `Model.of` reads them.

        Raises:
            InputError: A setting is nothing that a file can keep, such as a function.
        """
        return {question: _described(rule) for question, rule in self.rules.items()}

    @staticmethod
    def of(rules: Mapping[str, Mapping[str, Any]]) -> "Model":
        """From names of registered rules (`RULES`) and their settings.

        Arguments:
            rules: By question, as in `{"budding": {"rule": "uniform"}}`; the source's rule where a question is missing.

        Raises:
            InputError: There is no such question, rule or setting.
        """
        for question in rules:
            if question not in BASES:
                raise InputError(f"model: question {question!r} is unknown, expected some of {', '.join(BASES)}")
        return Model(**{question: _rule_of(question, settings) for question, settings in rules.items()})  # type: ignore[arg-type]


def bringing(name: str) -> list[str]:
    """The registered rules that bring a parameter, as in "budding 'biased'"."""
    return [
        f"{question} {rule.name!r}"
        for question, rules in RULES.items()
        for rule in rules.values()
        if name in [one.name for one in rule.parameters]
    ]


def check_registered(question: str, name: str) -> None:
    """Raise `InputError` where what is registered under a name is no class of that name, or brings what is not its own.

    Parameters that several rules bring must be alike: they are one option, one prior and one column of a table.
    """
    rule = RULES[question][name]
    if not isinstance(rule, type):
        raise InputError(f"{question}: rule {name!r} is registered as an object, RULES holds classes of rules")
    if getattr(rule, "name", name) != name:
        raise InputError(f"{question}: rule {rule.name!r} is registered as {name!r}, register it under its own name")
    if not rule.__module__.startswith("yeastfit."):
        _check_alike(rule, [other for rules in RULES.values() for other in rules.values()], question)


def check_name(rule: type[Rule]) -> None:
    """Raise `InputError` where another rule is registered under the name of one that is not the package's.

    By their names files, other processes and the command line find rules. A class defined anew, as when a notebook's
    cell is run again, is the same rule.
    """
    other = RULES[rule.question].get(rule.name)
    if other is None or rule.__module__.startswith("yeastfit.") or path_of(rule) == path_of(other):
        return
    raise InputError(
        f"{rule.question}: {rule.__name__} is called {rule.name!r}, as {other.__name__} of {other.__module__} is: "
        "choose another name"
    )


def _check_alike(rule: Rule | type[Rule], others: Iterable[Rule | type[Rule]], where: str) -> None:
    """Raise `InputError` for a parameter that the model or another rule brings, too, and means something else by."""
    brought = [("the model", PARAMETERS.parameters), *((f"rule {other.name!r}", other.parameters) for other in others)]
    for one in rule.parameters:
        for whose, parameters in brought:
            if any(other.name == one.name and other != one for other in parameters):
                raise InputError(
                    f"{where}: rule {rule.name!r} brings a parameter {one.name!r}, and so does {whose}, another one: "
                    "choose another name"
                )


def _in_this_precision(leaf: Any) -> Any:
    """An array that was made in double precision, where that is off now, in single precision."""
    if isinstance(leaf, jax.core.Tracer) or jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        return leaf
    dtype = jax.dtypes.canonicalize_dtype(leaf.dtype)
    return leaf if leaf.dtype == dtype else jnp.asarray(np.asarray(leaf).astype(dtype))


def _described(rule: Rule) -> dict[str, Any]:
    names = [each.name for each in dataclasses.fields(rule)]
    held = {name: getattr(rule, name) for name in names}
    plain = {name: _described(one) if isinstance(one, Rule) else in_a_file(rule, name) for name, one in held.items()}
    return {"rule": rule.name, **plain}


def _rule_of(question: str, settings: Any) -> Rule:
    if not isinstance(settings, Mapping) or "rule" not in settings:
        raise InputError(f"{question} is {quoted(settings)}, expected a table that names its rule")
    name, known = settings["rule"], RULES[question]
    if not isinstance(name, str) or name not in known:
        raise InputError(f"{question}: rule {quoted(name)} is unknown, expected one of {', '.join(known)}")
    check_registered(question, name)
    given = {
        key: _rule_of(question, value) if isinstance(value, Mapping) else value
        for key, value in settings.items()
        if key != "rule"
    }
    admissible = [each.name for each in dataclasses.fields(known[name])]
    for key in given:
        if key not in admissible:
            raise InputError(f"{question}: rule {name!r} has no setting {key!r}, it has {admissible or 'none'}")
    try:
        return known[name](**given)
    except TypeError as error:
        raise InputError(f"{question}: rule {name!r}: {error}") from None
