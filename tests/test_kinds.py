"""An argument of another class is named, with what was given and what would be right."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from made_posteriors import made_posterior
from stand_in import StandIn

import yeastfit
from yeastfit import InputError, Model, Parameters, Prior, member_keys
from yeastfit.model.mechanisms.walker_medium import WalkerBirths, WalkerMedium
from yeastfit.model.rules import BirthRule

ANY: Any = yeastfit  # whose functions a type checker lets be called with anything


def grown(**given: Any) -> None:
    ANY.simulate(**({"parameters": Parameters(), "keys": member_keys(0, 2), "times": [1]} | given))


def inferred(**given: Any) -> None:
    simulator = StandIn()
    ANY.infer(simulator, Prior.default(simulator.parameters), np.ones(len(simulator.observables)), **given)


WRONG: list[tuple[Callable[[], object], str]] = [
    (lambda: grown(parameters={"mobility": 1.0}), r"parameters is {mobility = 1.0}, it must be yeastfit.Parameters\("),
    (lambda: grown(keys=3), r"keys is 3, it must be keys of jax"),
    (lambda: grown(model="biased"), r"model is 'biased', it must be yeastfit.Model\(…\)"),
    (lambda: grown(model=Model), r"model is the class Model: write Model\(…\)"),
    (lambda: grown(numerics={"dt": 0.1}), r"numerics is {dt = 0.1}, it must be yeastfit.Numerics\(…\)"),
    (lambda: grown(relaxation=0.1), r"relaxation is 0.1, it must be yeastfit.Relaxation\(…\)"),
    (lambda: ANY.ColonySimulator.of([1, 2]), r"targets is \[1, 2\], it must be yeastfit.Targets of one condition"),
    (lambda: ANY.fit([1, 2]), r"targets is \[1, 2\], it must be yeastfit.Targets, or several by the names"),
    (lambda: ANY.fit({"50 µM": 3}), r"targets: '50 µM' is 3, it must be yeastfit.Targets\(…\)"),
    (
        lambda: ANY.infer(Prior.default(StandIn().parameters), StandIn(), [1.0]),
        r"simulator \(Prior\) has no parameters",
    ),
    (lambda: ANY.infer(StandIn(), "wide", [1.0]), r"prior is 'wide', it must be a yeastfit.Prior, such as"),
    (lambda: ANY.Prior.default("mobility"), r"parameters is 'mobility', it must be a yeastfit.ParameterSet"),
    (lambda: ANY.design("out"), r"sensitivity is 'out', it must be the result of yeastfit.sensitivity"),
    (lambda: ANY.simulate(member_keys(0, 2), Parameters(), times=[1]), r"parameters is .*, it must be yeastfit.Param"),
    (lambda: inferred(variation=True), r"variation is true, it must be yeastfit.Variation\(…\)"),
    (lambda: inferred(limits=[[0.0, 1.0]]), r"limits is \[\[0.0, 1.0\]\], it must be an array with a row"),
    (lambda: inferred(store=3), r"store is 3, it must be a path, or an open yeastfit.Store"),
    (lambda: ANY.calibrate(None, Prior.default(StandIn().parameters)), r"simulator \(NoneType\) has no parameters"),
    (lambda: ANY.Posterior.predict(made_posterior(np.zeros((1, 50, 2))), None), r"simulator \(NoneType\) has no par"),
    (lambda: ANY.check_gradients("out"), r"parameters is 'out', it must be yeastfit.Parameters\(…\)"),
]


@pytest.mark.parametrize(("call", "message"), WRONG, ids=[message[:24] for _, message in WRONG])
def test_an_argument_of_another_class_is_named(call: Callable[[], object], message: str) -> None:
    with wrong_types(), pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize("value", [2.5, "ten", True, None], ids=str)
def test_settings_of_rules_in_python_are_of_their_kind(value: Any) -> None:
    """As in recipes."""
    with wrong_types(), pytest.raises(InputError, match=r"births: per_bud of rule 'walkers' is .*, expected a whole n"):
        WalkerBirths(per_bud=value)
    width: Any = "wide" if value == 2.5 else value
    with wrong_types(), pytest.raises(InputError, match=r"medium: width of rule 'walkers' is .*, expected a finite n"):
        WalkerMedium(width=width)


def test_settings_of_a_rule_of_ones_own_that_has_no_name() -> None:
    class Own(BirthRule):
        least: int = 3

        def due(self, context: Any) -> Any:
            raise NotImplementedError

        def births(self, context: Any) -> Any:
            raise NotImplementedError

    half: Any = 0.5
    with wrong_types(), pytest.raises(InputError, match=r"births: least of rule 'Own' is 0.5, expected a whole number"):
        Own(least=half)
