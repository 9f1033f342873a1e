"""Bootstraps and profiles, on a linear problem where both have a closed form."""

from collections.abc import Callable

import numpy as np
import pytest
from stand_in import FREE, QUIET, StandIn, drawn, fitted, straight

from yeastfit import Fit, InputError, Parameters
from yeastfit.inference.fit.bootstrap_profile import Bootstrap, Explored, Profile, _box, _interval, profiles
from yeastfit.inference.fit.response_surface import response_surface

TRUTH = Parameters(mobility=2.0, metabolic_rate=0.7, aspect_ratio=0.6)
START = {"mobility": 2.0, "metabolic_rate": 0.7, "aspect_ratio": 0.6}


@pytest.fixture(scope="module")
def fit() -> Fit:
    targets = drawn(TRUTH, np.random.default_rng(0), mean=straight)
    return fitted(targets, StandIn(straight, QUIET), start=START)


def explored(fit: Fit, narrower: float = 1.0) -> Explored:
    """As `explore` does, of curves without noise."""
    centre, reach = _box(fit)
    grow: Callable[[np.ndarray], np.ndarray] = lambda theta: straight(StandIn().logarithms(fit.space.values("", theta)))  # noqa: E731
    return Explored(fit, response_surface(grow, centre, narrower * reach, 64, seed=0), 64)


def test_a_bootstrap_is_the_scatter_of_replicates_propagated(fit: Fit) -> None:
    """cov θ̂ = G C Gᵀ, G = (JᵀWJ)⁻¹JᵀW, C of means of resampled replicates; 1000 draws tell an error to 2 %."""
    found = explored(fit).bootstrap(draws=1000, seed=1)
    assert isinstance(found, Bootstrap)
    curves = fit.targets.curves
    assert curves is not None
    count = len(curves)
    means = np.cov(curves.reshape(count, -1).T, ddof=0) / count
    weight, slopes = np.linalg.inv(fit.conditions[0].covariance), fit.jacobian
    gain = np.linalg.solve(slopes.T @ weight @ slopes, slopes.T @ weight)
    expected = np.sqrt(np.diag(gain @ means @ gain.T))
    np.testing.assert_allclose([found.log_standard_errors[name] for name in FREE], expected, rtol=0.1)
    np.testing.assert_allclose(np.log(found.values).mean(axis=0), fit.theta, atol=4 * expected.max() / np.sqrt(1000))
    for k, name in enumerate(FREE):
        low, high = found.intervals[name]
        assert np.log(high / low) == pytest.approx(3.92 * expected[k], rel=0.15)
    assert found.at_edge < 0.01
    assert found.unconverged == 0
    assert found.simulations == 64


def test_a_bootstrap_follows_its_seed(fit: Fit) -> None:
    whole = explored(fit)
    first, again, other = (whole.bootstrap(draws=20, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.values, again.values)
    assert (first.values != other.values).any()
    with pytest.raises(InputError, match="draws is 1, a bootstrap needs at least 2"):
        whole.bootstrap(draws=1)


def test_the_profile_of_a_linear_problem_is_the_parabola(fit: Fit) -> None:
    found = profiles(explored(fit))
    assert tuple(found) == FREE
    for name, profile in found.items():
        error, k = fit.log_standard_errors[name], FREE.index(name)
        assert isinstance(profile, Profile)
        assert np.log(profile.estimate) == pytest.approx(fit.theta[k], abs=0.05 * error)
        away = (np.log(profile.values) - fit.theta[k]) / error
        np.testing.assert_allclose(profile.rise, away**2, atol=0.05 * (1 + away.max() ** 2))
        for label, width in (("68%", 1.0), ("95%", 1.96)):
            low, high = np.log(profile.intervals[label])
            assert [(low - fit.theta[k]) / error, (high - fit.theta[k]) / error] == pytest.approx(
                [-width, width], abs=0.1
            )


def test_what_lies_beyond_the_surface_is_told_as_such(fit: Fit) -> None:
    """A surface that reaches half an error only."""
    narrow = explored(fit, narrower=0.5 / 3.5)
    assert narrow.bootstrap(draws=50).at_edge > 0.5
    low, high = narrow.profile("mobility").intervals["95%"]
    assert np.isnan([low, high]).all()


def test_all_that_a_profile_accepts_is_in_its_interval() -> None:
    """Two valleys, of which the lower one ends with the surface; a fit that ended between them."""
    values = np.array([0.5, 0.6, 0.65, 0.7, 0.75, 0.8])
    rise = np.array([6.0, 1.0, 3.0, 6.2, 3.0, 0.0])
    low, high = _interval(np.log(values), rise, 3.84)
    assert 0.5 < low < 0.6
    assert np.isnan(high)
    assert Profile("n*", 0.7, 0.04, values, rise).doubts == [
        "the profile of n* is lowest where the surface ends, at 0.8",
        "the profile of n* has several valleys: its interval holds values that fit worse",
        "the fitted n*, 0.7, lies outside of what its profile accepts",
    ]
    assert Profile("n*", 0.6, 0.04, values[:4], np.array([6.0, 0.0, 3.0, 6.2])).doubts == []


def test_a_prior_bends_the_profile() -> None:
    targets = drawn(TRUTH, np.random.default_rng(0), mean=straight)
    prior = {"mobility": (1.8, 0.05)}
    pulled = fitted(targets, StandIn(straight, QUIET), prior=prior, start=START)
    low, high = np.log(explored(pulled).profile("mobility").intervals["68%"])
    assert 0.5 * (high - low) == pytest.approx(pulled.log_standard_errors["mobility"], rel=0.1)
    assert 0.5 * (high - low) < 0.05


def test_a_name_that_is_not_free_has_no_profile(fit: Fit) -> None:
    with pytest.raises(InputError, match="profile of 'elasticity', which is not free: mobility, metabolic_rate"):
        explored(fit).profile("elasticity")
