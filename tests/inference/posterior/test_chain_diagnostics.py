"""Diagnostics on chains whose autocorrelation is known, and on chains that are wrong in known ways."""

import numpy as np
import pytest
from emcee.autocorr import integrated_time

from yeastfit import InputError
from yeastfit.inference.posterior.chain_diagnostics import (
    ChainDiagnostics,
    autocorrelation_time,
    diagnose,
    rank_statistics,
    split_r_hat,
)


def autoregressive(coefficient: float, chains: int = 8, draws: int = 20000, seed: int = 0) -> np.ndarray:
    """x_t = φ x_(t−1) + noise, started in its stationary state, of variance 1 in two parameters."""
    rng = np.random.default_rng(seed)
    values = np.zeros((chains, draws, 2))
    values[:, 0] = rng.normal(size=(chains, 2))
    for t in range(1, draws):
        noise = np.sqrt(1 - coefficient**2) * rng.normal(size=(chains, 2))
        values[:, t] = coefficient * values[:, t - 1] + noise
    return values


def diagnosed(values: np.ndarray, acceptance: float = 0.4) -> ChainDiagnostics:
    return diagnose(values, free=("a", "b"), acceptance=np.full(len(values), acceptance))


@pytest.mark.parametrize("coefficient", [0.0, 0.5, 0.9])
def test_autocorrelation_time_of_a_first_order_process(coefficient: float) -> None:
    """τ = (1 + φ) / (1 − φ)."""
    times = autocorrelation_time(autoregressive(coefficient))
    np.testing.assert_allclose(times, (1 + coefficient) / (1 - coefficient), rtol=0.06)


def test_autocorrelation_times_agree_with_emcee_on_long_chains() -> None:
    values = autoregressive(0.9, chains=6, draws=10000)
    np.testing.assert_allclose(autocorrelation_time(values), integrated_time(values.transpose(1, 0, 2)), rtol=0.03)


def test_short_chains_are_not_worth_more_than_they_are() -> None:
    """How far the mean of short chains scatters, over many repetitions, in units of what their own estimate says."""
    values = autoregressive(0.97, chains=1600, draws=120).reshape(200, 8, 120, 2)
    squares = values.mean(axis=(1, 2)) ** 2 * 960
    ours, emcees = (
        np.sqrt(np.mean(squares / [time(one) for one in values]))
        for time in (autocorrelation_time, lambda one: integrated_time(one.transpose(1, 0, 2), tol=0))
    )
    assert 0.6 < ours < 1.1
    assert emcees > 1.3


def test_good_chains_are_said_to_be_good() -> None:
    found = diagnosed(autoregressive(0.8, draws=4000))
    assert found.sentences() == []
    assert found.converged
    np.testing.assert_allclose(found.effective_size, 8 * 4000 / 9, rtol=0.15)
    np.testing.assert_allclose(found.lengths, 4000 / 9, rtol=0.15)
    assert (found.r_hat < 1.01).all()
    np.testing.assert_allclose(found.ranks.sum(axis=2), 1.0)
    assert found.asdict()["r_hat"].keys() == {"a", "b"}


def test_the_mean_scatters_as_the_effective_size_says() -> None:
    means = np.array([autoregressive(0.7, chains=1, draws=1000, seed=seed).mean(axis=(0, 1)) for seed in range(100)])
    expected = np.sqrt(autocorrelation_time(autoregressive(0.7))[0] / 1000)
    np.testing.assert_allclose(means.std(), expected, rtol=4 / np.sqrt(2 * means.size))


def test_chains_that_differ_in_place_or_in_spread_have_a_large_r_hat() -> None:
    values = autoregressive(0.0, chains=4, draws=500)
    values[0, :, 0] += 1.0
    values[0, :, 1] *= 3.0
    found = diagnosed(values)
    assert (found.r_hat > 1.05).all()
    assert (found.unequal < 1e-6).all()
    said = [line for line in found.sentences() if "chains do not agree, split R̂ is 1." in line]
    assert [line.split(":")[0] for line in said] == ["a", "b"]
    assert found.effective_size[0] < 20  # what chains differ by does not average out


def test_a_drifting_chain_disagrees_with_itself() -> None:
    values = autoregressive(0.0, chains=1, draws=1000)
    values[0, :, 0] += np.linspace(0, 2, 1000)
    drifting, steady = split_r_hat(values)
    assert drifting > 1.05
    assert steady < 1.01


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_p_values_of_ranks_are_uniform_where_chains_agree(memory: float) -> None:
    found = [autoregressive(memory, chains=4, draws=2000, seed=seed) for seed in range(60)]
    shares = np.array([rank_statistics(one)[2] for one in found]).ravel()
    assert abs(shares.mean() - 0.5) < 4 / np.sqrt(12 * len(shares))
    assert shares.min() > 1e-4


def test_ranks_of_short_chains_that_agree() -> None:
    """Five autocorrelation times are too few to know them by: p-values lean to the upper side, and not to 0."""
    found = [rank_statistics(autoregressive(0.9, chains=32, draws=100, seed=seed)) for seed in range(20)]
    assert 0.5 < np.mean([one[2] for one in found]) < 0.9
    off = [((shares - 0.1) / chance[:, None]).std() for shares, chance, _ in found]
    assert np.mean(off) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("chains", [4, 10, 20])
@pytest.mark.parametrize("width", [0.0, 1.0])
def test_ranks_of_chains_that_never_meet(chains: int, width: float) -> None:
    """Each in bins of its own, which are then left by none."""
    values = width * autoregressive(0.5, chains=chains, draws=200) + 100.0 * np.arange(chains)[:, None, None]
    assert (rank_statistics(values)[2] < 1e-6).all()


def test_ranks_of_chains_that_seldom_leave_a_tail() -> None:
    """Draws forget at once, but for whether they are in the tail: a tenth of them is, for ten draws at a time."""
    p_values, shares = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        tail, chance = np.empty((32, 800), dtype=bool), rng.random((32, 800))
        tail[:, 0] = chance[:, 0] < 0.1
        for t in range(1, 800):
            tail[:, t] = np.where(tail[:, t - 1], chance[:, t] < 0.9, chance[:, t] < 0.1 / 9)
        found = rank_statistics((rng.standard_normal(tail.shape) + 10.0 * tail)[..., None])
        p_values.append(found[2][0])
        shares.append(((found[0][0] - 0.1) / found[1][0]).std(axis=0))
    assert abs(np.mean(p_values) - 0.5) < 0.25
    np.testing.assert_allclose(np.mean(shares, axis=0), 1.0, atol=0.1)


def test_short_and_stuck_chains_in_words() -> None:
    short = diagnosed(autoregressive(0.9, draws=100), acceptance=0.01)
    said = "\n".join(short.sentences())
    assert "chains are too short for a: 100 draws are" in said
    assert "8 of 8 chains accept 1.0 to 1.0 % of proposals, 5 to 95 % are usual" in said
    still = diagnosed(np.ones((2, 50, 2)), acceptance=0.0)
    assert np.isinf(still.times).all()
    assert (still.effective_size == 1).all()
    assert not still.converged
    assert "it does not move" in still.sentences()[0]


def test_what_is_refused() -> None:
    with pytest.raises(InputError, match=r"values have shape \(2, 3, 2\).*at least 4"):
        diagnosed(np.zeros((2, 3, 2)))
