"""An argument of another class is named, with what was given and what would be right."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from made_posteriors import made_posterior
from stand_in import STATISTICS, TIMES, StandIn

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


def fitted(**given: Any) -> None:
    simulator = StandIn()
    curves = {name: np.ones((3, len(TIMES))) + np.arange(3)[:, None] for name in STATISTICS}
    ANY.fit(ANY.Targets.from_replicates(curves, TIMES), simulator, **given)


PAIR: Any = (StandIn(), Prior.default(StandIn().parameters))

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
    (lambda: grown(keys=member_keys(0, 2)[:0]), "keys is empty, need one for each of at least one colony"),
    (lambda: ANY.calibrate(*PAIR, data_sets=2.5), "data_sets is 2.5, it must be a whole number of at least 1"),
    (lambda: ANY.calibrate(*PAIR, method=3), "method is 3, no sampler; it must be a name or an object"),
    (lambda: ANY.calibrate(*PAIR, progress=True), "progress is true, it must be a function of what is being done"),
    (lambda: inferred(progress=True), "progress is true, it must be a function of what is being done"),
    (lambda: inferred(simulations="many"), "simulations is 'many', it must be a whole number of at least 2"),
    (lambda: ANY.infer(*PAIR, "the mean"), "observed is 'the mean', it must be numbers"),
    (lambda: ANY.Targets.from_means([[1.0]], [1.0]), r"means is \[\[1.0\]\], it must be curves by the names of stat"),
    (lambda: ANY.Targets.from_means({}, [1.0]), "means are empty, need those of at least one statistic"),
    (lambda: ANY.Targets.from_means({"area": ["a"]}, [1.0]), r"means of area is \['a'\], it must be numbers"),
    (lambda: ANY.Targets.from_means({"area": [1.0]}, None), "times is null, it must be numbers"),
    (
        lambda: ANY.Targets.from_means({"area": [1.0]}, [1.0, 2.0]),
        r"means of area have the shape \(1,\), need one number for each time, of 2 times",
    ),
    (
        lambda: ANY.Targets.from_means({"area": [1.0]}, [1.0], scatter=[0.1]),
        r"scatter is \[0.1\], it must be curves by the names of statistics",
    ),
    (
        lambda: ANY.Targets.from_means({"area": [1.0]}, [1.0], imaging="mask"),
        "imaging is 'mask', it must be yeastfit.I",
    ),
    (
        lambda: ANY.Targets.from_replicates({"area": np.ones((3, 1)), "radius": np.ones((4, 1))}, [1.0]),
        "curves are of different replicates, 3 of area, 4 of radius: give nan where one is missing",
    ),
    (
        lambda: ANY.Targets.from_replicates({"area": [1.0, 2.0]}, [1.0, 2.0]),
        r"curves of area have the shape \(2,\), need \[replicate, time\], of 2 times",
    ),
    (
        lambda: ANY.Targets(("area",), np.ones(1), [[1.0]], np.ones((1, 1)), np.ones((1, 1), int)),
        r"mean is \[\[1.0\]\], it must be an array of numpy, or use from_means\(…\)",
    ),
    (lambda: PAIR[1].log_density([1.0]), r"values is \[1.0\], it must be an array of numpy, \[draws, 3\]"),
    (lambda: PAIR[1].sample(3, 0), "rng is 0, it must be a generator, such as numpy.random.default_rng"),
    (lambda: PAIR[1].sample(2.5, np.random.default_rng(0)), "count is 2.5, it must be a whole number of at least 0"),
    (lambda: ANY.Prior.default(PAIR[1], bounded="b"), r"parameters is .*, it must be a yeastfit.ParameterSet"),
    (
        lambda: ANY.Prior.default(PAIR[0].parameters, bounded="betta"),
        "bounded is 'betta', it must be one of log-uniform, beta",
    ),
    (lambda: ANY.FitSettings(members=16), "members is 16, it must be a row with a number for each stage"),
    (lambda: ANY.FitSettings(starts=1.5), "starts is 1.5, it must be a whole number of at least 1"),
    (lambda: ANY.FitSettings(measurement_error="5 %"), "measurement_error is '5 %', it must be a number from 0 to 1"),
    (lambda: fitted(settings={"starts": 2}), "settings is {starts = 2}, it must be yeastfit.FitSettings"),
    (lambda: fitted(bounds={"mobility": 3}), "bounds of mobility is 3, it must be two numbers"),
    (lambda: fitted(prior=PAIR[1]), "prior is Prior.*, it must be values by the names of parameters"),
    (
        lambda: fitted(prior={"mobility": (1.0, 0.1, 2.0)}),
        r"prior of mobility is \[1.0, 0.1, 2.0\], it must be two num",
    ),
    (lambda: fitted(start=Parameters()), "start is Parameters.*, it must be values by the names of parameters"),
    (lambda: fitted(start={"mobility": "a"}), "start: mobility is 'a', it must be a finite number"),
    (lambda: fitted(own="mobility"), r"own is 'mobility', it must be a list of names, such as \['mobility'\]"),
    (lambda: ANY.explore(PAIR[0]), r"fit is StandIn.*, it must be the result of yeastfit.fit\(…\)"),
    (lambda: ANY.profiles(None), r"explored is null, it must be the result of yeastfit.explore\(…\)"),
    (lambda: ANY.information_of(None), r"sensitivity is null, it must be the result of yeastfit.sensitivity\(…\)"),
    (lambda: ANY.sensitivity(simulator=PAIR[0], at=3), "at is 3, it must be values by the names of parameters"),
    (lambda: ANY.sensitivity(simulator=PAIR[0], runs=2.5), "runs is 2.5, it must be a whole number of at least 1"),
    (lambda: ANY.sensitivity(simulator=PAIR[0], spread="wide"), "spread is 'wide', it must be a number from 0 to 1"),
    (lambda: made_posterior(np.zeros((1, 50, 2))).save("."), r"\.: this is a folder, give the name of a file in it"),
    (lambda: ANY.Posterior.of(3, np.ones((1, 2, 3)), simulations=1), r"problem is 3, it must be yeastfit.Problem\(…\)"),
    (
        lambda: ANY.Posterior.to_arviz(made_posterior(np.zeros((1, 50, 2))), "x"),
        "predictive is 'x', it must be what Posterior.predict or predict_prior returns",
    ),
    (lambda: ANY.cross_validate(None, None, None, None), "posterior is null, it must be a yeastfit.Posterior"),
    (lambda: ANY.Imaging(extent="far"), "extent is 'far', it must be a finite number"),
    (lambda: ANY.plot.corner([[1.0]]), r"posterior is \[\[1.0\]\], it must be a yeastfit.Posterior"),
    (lambda: ANY.plot.traces(None), "posterior is null, it must be a yeastfit.Posterior"),
    (
        lambda: ANY.plot.ranks(made_posterior(np.zeros((1, 50, 2)))),
        r"chains is Posterior.*, it must be Posterior.chains",
    ),
    (lambda: ANY.plot.predictive(3, None), "predicted is 3, it must be what Posterior.predict returns"),
    (lambda: ANY.plot.cross_validation(3), "diagnostics is 3, it must be Posterior.diagnostics of a run of the emul"),
    (lambda: ANY.plot.fit("fit.json"), "result is 'fit.json', it must be what yeastfit.fit returned"),
    (lambda: ANY.plot.convergence(None), "result is null, it must be what yeastfit.fit returned"),
    (lambda: ANY.plot.profiles([1]), r"results is \[1\], it must be what yeastfit.profiles returned, by name"),
    (lambda: ANY.plot.profiles({}), "results are empty, need at least one: what yeastfit.profiles returned, by name"),
    (lambda: ANY.plot.bootstrap(None, None), "result is null, it must be what Explored.bootstrap returned"),
    (lambda: ANY.plot.spectrum(2), "result is 2, it must be what yeastfit.information returned, or Fit.information"),
    (lambda: ANY.plot.ellipses(2), "result is 2, it must be what yeastfit.information returned, or Fit.information"),
    (lambda: ANY.plot.design(2), "result is 2, it must be what yeastfit.design returned"),
    (lambda: ANY.plot.left_out({"one": 2}), "runs: 'one' is 2, it must be the result of yeastfit.cross_validate"),
    (lambda: ANY.plot.marginals(["out"]), "runs is 'out', it must be finished runs of infer"),
    (lambda: ANY.plot.colony(2), "simulation is 2, it must be what yeastfit.simulate returned"),
    (lambda: ANY.plot.curves(2), "simulation is 2, it must be what yeastfit.simulate returned"),
    (lambda: ANY.plot.save(None, "fit.png"), "figure is null, it must be what a function of yeastfit.plot returned"),
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
