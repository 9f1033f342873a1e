"""The quadratic for the logit of success, its misfit, and the error that an emulator claims of a probability."""

import numpy as np
import pytest
from known_likelihoods import fragile, simulations
from scipy.special import expit

from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.success import quadratic_logit, success_misfit
from yeastfit.inference.neural_likelihood.training import train
from yeastfit.inference.polynomial import monomials

COEFFICIENTS = np.array([1.5, 0.8, -0.5, -0.4, 0.3, 0.2])


def outcomes(count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Terms of rows, and whether they succeed with a logit that is a quadratic."""
    features = monomials(rng.standard_normal((count, 2)))
    return features, rng.random(count) < expit(features @ COEFFICIENTS)


def test_the_quadratic_is_the_most_likely_one() -> None:
    """Within four standard errors of the truth, by Fisher's information; its gradient is the penalty's."""
    features, came = outcomes(20_000, np.random.default_rng(0))
    found = quadratic_logit(features, came)
    share = expit(features @ found)
    information = (features.T * (share * (1.0 - share))) @ features
    errors = np.sqrt(np.diag(np.linalg.inv(information)))
    assert np.abs((found - COEFFICIENTS) / errors).max() < 4.0
    np.testing.assert_allclose(features.T @ (came - share), [0.0, *found[1:]], atol=1e-2)


def test_outcomes_that_can_be_told_apart_exactly_have_finite_coefficients() -> None:
    features = monomials(np.linspace(-1.0, 1.0, 200)[:, None])
    found = quadratic_logit(features, features[:, 1] > 0)
    assert np.isfinite(found).all()
    assert ((features @ found > 0) == (features[:, 1] > 0)).all()
    assert np.abs(found).max() < 30.0


def test_misfit_is_what_the_logit_is_off() -> None:
    """0 of the true probability; the mean of h² P (1 − P) where the logit is off by h, to first order."""
    rng = np.random.default_rng(1)
    features, came = outcomes(200_000, rng)
    logit = features @ COEFFICIENTS
    assert success_misfit(expit(logit), came, features) < 3e-4
    off = 0.2 * features[:, 1]
    share = expit(logit)
    expected = np.mean(off**2 * share * (1.0 - share))
    np.testing.assert_allclose(success_misfit(expit(logit + off), came, features), expected, rtol=0.25)


def of_fragile(seed: int, settings: TrainingSettings) -> Emulator:
    known = fragile()
    return train(*simulations(known, 1024, seed), prior=known.prior, labels=known.labels, seed=seed, settings=settings)


def test_simulations_that_all_succeed_leave_no_error() -> None:
    known = fragile()
    values, statistics = simulations(known, 256, 0)
    came = np.isfinite(statistics).all(axis=1)
    found = train(values[came], statistics[came], prior=known.prior, labels=known.labels, seed=0, settings=FEW)
    np.testing.assert_array_equal(found.success_error(values[:5]), 0.0)


FEW = TrainingSettings(members=2, width=16, steps=200)


@pytest.mark.thorough
def test_the_error_it_claims_of_a_probability_is_the_error_it_makes() -> None:
    """Of log P, on average over simulations that might as well have been made."""
    known = fragile()
    values = known.prior.quantile(0.1 + 0.8 * np.random.default_rng(3).random((200, 2)))
    exact = np.log1p(-known.fails(values))
    made, claimed = [], []
    for seed in range(6):
        found = of_fragile(seed, TrainingSettings())
        made.append(np.mean((np.log(found.moments(values)[3]) - exact) ** 2))
        claimed.append(np.mean(found.success_error(values)))
    assert 0.5 < np.mean(claimed) / np.mean(made) < 2.0
