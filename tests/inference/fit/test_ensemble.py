"""What ensembles say about a point: means, Jacobians, Σ, and what a refinement adds."""

from dataclasses import replace

import numpy as np
import pytest
from stand_in import CENTRE, CURVES, FREE, QUIET, ROOT, SETTINGS, SLOPES, STATISTICS, StandIn, drawn, exact, straight

from yeastfit import Parameters, SimulationError, Targets
from yeastfit.inference.fit.descent import Descent
from yeastfit.inference.fit.ensemble import Ensembles, JointModel
from yeastfit.inference.fit.stages import Fitter
from yeastfit.inference.parameter_space import ParameterSpace
from yeastfit.model.parameters import PARAMETERS

TRUTH = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6)
AT = np.log([2.0, 0.7, 0.6])
COLUMNS = [PARAMETERS.names.index(name) for name in FREE]


def ensembles(targets: dict[str, Targets], simulators: dict[str, StandIn], own: tuple[str, ...] = ()) -> Ensembles:
    """Of stand-ins, by condition."""
    space = ParameterSpace.of(next(iter(simulators.values())).parameters, tuple(targets), own)
    return Ensembles(targets, {**simulators}, space, 0, SETTINGS)


def model_of(found: JointModel | SimulationError) -> JointModel:
    assert isinstance(found, JointModel)
    return found


@pytest.fixture(scope="module")
def targets() -> Targets:
    return drawn(TRUTH, np.random.default_rng(0), mean=straight)


def test_means_and_jacobians_of_conditions_are_stacked(targets: Targets) -> None:
    simulators = {name: StandIn(straight, QUIET) for name in ("a", "b")}
    whole = ensembles({"a": targets, "b": targets}, simulators, own=("mobility",))
    theta = np.array([AT[0], 0.0, *AT[1:]])
    (joint,) = (model_of(each) for each in whole.local_models([theta], 32, 0.1))
    expected = np.zeros((2 * CURVES, 4))
    expected[:CURVES, [0, 2, 3]] = expected[CURVES:, [1, 2, 3]] = SLOPES[:, COLUMNS]
    np.testing.assert_allclose(joint.jacobian, expected, atol=2e-3)
    at = np.tile(CENTRE, (2, 1))
    at[:, COLUMNS] = [[theta[0], *theta[2:]], theta[1:]]
    np.testing.assert_allclose(joint.mean, straight(at).ravel(), atol=1e-3)
    assert whole.tally.simulated == 2 * 32


def test_conditions_have_chance_of_their_own(targets: Targets) -> None:
    """Wherever they stand; one alone has that of the seed."""
    means = []
    for names in (("a", "b"), ("b", "a"), ("a",)):
        whole = ensembles(dict.fromkeys(names, targets), {name: StandIn() for name in names})
        (joint,) = (model_of(each) for each in whole.local_models([AT], 16, 0.1))
        means.append({name: joint.conditions[name].mean for name in names})
    assert not np.allclose(means[0]["a"], means[0]["b"], rtol=1e-6)
    np.testing.assert_array_equal(means[0]["b"], means[1]["b"])
    (alone,) = (model_of(e) for e in ensembles({"": targets}, {"": StandIn()}).local_models([AT], 16, 0.1))
    np.testing.assert_array_equal(means[2]["a"], alone.conditions[""].mean)


def test_places_of_a_batch_do_not_know_of_each_other(targets: Targets) -> None:
    places = [AT, AT + 0.3, AT - 0.2]
    together = [model_of(each) for each in ensembles({"": targets}, {"": StandIn()}).local_models(places, 16, 0.1)]
    for place, joint in zip(places, together, strict=True):
        (alone,) = ensembles({"": targets}, {"": StandIn()}).local_models([place], 16, 0.1)
        np.testing.assert_allclose(joint.mean, model_of(alone).mean, rtol=1e-12)
        np.testing.assert_allclose(joint.jacobian, model_of(alone).jacobian, rtol=1e-9)


def test_a_place_without_colonies_does_not_stop_the_others(targets: Targets) -> None:
    def mean(away: np.ndarray) -> np.ndarray:
        return np.where(away[:, COLUMNS[:1]] > AT[0] + 1, np.nan, straight(away))

    good, bad = ensembles({"": targets}, {"": StandIn(mean)}).local_models([AT, AT + 2.0], 16, 0.1)
    assert isinstance(good, JointModel)
    assert isinstance(bad, SimulationError)
    assert str(bad).startswith("mobility 14.8, metabolic_rate 5.17, aspect_ratio 4.43: 8 of 8 pairs of simulations")


def test_sigma_holds_scatter_monte_carlo_and_measurement_errors(targets: Targets) -> None:
    """h (S / R + cov m) + measurement error, S scaled statistic by statistic to the measured scatter."""
    chosen = replace(targets, scatter=np.array([0.1, 0.2, np.nan])[:, None] * np.ones((3, 4)))
    whole = ensembles({"": chosen}, {"": StandIn(straight)})
    whole = replace(
        whole, settings=replace(SETTINGS, measurement_error={"radius": 0.0, "area": 0.03, "perimeter": 0.0})
    )
    (joint,) = (model_of(each) for each in whole.local_models([AT], 16384, 0.1))
    local = joint.conditions[""]
    inflation = local.scatter.freedom / (local.scatter.freedom - CURVES - 1)
    scale = np.repeat([1.0, 2.0, 1.0], 4)
    expected = inflation * (np.outer(scale, scale) / 10 + 1 / 8192) * (ROOT @ ROOT.T)
    error = np.where(np.arange(CURVES) >= 8, 0.03 * chosen.mean.ravel(), 0.0)
    expected += 0.5 * np.outer(error, error) + 0.5 * np.diag(error**2)
    np.testing.assert_allclose(whole.covariance(joint), expected, atol=0.05 * expected.diagonal().max())
    assert np.linalg.eigvalsh(whole.covariance(joint)).min() > 0


def test_colonies_that_do_not_differ_have_no_errors(targets: Targets) -> None:
    """As where a coarse time step allows one number of cells alone."""
    whole = ensembles({"": targets}, {"": StandIn(straight)})
    (joint,) = (model_of(each) for each in whole.local_models([AT], 64, 0.1))
    local = replace(joint.conditions[""], scatter=replace(joint.conditions[""].scatter, covariance=np.diag([0.0] * 12)))
    with pytest.raises(SimulationError, match=f"simulated colonies do not differ in {targets.names[0]}, so its"):
        whole.condition_covariance("", local)


def test_a_statistic_that_is_not_measured_has_no_row(targets: Targets) -> None:
    curves = np.array(targets.curves)
    curves[:, 1, 2] = np.nan
    partial = Targets.from_replicates(
        {n: curves[:, k] for k, n in enumerate(STATISTICS)}, targets.times, imaging=targets.imaging
    )
    kept = np.delete(np.arange(CURVES), 6)
    simulator = StandIn(lambda away: straight(away)[:, kept], ROOT[kept], observables=partial.observables)
    whole = ensembles({"": partial}, {"": simulator})
    (joint,) = (model_of(each) for each in whole.local_models([AT], 64, 0.1))
    assert whole.covariance(joint).shape == (CURVES - 1,) * 2
    np.testing.assert_allclose(joint.jacobian, SLOPES[kept][:, COLUMNS], atol=0.4)


def test_the_rough_comparison_is_a_twentieth_of_the_mean_at_least() -> None:
    targets = exact(TRUTH, replicates=4)
    rough = ensembles({"": targets}, {"": StandIn()}).screening_covariance(16)
    np.testing.assert_allclose(rough, np.diag(targets.values**2 * (0.1**2 * (1 / 4 + 2 / 16) + 0.05**2)))


# --- refinement -------------------------------------------------------------------------------------------------------

SHIFT = 0.02 * np.arange(CURVES)


def finer(away: np.ndarray) -> np.ndarray:
    return straight(away) + SHIFT


def test_what_finer_colonies_change_is_found_with_its_error(targets: Targets) -> None:
    """Noise that is a key's at every λ is the same in both and cancels."""
    still = {"": StandIn(straight, turn=0.0)}
    whole = replace(ensembles({"": targets}, still), fine={"": StandIn(finer, turn=0.0)})
    (joint,) = (model_of(each) for each in whole.local_models([AT], 128, 0.1))
    correction = whole.correction(joint)
    np.testing.assert_allclose(correction.mean, SHIFT, atol=1e-9)
    assert np.abs(correction.covariance).max() < 1e-12
    assert whole.tally.simulated == 128 + min(64, SETTINGS.refined)
    coarse = replace(whole, fine={})
    assert not coarse.correction(joint).mean.any()


def test_a_start_whose_refinement_comes_to_nothing_ends_alone(targets: Targets) -> None:
    """The first start is fine; around the second, at λ twice as large, refined colonies are not finite."""

    def torn(away: np.ndarray) -> np.ndarray:
        return np.where(away[:, COLUMNS[:1]] > AT[0] + 0.35, np.nan, finer(away))

    whole = replace(ensembles({"": targets}, {"": StandIn(straight)}), fine={"": StandIn(torn)})
    whole = replace(whole, settings=replace(SETTINGS, members=(64,), spreads=(0.05,)))
    fitter = Fitter(whole, {}, lambda what, share: None)
    good, bad = Descent(1, AT), Descent(2, AT + np.array([0.7, 0.0, 0.0]))
    fitter._stage([good, bad], 0)
    assert good.model is not None
    assert good.correction is not None
    assert bad.model is None
    assert "fine simulations failed" in bad.ended
    assert any(note.startswith("start 2: ") for note in fitter.notes)


def test_a_fit_is_that_of_the_finer_model() -> None:
    """Without the refinement it would be off by what the finer model changes."""
    targets = exact(TRUTH, finer)
    whole = ensembles({"": targets}, {"": StandIn(straight, QUIET)})
    refined = Fitter(replace(whole, fine={"": StandIn(finer, QUIET)}), {}, lambda what, share: None).run(AT + 0.2)
    coarse = Fitter(whole, {}, lambda what, share: None).run(AT + 0.2)
    errors = np.sqrt(np.diag(refined.log_covariance))
    np.testing.assert_allclose(refined.theta, AT, atol=1e-3)
    np.testing.assert_allclose(refined.conditions[0].fitted, targets.mean, atol=1e-3)
    assert refined.chi_square < 1e-2 < coarse.chi_square
    assert (np.abs(coarse.theta - AT) > 0.1 * errors).any()
