"""Regression adjustment: its map to the line, and what it leaves alone."""

from dataclasses import replace

import numpy as np
import pytest

from yeastfit.inference.abc.regression_adjustment import Accepted, from_line, to_line
from yeastfit.inference.prior.prior import Prior

INF = np.inf
PRIOR = Prior.of({"a": {"distribution": "normal", "mean": 0.0, "sd": 10.0}})


def accepted(seed: int, *, off: float = 0.0, draws: int = 40, chains: int = 0) -> Accepted:
    """λ = s₁ − s₂ / 2 + N(0, 1), for s normal, observed `off` their middle; of an AR(1) with 0.9 where of chains."""
    rng, observed = np.random.default_rng(seed), np.array([off, 0.0])
    if chains:
        noise = rng.standard_normal((chains, draws, 3))
        for k in range(1, draws):
            noise[:, k] = 0.9 * noise[:, k - 1] + np.sqrt(1 - 0.9**2) * noise[:, k]
        noise = noise.reshape(-1, 3)
    else:
        noise = rng.standard_normal((draws, 3))
    statistics, weights = noise[:, :2], np.full(len(noise), 1 / len(noise))
    values = statistics @ np.array([[1.0], [-0.5]]) + noise[:, 2:]
    distances = np.sqrt(np.sum((statistics - observed) ** 2, axis=1))
    return Accepted(values, weights, statistics, distances, observed, PRIOR)


@pytest.mark.parametrize(
    "ends", [(0.2, 5.0), (0.0, 1.0), (-2.0, 3.0), (0.0, INF), (0.5, INF), (-INF, 4.0), (-INF, INF)]
)
def test_the_line_and_back(ends: tuple[float, float]) -> None:
    values = np.linspace(max(ends[0], -5.0), min(ends[1], 9.0), 50)[1:-1]
    u = to_line(values, *ends)
    np.testing.assert_allclose(from_line(u, *ends), values, rtol=1e-12)
    assert (np.diff(u) > 0).all()
    far = from_line(np.array([-50.0, 50.0]), *ends)
    assert ((far >= ends[0]) & (far <= ends[1])).all()


def test_ends_of_the_support_are_finite_on_the_line() -> None:
    assert np.isfinite(to_line(np.array([0.0, 1.0]), 0.0, 1.0)).all()
    assert np.isfinite(to_line(np.array([0.2, 5.0]), 0.2, 5.0)).all()


def test_a_straight_line_is_taken_out_whatever_the_units() -> None:
    prior = Prior.of({"a": {"distribution": "log-normal", "median": 1.0, "sd": 1.0}})
    rng = np.random.default_rng(0)
    statistics, weights = rng.normal(size=(200, 2)) * [1e-6, 1e3], np.full(200, 1 / 200)
    values = 3.0 * np.exp(statistics @ [4e5, -2e-4])[:, None]
    found, near, said = Accepted(values, weights, statistics, rng.random(200), np.zeros(2), prior).adjusted()
    np.testing.assert_allclose(found, 3.0, rtol=1e-9)
    assert near.sum() == pytest.approx(1.0)
    assert said == []


def test_a_statistic_that_never_varies_does_no_harm() -> None:
    prior = Prior.of({"a": {"distribution": "normal", "mean": 0.0, "sd": 1.0}})
    rng = np.random.default_rng(1)
    statistics = np.column_stack([rng.normal(size=100), np.full(100, 0.1)])
    values, weights = 2.0 * statistics[:, :1], np.full(100, 0.01)
    found, _, _ = Accepted(values, weights, statistics, rng.random(100), np.zeros(2), prior).adjusted()
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_draws_that_all_lie_at_no_distance_weigh_the_same() -> None:
    """A distance that leaves out a statistic, such as Li's with area, may be 0 throughout while that one varies."""
    prior = Prior.of({"a": {"distribution": "normal", "mean": 0.0, "sd": 1.0}})
    statistics = np.random.default_rng(1).normal(size=(100, 1))
    even = np.full(100, 0.01)
    found, weights, said = Accepted(2 * statistics, even, statistics, np.zeros(100), np.zeros(1), prior).adjusted()
    np.testing.assert_allclose(found, 0.0, atol=1e-12)
    np.testing.assert_allclose(weights, 0.01)
    assert said == []


def test_too_few_draws_are_left_as_they_were() -> None:
    prior = Prior.of({"a": {"distribution": "normal", "mean": 0.0, "sd": 1.0}})
    values, weights = np.arange(6.0)[:, None], np.full(6, 1 / 6)
    statistics = np.random.default_rng(2).normal(size=(6, 3))
    found, same, said = Accepted(values, weights, statistics, np.arange(6.0) / 6, np.zeros(3), prior).adjusted()
    np.testing.assert_array_equal(found, values)
    np.testing.assert_array_equal(same, weights)
    assert said[0].startswith("not adjusted: 5 independent draws, a regression needs 16")
    nothing = Accepted(values, weights, statistics, np.full(6, 2.0), np.zeros(3), prior).adjusted()
    assert nothing[2] == ["not adjusted: 0 independent draws, a regression needs 16"]


@pytest.mark.usefixtures("unchecked")
def test_few_draws_scatter_as_widely_as_many() -> None:
    """Residuals of 20 draws about a fit of three coefficients lack a tenth of the variance, which is put back."""
    found = []
    for seed in range(1000):
        values, weights, _ = accepted(seed, draws=20).adjusted()
        found.append(weights @ (values - weights @ values) ** 2)
    assert np.mean(found) == pytest.approx(1.0, abs=0.03)


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    ("off", "chains", "least"), [(0.0, 0, 0.8), (2.0, 0, 2.0), (0.0, 16, 2.5)], ids=["middle", "edge", "chains"]
)
def test_means_of_adjusted_draws_scatter_as_they_are_worth(off: float, chains: int, least: float) -> None:
    """λ observed is off ± 1. By weights alone errors are too small at the edge, and of chains."""
    scores, plain = [], []
    for seed in range(150):
        draws = accepted(seed, off=off, draws=60, chains=chains)
        values, weights, said = draws.adjusted()
        assert said == []
        mean = weights @ values
        shift = (mean - off) / np.sqrt(weights @ (values - mean) ** 2)
        scores.append(shift * np.sqrt(draws.worth(parts=chains or 60)))
        plain.append(shift / np.sqrt(np.sum(weights**2)))
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.15)
    assert np.sqrt(np.mean(np.square(plain))) > least


def test_draws_are_worth_no_more_than_their_weights_allow() -> None:
    draws = accepted(3)
    _, near, _ = draws.adjusted()
    straight = draws.statistics @ np.array([[1.0], [-0.5]])  # known exactly, however few the draws
    np.testing.assert_allclose(replace(draws, values=straight).worth(), 1 / np.sum(near**2))
    assert (draws.worth(parts=1) >= 1).all()
    same = np.broadcast_to(draws.observed, draws.statistics.shape)  # all at the observation: nothing is adjusted
    at = replace(draws, statistics=same, distances=np.zeros(40))
    assert at.worth() == pytest.approx(40, rel=0.05)
