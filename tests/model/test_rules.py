"""What a rule of one's own may get wrong, and what is said of it."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from yeastfit import (
    RULES,
    BuddingRule,
    ContactRule,
    Context,
    FluctuationRule,
    InputError,
    Model,
    MotionRule,
    Numerics,
    Parameter,
    Parameters,
    SpringRule,
    UptakeRule,
    member_keys,
    simulate,
)
from yeastfit.commands.generated.rules import rule_options
from yeastfit.model.colony import Colony
from yeastfit.model.laws.budding import TurnedBudding
from yeastfit.model.parameters import PARAMETERS
from yeastfit.model.rules import Rule

SMALL = Numerics(domain=8.0, spacing=0.4, capacity=8)


class OneAngle(BuddingRule):
    name = "one angle"

    def angles(self, context: Context, parents: Array, lineages: Array) -> Array:
        return jnp.zeros(())


class OnePull(SpringRule):
    name = "one pull"

    def pull(self, colony: Colony) -> Array:
        return jnp.zeros(2)

    def stiffness(self, colony: Colony) -> Array:
        return jnp.ones(())


class Sideways(ContactRule):
    name = "sideways"

    def velocity(self, context: Context, motion: Array) -> Array:
        return motion[:, 0]


class Still(MotionRule):
    name = "still"

    def moved(self, context: Context, velocity: Array) -> Array:
        return context.colony.positions[:-1]


class Flat(FluctuationRule):
    name = "flat"

    def shaken(self, context: Context) -> Array:
        return context.colony.nutrient[0]


class Everywhere(UptakeRule):
    name = "everywhere"

    def rate(self, context: Context, level_set: Array, nutrient: Array) -> Array:
        return context.parameters.metabolic_rate


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    "rule", [OneAngle(), Sideways(), OnePull(), Still(), Flat(), Everywhere()], ids=lambda rule: rule.name
)
def test_an_answer_of_another_shape_is_refused(rule: Rule) -> None:
    rules: dict[str, Any] = {rule.question: rule}
    said = rf"{rule.question}: rule '{rule.name}' gave an array of shape \(.*\), not \("
    with pytest.raises(InputError, match=said):
        simulate(Parameters(), member_keys(0, 1), times=[0.1], model=Model(**rules), numerics=SMALL)


class Leaning(BuddingRule):
    name = "leaning"
    parameters = (Parameter("budding_bias", "B", "another thing", (1.0, 9.0), 3.0),)

    def angles(self, context: Context, parents: Array, lineages: Array) -> Array:
        return jnp.zeros(parents.shape)


class Sliding(Leaning):
    name = "sliding"
    parameters = (Parameter("mobility", "B", "another thing", (1.0, 9.0), 3.0),)


def reaching(of: type[Rule]) -> type[BuddingRule]:
    """A rule with a parameter that is called like one of another rule."""
    parameter = Parameter(of.parameters[0].name, "B", "another thing", (1.0, 9.0), 3.0)
    return type("Reaching", (Leaning,), {"name": "reaching", "parameters": (parameter,)})


@pytest.mark.parametrize("of", [rule for rules in RULES.values() for rule in rules.values() if rule.parameters])
def test_no_rule_brings_a_parameter_of_another(of: type[Rule], monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever question that one answers, and if a third is called like it."""
    monkeypatch.setitem(RULES["budding"], "reaching", reaching(of))
    with pytest.raises(InputError, match=f"rule 'reaching' brings a parameter '{of.parameters[0].name}', and so does"):
        Model.of({"budding": {"rule": "reaching"}})


@pytest.mark.parametrize(
    ("question", "name", "rule", "said"),
    [
        ("budding", "mine", OneAngle, "rule 'one angle' is registered as 'mine', register it under its own name"),
        ("budding", "one angle", OneAngle(), "rule 'one angle' is registered as an object"),
        ("budding", "leaning", Leaning, "rule 'leaning' brings a parameter 'budding_bias', and so does rule 'biased'"),
        ("budding", "sliding", Sliding, "rule 'sliding' brings a parameter 'mobility', and so does the model, another"),
    ],
)
def test_a_rule_that_is_registered_wrong_is_refused(
    question: str, name: str, rule: Any, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(RULES[question], name, rule)
    with pytest.raises(InputError, match=said):
        Model.of({question: {"rule": name}})
    with pytest.raises(InputError, match=said):
        rule_options()


def test_parameters_of_one_name_are_one_parameter() -> None:
    with pytest.raises(
        InputError, match="rule 'sliding' brings a parameter 'mobility', and so does the model, another"
    ):
        Model(budding=Sliding())


def test_no_two_parameters_have_one_symbol() -> None:
    symbols = {info.symbol: {name} for name, info in PARAMETERS.items()}
    for kinds in RULES.values():
        for kind in kinds.values():
            if kind is not TurnedBudding:  # which needs turns, and brings no parameter
                for info in kind().parameters:
                    symbols.setdefault(info.symbol, set()).add(info.name)
    assert len(symbols) > 20
    assert {symbol: names for symbol, names in symbols.items() if len(names) > 1} == {}


def test_a_rule_of_ones_own_has_a_name_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files and other processes find rules by their names: they would take the package's."""

    class East(OneAngle):
        name = "uniform"

    with pytest.raises(
        InputError, match=r"budding: East is called 'uniform', as UniformBudding of yeastfit.* is: choose"
    ):
        Model(budding=East())
    first = East
    first.name = "east"
    monkeypatch.setitem(RULES["budding"], "east", first)

    class East(OneAngle):  # type: ignore[no-redef]  # a notebook's cell that is run again
        name = "east"

    assert Model(budding=East()).budding.name == "east"


class Counting(MotionRule):
    """A rule that keeps an age for each node."""

    name = "counting"
    answer: Any = None

    def node_state(self) -> dict[str, float]:
        return {"age": 0.0}

    def advance(self, context: Context) -> Any:
        return self.answer

    def moved(self, context: Context, velocity: Array) -> Array:
        return context.colony.positions


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "gave NoneType, it must give its state of nodes by name: age"),
        ({}, "gave nothing, it must give its state of nodes by name: age"),
        ({"age": jnp.zeros(8), "size": jnp.zeros(8)}, "gave age, size, it must give its state of nodes by name: age"),
        ({"age": jnp.zeros(2)}, r"gave an array of shape \(2,\), not \(8,\)"),
    ],
    ids=["none", "empty", "more", "shape"],
)
def test_a_state_of_another_kind_is_refused(answer: Any, said: str) -> None:
    with pytest.raises(InputError, match=rf"motion: .*rule 'counting' {said}"):
        simulate(Parameters(), member_keys(0, 1), times=[0.1], model=Model(motion=Counting(answer)), numerics=SMALL)


class Own(OneAngle):
    """A rule with a setting of any kind."""

    name = "own"
    how: Any = None


def test_a_setting_that_no_file_can_keep_is_named() -> None:
    assert Model(budding=Own(how=[1, "a", None])).asdict()["budding"] == {"rule": "own", "how": [1, "a", None]}
    model = Model(budding=Own(how=np.sin))
    with pytest.raises(InputError, match=r"budding: how of rule 'own' is .*, which no file can keep: settings are"):
        model.asdict()


def test_rules_in_a_list_are_refused_as_their_parameters_would_be_lost() -> None:
    for several in ((OneAngle(),), {"first": OneAngle()}):
        with pytest.raises(InputError, match=r"budding: how of rule 'own' is .*, expected no list of rules"):
            Own(how=several)


def test_parameters_of_a_rule_are_a_tuple() -> None:
    class Alone(OneAngle):
        name = "alone"
        parameters = Parameter("lean", "l", "how far buds lean", (0.1, 1.0), 0.5)  # type: ignore[assignment]

    with pytest.raises(InputError, match=r"parameters of rule 'alone' are .*, with a comma after a single one"):
        Model(budding=Alone())


def test_a_colony_of_double_precision_goes_on_in_single() -> None:
    key = member_keys(0, 1)[0]
    with jax.enable_x64(True):
        double = Model().start(key, SMALL)
        as_it_is = Model().resumed(double)
    single, alike = Model().resumed(double), Model().start(key, SMALL)
    assert double.positions.dtype == as_it_is.positions.dtype == np.float64
    types = [jax.tree.map(lambda leaf: leaf.dtype, one) for one in (single, alike)]
    assert jax.tree.leaves(types[0]) == jax.tree.leaves(types[1])
    np.testing.assert_array_equal(single.positions, np.asarray(double.positions).astype(np.float32))
