"""Posterior predictive checks: against normal data whose bands are known, and data that the model does not make."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_posteriors import Drawing
from made_posteriors import flat_prior, made_posterior

from yeastfit.errors import InputError, SimulationError
from yeastfit.inference.posterior.predictive_check import Predictive
from yeastfit.inference.simulator import Mismeasured, Replicates, Simulator, root_of

NORMAL = Drawing(("mean",), ("a", "b"), lambda value, rng: value + rng.standard_normal(2))


def predict(values: np.ndarray, simulator: Simulator, observed: np.ndarray, **more: Any) -> Predictive:
    """A check of the posterior with one chain of these draws of the mean."""
    data = {name: more.pop(name) for name in ("replicates", "noise") if name in more}
    labels = ("a", "b")
    posterior = made_posterior(
        values[None, :, None], prior=flat_prior("mean"), labels=labels, observed=observed, **data
    )
    return posterior.predict(simulator, **more)


def test_a_mean_over_replicates_scatters_less() -> None:
    values, seeds = np.zeros((2000, 1)), np.arange(2000)
    found = Replicates(NORMAL, 16)(values, seeds)
    assert found.std() == pytest.approx(0.25, rel=0.05)
    np.testing.assert_array_equal(Replicates(NORMAL, 16)(values[7:9], seeds[7:9]), found[7:9])


def test_one_failure_fails_the_mean() -> None:
    def draw(value: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.full(2, np.nan if rng.random() < 0.1 else 1.0)

    found = Replicates(Drawing(("mean",), ("a", "b"), draw), 5)(np.zeros((1000, 1)), np.arange(1000))
    assert np.isfinite(found).all(axis=1).mean() == pytest.approx(0.9**5, abs=0.06)


def test_further_draws_take_the_place_of_those_that_failed() -> None:
    def draw(value: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.full(2, np.nan if rng.random() < 0.6 else 1.0)

    half = Drawing(("mean",), ("a", "b"), draw)
    found = predict(np.zeros(100), half, np.zeros(2), draws=12, seed=1)
    assert len(found.statistics) >= 10
    assert found.failed % 12 != 0
    assert (len(found.statistics) + found.failed) % 12 == 0
    never = Drawing(("mean",), ("a", "b"), lambda value, rng: np.full(2, np.nan))
    with pytest.raises(SimulationError, match="0 of 48 draws succeeded, a predictive check needs 10"):
        predict(np.zeros(100), never, np.zeros(2), draws=12, seed=1)


def test_bands_are_those_of_the_normal_distribution(tmp_path: Path) -> None:
    posterior = np.random.default_rng(1).normal(size=4000)
    found = predict(posterior, NORMAL, np.array([0.5, -0.5]), replicates=4, draws=2000, seed=3)
    sd = np.sqrt(1 + 1 / 4)
    np.testing.assert_allclose(found.band(0.9), [[-1.645 * sd, 1.645 * sd]] * 2, atol=0.15)
    assert found.inside(0.5).tolist() == [True, True]
    assert found.sentences() == []
    assert predict(posterior, NORMAL, found.observed, replicates=4, draws=20, seed=3).values.shape == (20, 1)
    found.save(tmp_path / "predictive.npz")
    again = Predictive.load(tmp_path / "predictive.npz")
    assert again.rows() == found.rows()
    assert (again.labels, again.replicates) == (("a", "b"), 4)


def test_errors_of_measurement_are_not_averaged_out() -> None:
    noise = np.array([[4.0, 3.0], [3.0, 4.0]])
    found = predict(np.zeros(100), NORMAL, np.zeros(2), replicates=4, noise=noise, draws=4000, seed=1)
    np.testing.assert_allclose(np.cov(found.statistics.T), noise + np.eye(2) / 4, rtol=0.1)
    simulator = Mismeasured(NORMAL, root_of(np.array([[4.0, 2.0], [2.0, 1.0]])))
    values, seeds = np.zeros((50, 1)), np.arange(50)
    errors = simulator(values, seeds) - NORMAL(values, seeds)
    np.testing.assert_allclose(errors[:, 0], 2.0 * errors[:, 1])  # as far as the covariance says, which is singular
    np.testing.assert_array_equal(simulator(values[7:9], seeds[7:9]), simulator(values, seeds)[7:9])


def test_data_that_the_model_does_not_make_are_told_of() -> None:
    found = predict(np.zeros(100), NORMAL, np.array([0.0, 6.0]), draws=200)
    assert found.p_value == 1 / 201
    (said,) = found.sentences()
    assert "mostly by b" in said


@pytest.mark.usefixtures("unchecked")
def test_p_values_of_data_like_the_predicted_are_uniform() -> None:
    posterior, rng = np.zeros(100), np.random.default_rng(5)
    shares = [predict(posterior, NORMAL, rng.normal(size=2), draws=100, seed=k).p_value for k in range(200)]
    assert np.mean(shares) == pytest.approx(0.5, abs=0.08)
    assert np.mean(np.array(shares) < 0.2) == pytest.approx(0.2, abs=0.1)


def test_few_draws_do_not_accuse_a_model_that_is_right() -> None:
    """Bands hold one more draw as often as they say, and alarms are as rare as their p."""
    rng, n = np.random.default_rng(9), 40
    every = rng.normal(size=(2000, n + 1, 3))
    found = [Predictive(("mean",), ("a", "b", "c"), np.zeros((n, 1)), one[1:], one[0], 1, 0) for one in every]
    assert np.mean([one.inside(0.9) for one in found]) == pytest.approx(0.9, abs=0.015)
    assert np.mean([bool(one.sentences()) for one in found]) == pytest.approx(1 / 41, abs=0.01)
    (said,) = replace(found[0], values=np.zeros((10, 1)), statistics=every[0, 1:11], observed=every[0, 11]).sentences()
    assert "10 draws are too few to tell" in said


def test_too_few_draws_are_refused() -> None:
    with pytest.raises(InputError, match="at least 10"):
        predict(np.zeros(100), NORMAL, np.zeros(2), draws=9)
    with pytest.raises(InputError, match="simulator is of"):
        predict(np.zeros(100), Drawing(("mean",), ("a",), NORMAL.draw), np.zeros(2))
    with pytest.raises(InputError, match="simulator is of a, other, the data of a, b"):
        predict(np.zeros(100), Drawing(("mean",), ("a", "other"), NORMAL.draw), np.zeros(2))
