"""Rules of a model as operations that numba has compiled, for colonies that are grown and not differentiated."""

import dataclasses
from typing import Any

from yeastfit.model.compiled import operations
from yeastfit.model.compiled.contact import CompiledNodeContact
from yeastfit.model.compiled.level_set import CompiledSnapshot
from yeastfit.model.compiled.medium import CompiledOneNutrient
from yeastfit.model.compiled.nitrogen import CompiledNitrogenMedium
from yeastfit.model.compiled.ranking import CompiledGlobalBirths
from yeastfit.model.compiled.springs import CompiledTreeSprings
from yeastfit.model.laws.contact import NodeContact
from yeastfit.model.laws.forces import TreeSprings
from yeastfit.model.laws.growth import GlobalBirths
from yeastfit.model.laws.medium import OneNutrient
from yeastfit.model.mechanisms.nitrogen_medium import NitrogenMedium
from yeastfit.model.model import Model
from yeastfit.model.rules import Rule
from yeastfit.model.snapshot import Snapshot

COMPILED: dict[type[Rule], type[Rule]] = {
    GlobalBirths: CompiledGlobalBirths,
    NitrogenMedium: CompiledNitrogenMedium,
    NodeContact: CompiledNodeContact,
    OneNutrient: CompiledOneNutrient,
    TreeSprings: CompiledTreeSprings,
}
"""What takes the place of a rule."""


def with_compiled_rules(model: Model) -> Model:
    """The same rules, compiled as far as they can be, where numba is installed and colonies grow on a CPU."""
    if not operations.are_possible():
        return model
    found: dict[str, Any] = {}
    for question, rule in model.rules.items():
        if compiled := COMPILED.get(type(rule)):
            found[question] = compiled(**{one.name: getattr(rule, one.name) for one in dataclasses.fields(rule)})
    return dataclasses.replace(model, **found)


def with_compiled_level_set(snapshot: Snapshot) -> Snapshot:
    """The same, whose cells are joined by a compiled function, under the same conditions."""
    return CompiledSnapshot.of(snapshot) if operations.are_possible() else snapshot
