"""What a fit finds, and whether its errors are true, on stand-ins whose curves and covariance are known."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from stand_in import CENTRE, CURVES, FREE, QUIET, SETTINGS, SLOPES, StandIn, bent, drawn, exact, fitted, logs, straight

from yeastfit import Fit, Parameters, Targets
from yeastfit.inference.fit.settings import OptimiserName
from yeastfit.model.parameters import PARAMETERS

TRUTH = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6)
AT_TRUTH = np.log([2.0, 0.7, 0.6])
NEAR = {"mobility": 1.5, "metabolic_rate": 0.9, "aspect_ratio": 0.5}
COLUMNS = [PARAMETERS.names.index(name) for name in FREE]
SHORT = replace(SETTINGS, members=(64, 256), spreads=(0.15, 0.1))


def known_scatter(targets: Targets) -> Targets:
    """With the scatter that the data were drawn with, 0.1, in the place of their own estimate of it."""
    return replace(targets, scatter=np.full_like(targets.scatter, 0.1))


def estimates(count: int, method: OptimiserName, known: bool) -> Iterator[tuple[np.ndarray, Fit]]:
    """(θ̂ − θ) / error of fits to data that are drawn anew each time."""
    rng = np.random.default_rng(0)
    for seed in range(count):
        targets = drawn(TRUTH, rng)
        targets = known_scatter(targets) if known else targets
        result = fitted(targets, seed=seed, settings=replace(SHORT, method=method), start=NEAR)
        yield (result.theta - AT_TRUTH) / np.sqrt(np.diag(result.log_covariance)), result


@pytest.mark.thorough
@pytest.mark.parametrize(("method", "count"), [("levenberg-marquardt", 100), ("dogleg", 30), ("bfgs", 30)])
def test_errors_cover_the_truth(method: OptimiserName, count: int) -> None:
    """68 % within one error and 95 % within two, within three binomial deviations; χ² on its degrees of freedom."""
    pulls, results = zip(*estimates(count, method, known=True), strict=True)
    z = np.array(pulls)
    for width, share in ((1, 0.683), (2, 0.954)):
        assert abs(np.mean(np.abs(z) < width) - share) < 3 * np.sqrt(share * (1 - share) / z.size)
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=3 / np.sqrt(2 * z.size))
    assert (np.abs(z.mean(axis=0)) < 3.5 / np.sqrt(count)).all()
    freedom = CURVES - len(FREE)
    assert np.mean([r.chi_square for r in results]) == pytest.approx(freedom, abs=3.5 * np.sqrt(2 * freedom / count))
    if method != "bfgs":  # BFGS may want more than eight steps
        assert all(r.status == "converged" and r.converged for r in results)


@pytest.mark.usefixtures("unchecked")
def test_errors_from_the_scatter_of_ten_replicates_are_short_by_a_tenth_at_most() -> None:
    """The scatter of three curves, each told by ten colonies, is itself uncertain: pulls have longer tails."""
    z = np.array([pull for pull, _ in estimates(40, "levenberg-marquardt", known=False)])
    assert 0.9 < np.sqrt(np.mean(z**2)) < 1.1 + 3 / np.sqrt(2 * z.size)


def test_the_estimate_does_not_depend_on_the_method() -> None:
    targets = drawn(TRUTH, np.random.default_rng(5))
    methods: tuple[OptimiserName, ...] = ("levenberg-marquardt", "dogleg", "bfgs")
    found = [fitted(targets, settings=replace(SETTINGS, method=method)) for method in methods]
    errors = np.sqrt(np.diag(found[0].log_covariance))
    for other in found[1:]:
        assert (np.abs(other.theta - found[0].theta) < 0.3 * errors).all()


def test_a_start_that_is_given_is_the_only_one() -> None:
    targets = exact(TRUTH)
    result = fitted(targets, StandIn(root=QUIET), start=NEAR)
    assert [start.number for start in result.starts] == [1]
    np.testing.assert_array_equal(result.starts[0].begin, np.log(list(NEAR.values())))
    np.testing.assert_allclose(result.theta, AT_TRUTH, atol=2e-3)


# --- conditions -------------------------------------------------------------------------------------------------------


def test_shared_and_own_parameters_of_two_conditions() -> None:
    """Which differ in a fixed parameter, too: were it mixed up, nothing would fit."""
    first = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6, elasticity=5.0)
    other = first.replace(metabolic_rate=1.6, elasticity=9.0)
    rng = np.random.default_rng(3)
    targets = {"rich": drawn(first, rng), "poor": drawn(other, rng)}
    held = {"rich": Parameters(elasticity=5.0), "poor": Parameters(elasticity=9.0)}
    result = fitted(targets, free=FREE, own=("metabolic_rate",), held=held)
    assert result.free == ("mobility", "metabolic_rate of rich", "metabolic_rate of poor", "aspect_ratio")
    expected = dict(zip(result.free, (2.0, 0.7, 1.6, 0.6), strict=True))
    for name, value in expected.items():
        assert abs(result.values[name] - value) < 3.5 * result.standard_errors[name]
        assert result.standard_errors[name] < 0.15 * value
    rich, poor = result.conditions
    assert rich.parameters["mobility"] == poor.parameters["mobility"]
    assert rich.parameters["metabolic_rate"] == pytest.approx(result.values["metabolic_rate of rich"])
    assert (rich.parameters["elasticity"], poor.parameters["elasticity"]) == (5.0, 9.0)
    assert result.chi_square < result.degrees_of_freedom + 4 * np.sqrt(2 * result.degrees_of_freedom)
    np.testing.assert_array_equal(result.jacobian[:CURVES, 2], 0.0)
    np.testing.assert_array_equal(result.jacobian[CURVES:, 1], 0.0)
    turned = fitted(dict(reversed(targets.items())), free=FREE, own=("metabolic_rate",), held=held)
    for name, value in result.values.items():  # the order of conditions is of no account
        assert turned.values[name] == pytest.approx(value, rel=1e-4)
    assert turned.simulations == result.simulations


def test_two_conditions_halve_the_variance_of_what_they_share() -> None:
    """As far as ensembles of their own find the same correlations of the statistics: within 20 % of the variance."""
    targets = exact(TRUTH, mean=straight)
    alone = fitted(targets, StandIn(straight, QUIET), settings=SHORT, start=NEAR)
    simulators = {name: StandIn(straight, QUIET) for name in "ab"}
    both = fitted({"a": targets, "b": targets}, simulators, own=("aspect_ratio",), settings=SHORT, start=NEAR)
    all_shared = fitted({"a": targets, "b": targets}, simulators, settings=SHORT, start=NEAR)
    np.testing.assert_allclose(np.diag(all_shared.log_covariance), np.diag(alone.log_covariance) / 2, rtol=0.2)
    assert both.free[2:] == ("aspect_ratio of a", "aspect_ratio of b")
    for name in FREE[:2]:
        half, one = both.standard_errors[name] / both.values[name], alone.standard_errors[name] / alone.values[name]
        assert one / np.sqrt(2) * 0.9 < half < one


# --- priors -----------------------------------------------------------------------------------------------------------


def test_with_gaussian_priors_the_estimate_is_the_closed_form_of_a_linear_problem() -> None:
    """θ̂ = (JᵀWJ + P)⁻¹ (JᵀW (y − m₀) + P μ), cov θ̂ = (JᵀWJ + P)⁻¹."""
    targets = drawn(TRUTH, np.random.default_rng(2), mean=straight)
    prior = {"mobility": (1.0, 0.05), "aspect_ratio": (0.5, 0.02)}
    result = fitted(targets, StandIn(straight, QUIET), prior=prior)
    weight, slopes = np.linalg.inv(result.conditions[0].covariance), SLOPES[:, COLUMNS]
    precision = np.diag([0.05**-2, 0.0, 0.02**-2])
    curvature = slopes.T @ weight @ slopes + precision
    zero = straight(logs(Parameters(mobility=1.0, metabolic_rate=1.0, aspect_ratio=1.0))[None])[0]
    pulled = slopes.T @ weight @ (targets.values - zero) + precision @ np.array([np.log(1.0), 0.0, np.log(0.5)])
    np.testing.assert_allclose(result.theta, np.linalg.solve(curvature, pulled), atol=1e-4)
    np.testing.assert_allclose(result.log_covariance, np.linalg.inv(curvature), rtol=5e-3, atol=1e-8)
    assert result.degrees_of_freedom == CURVES + 2 - 3
    assert np.abs(result.theta - AT_TRUTH).max() > 2e-2  # the priors did pull


def test_a_prior_on_what_the_data_do_not_see_is_the_answer() -> None:
    def unseeing(away: np.ndarray) -> np.ndarray:
        return bent(np.where(np.arange(len(PARAMETERS.names)) == PARAMETERS.names.index("diffusivity"), CENTRE, away))

    free, prior = ("diffusivity", "mobility"), {"diffusivity": (0.3, 0.4)}
    targets = drawn(Parameters(mobility=2.0, aspect_ratio=0.5), np.random.default_rng(4), mean=unseeing)
    result = fitted(targets, StandIn(unseeing, turn=10.0, free=free), prior=prior)
    assert result.values["diffusivity"] == pytest.approx(0.3, rel=1e-3)
    assert result.log_standard_errors["diffusivity"] == pytest.approx(0.4, rel=0.02)
    assert abs(result.values["mobility"] - 2.0) < 3.5 * result.standard_errors["mobility"]


# --- directions that data do not see ----------------------------------------------------------------------------------


def product(away: np.ndarray) -> np.ndarray:
    """Curves that depend on mobility and metabolic_rate by their product alone."""
    both = away.copy()
    both[:, PARAMETERS.names.index("mobility")] += both[:, PARAMETERS.names.index("metabolic_rate")]
    both[:, PARAMETERS.names.index("metabolic_rate")] = CENTRE[PARAMETERS.names.index("metabolic_rate")]
    return bent(both)


def test_two_parameters_that_enter_as_a_product_have_no_errors() -> None:
    targets = drawn(TRUTH, np.random.default_rng(6), mean=product)
    result = fitted(targets, StandIn(product))
    assert np.isnan([result.standard_errors[name] for name in FREE[:2]]).all()
    assert result.standard_errors["aspect_ratio"] < 0.1
    assert abs(result.values["aspect_ratio"] - 0.6) < 3.5 * result.standard_errors["aspect_ratio"]
    assert result.values["mobility"] * result.values["metabolic_rate"] == pytest.approx(1.4, rel=0.3)
    said = " ".join(result.warnings)
    assert "mobility" in said
    assert "no standard error of mobility, metabolic_rate" in said
    assert "best fixed: " in said


def test_with_one_of_them_fixed_the_errors_are_right() -> None:
    """Those of (JᵀWJ)⁻¹ with J in closed form."""
    held = Parameters(metabolic_rate=0.7)
    targets = exact(TRUTH, mean=product)
    result = fitted(targets, StandIn(product, QUIET, free=("mobility", "aspect_ratio"), held=held))
    at = logs(held.replace(**result.values))
    slopes = (
        product(at[None])[0][:, None]
        * SLOPES[:, [PARAMETERS.names.index("mobility"), PARAMETERS.names.index("aspect_ratio")]]
    )
    expected = np.linalg.inv(slopes.T @ np.linalg.inv(result.conditions[0].covariance) @ slopes)
    np.testing.assert_allclose(result.log_covariance, expected, rtol=0.03, atol=1e-6)
    np.testing.assert_allclose(result.theta, AT_TRUTH[[0, 2]], atol=5e-3)
    assert not result.warnings
