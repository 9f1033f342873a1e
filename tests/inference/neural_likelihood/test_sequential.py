"""Posteriors by emulators beside exact ones: a plane, curves with noise that varies, failures; resuming, and words."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emcee.backends import HDFBackend
from helpers import wrong_types
from known_likelihoods import Known, curved, folded, fragile, linear
from scipy.stats import chi2

from yeastfit import InputError
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.neural_likelihood.training_rounds import Neighbourhood, far_draws, proposed
from yeastfit.inference.posterior.emcee_file import write_chains
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.samplers import infer
from yeastfit.inference.simulator import seed_of
from yeastfit.inference.store.simulation_store import Store
from yeastfit.inference.store.simulations import Simulations

NETWORKS = TrainingSettings(members=4)
FEW = TrainingSettings(members=2, width=16, steps=200)
SETTINGS = SequentialEmulator(first=1024, simulations=3072, batch=1024, training=NETWORKS)
SMALL = SequentialEmulator(first=64, simulations=128, settle=1e-6, walkers=32, most_steps=500, training=FEW)
TRUTH = (1.3, 0.8)


def anything(values: np.ndarray) -> np.ndarray:
    return np.ones(len(values), dtype=bool)


@pytest.fixture(scope="module")
def undisturbed() -> Posterior:
    """Two small rounds of `linear`, of data with seed 4, by seed 7."""
    known = linear()
    with wrong_types():
        return emulated(known, known, known.observed(TRUTH, 1, seed=4), SMALL, seed=7)


def emulated(
    simulator: Any, known: Known, observed: np.ndarray, settings: SequentialEmulator, **more: Any
) -> Posterior:
    return infer(simulator, known.prior, observed, method=settings, **more)


def reported(posterior: Posterior) -> EmulatorDiagnostics:
    assert isinstance(posterior.diagnostics, EmulatorDiagnostics)
    return posterior.diagnostics


def compared(
    posterior: Posterior, known: Known, observed: np.ndarray, replicates: int
) -> tuple[np.ndarray, np.ndarray]:
    """Shift of the mean in posterior standard deviations, and ratio of standard deviations, in log λ."""
    mean, covariance = known.posterior(observed, replicates)
    sd = np.sqrt(np.diag(covariance))
    x = np.log(posterior.flat)
    return (x.mean(axis=0) - mean) / sd, x.std(axis=0) / sd


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_chains_that_end_with_most_steps_say_so() -> None:
    known = linear()
    for most, status in ((500, Status.CHAINS_TOO_SHORT), (20_000, Status.SETTLED)):
        settings = replace(SMALL, settle=10.0, walkers=4, most_steps=most)
        found = emulated(known, known, known.observed(TRUTH, 1, seed=4), settings, seed=7)
        assert found.status is status
        ended = f"chains ended after {most} steps, which is all that --most-steps (most_steps) allows: allow more"
        assert (ended in found.warnings) == (status is Status.CHAINS_TOO_SHORT)


def test_simulations_are_proposed_around_most_of_the_posterior() -> None:
    """w times as wide as a normal one; of one with 8 % of its draws on a trail half of them stay around the others."""
    prior = Prior.of(
        {name: {"distribution": "log-uniform", "low": np.exp(-20), "high": np.exp(20)} for name in ("a", "b")}
    )
    rng = np.random.default_rng(0)
    body = rng.standard_normal((9200, 2)) @ np.array([[0.1, -0.08], [0.0, 0.05]])
    wide = proposed(body, body, 20_000, 2.5, prior, anything, rng)
    np.testing.assert_allclose(np.cov(wide.T), 6.25 * np.cov(body.T), rtol=0.05)
    trail = body[:800] + rng.uniform(0.5, 3.0, (800, 1)) * [1.0, -0.8]
    both = np.concatenate([body, trail])
    around = proposed(both, both, 4000, 2.5, prior, anything, rng)
    off = np.einsum("rf,rf->r", around, np.linalg.solve(np.cov(body.T), around.T).T)
    assert np.mean(off < 2.5**2 * chi2.ppf(0.5, 2)) > 0.4
    assert np.mean(around[:, 0] > 0.5) > 0.05
    assert ((around[:, 0] > -1.5) & (around[:, 0] < 4.0)).all()


def test_simulations_are_proposed_where_colonies_are() -> None:
    """As wide as these, and √(w² − 1) times as wide as the draws; their neighbourhood is a w-th of that."""
    prior = Prior.of(
        {name: {"distribution": "log-uniform", "low": np.exp(-20), "high": np.exp(20)} for name in ("a", "b")}
    )
    rng = np.random.default_rng(1)
    draws = rng.standard_normal((20_000, 2)) @ np.array([[0.1, -0.08], [0.0, 0.05]])
    colonies = draws + 0.4 * rng.standard_normal(draws.shape)
    expected = np.cov(colonies.T) + 5.25 * np.cov(draws.T)
    found = proposed(draws, colonies, 40_000, 2.5, prior, anything, rng)
    np.testing.assert_allclose(np.cov(found.T), expected, atol=0.03 * expected.max())
    np.testing.assert_allclose(Neighbourhood.of(draws, colonies, 2.5).covariance, expected / 6.25)
    np.testing.assert_array_equal(Neighbourhood.of(draws, draws, 2.5).covariance, np.cov(draws.T))


def test_colonies_that_are_proposed_may_leave_the_prior() -> None:
    """A quarter do whose draw is at its end and who scatter so; none whose draw would leave it, none not admitted."""
    prior = Prior.of({"a": {"distribution": "log-uniform", "low": 0.1, "high": 10.0}})
    rng = np.random.default_rng(3)
    draws = np.log(0.1) + 0.2 * np.abs(rng.standard_normal((20_000, 1)))
    colonies = draws + 0.3 * rng.standard_normal(draws.shape)
    found = proposed(draws, colonies, 20_000, 2.5, prior, anything, rng)
    assert 0.15 < np.mean(found < np.log(0.1)) < 0.35
    assert found.min() > np.log(0.1) - 6 * 0.3
    admitted = proposed(draws, colonies, 20_000, 2.5, prior, lambda values: values[:, 0] > 0.08, rng)
    assert np.log(0.08) < admitted.min() < np.log(0.1)
    alone = proposed(draws, draws, 20_000, 2.5, prior, anything, rng)
    assert alone.min() >= np.log(0.1)


def test_an_emulator_keeps_to_where_its_posterior_is() -> None:
    """To the ellipsoid of 99 % of normal draws 1.6 w times as wide, where it holds the draws and enough simulations."""
    rng = np.random.default_rng(0)
    root = np.array([[0.1, 0.0], [-0.08, 0.05]])
    draws, simulated = rng.standard_normal((4000, 2)) @ root.T, 10.0 * rng.standard_normal((4000, 2)) @ root.T
    where = Neighbourhood(draws.mean(axis=0), np.cov(draws.T))
    known = where.kept_to(draws, simulated, 2.5, 64)
    assert known is not None
    share = chi2.cdf((1.6 * 2.5) ** 2 * chi2.ppf(0.99, 2) / 100, 2)
    np.testing.assert_allclose(known(simulated).mean(), share, atol=4 * np.sqrt(share * (1 - share) / 4000))
    assert where.kept_to(draws, simulated, 2.5, int(known(simulated).sum()) + 1) is None
    strays = np.concatenate([draws, np.full((5, 2), 30.0)])
    assert where.kept_to(strays, simulated, 2.5, 64) is None


def test_a_posterior_is_found_where_proposals_surround_it() -> None:
    """It may lie standard deviations off, but at most 5 % of it where no proposals are."""
    rng = np.random.default_rng(0)
    root = np.array([[0.1, 0.0], [-0.08, 0.05]])
    draws = rng.standard_normal((4000, 2)) @ root.T
    where = Neighbourhood(draws.mean(axis=0), np.cov(draws.T))
    sideways = root @ [1.0, 1.0]
    assert where.surrounds(draws, 2.5)
    assert where.surrounds(draws + 1.5 * sideways, 2.5)
    assert not where.surrounds(draws + 5.0 * sideways, 2.5)
    assert not where.surrounds(np.concatenate([draws, draws[:240] + 8.0 * sideways]), 2.5)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(
    "seed",
    [pytest.param(2, marks=pytest.mark.thorough), *(pytest.param(one, marks=pytest.mark.slow) for one in (6, 7))],
)
def test_a_mode_that_the_first_simulations_know_nothing_of_is_found(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both sides of log a = 0 explain the data alike; the first simulations are of one.

    Without a look elsewhere four seeds of eight end at one side; which do depends on the rounding of a machine.
    """
    known, anywhere = folded(), Problem.prior_values

    def one_side(problem: Problem, count: int, seed: int) -> np.ndarray:
        values = anywhere(problem, count, seed)
        return np.column_stack([np.exp(np.abs(np.log(values[:, 0]))), values[:, 1]])

    monkeypatch.setattr(Problem, "prior_values", one_side)
    networks = TrainingSettings(members=2, width=32)
    settings = SequentialEmulator(first=512, simulations=8192, batch=512, training=networks)
    found = emulated(known, known, np.array([1.0, 1.0]), settings, replicates=16, seed=seed)
    looks = reported(found).elsewhere
    assert found.settled
    assert looks
    assert looks[-1] < 0.05
    assert 0.4 < (found.flat[:, 0] < 1.0).mean() < 0.6


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_that_nobody_looked_elsewhere_is_said() -> None:
    """Where a posterior settles with the last simulations that are allowed."""
    known = linear()
    settings = replace(SETTINGS, simulations=2048)
    found = emulated(known, known, known.observed(TRUTH, 1, seed=1), settings, seed=0)
    assert found.settled
    assert [one for one in found.warnings if one.startswith("whether parameters far from these explain the data")]
    assert reported(found).elsewhere == ()


def test_draws_far_off_are_told_of() -> None:
    """Their share in both rounds, and where they are, in λ; nothing of a normal law."""
    prior = Prior.of({name: {"distribution": "log-uniform", "low": 1e-3, "high": 1e3} for name in ("a", "b")})
    body = 0.1 * np.random.default_rng(0).standard_normal((9600, 2))
    with_trail = np.concatenate([body, np.full((400, 2), np.log([5.0, 0.2]))])
    (said,) = far_draws(with_trail, np.concatenate([body, with_trail[-200:]]), prior)
    assert said.startswith(
        "4.0 % of the draws lie far from the others (a 5 to 5, b 0.2 to 0.2), 2.0 % did in the round"
    )
    (said,) = far_draws(with_trail, None, prior)
    assert "round before" not in said
    assert far_draws(body, with_trail, prior) == []


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("measured", [False, True])
def test_a_linear_gaussian_simulator_has_its_closed_form(measured: bool) -> None:
    """With log λ ~ N(0, 1) before the data its posterior is N(V MᵀW o, V), V = (MᵀWM + 1)⁻¹, W with the noise."""
    normal = {"distribution": "log-normal", "median": 1.0, "sd": 1.0}
    known = replace(linear(), prior=Prior.of({"a": normal, "b": normal}))
    observed = known.observed(TRUTH, 1, seed=1)
    scatter = known.moments(np.ones((1, 2)))[1][0]
    noise = 2.0 * scatter + 0.5 * np.trace(scatter) if measured else None
    found = emulated(known, known, observed, SETTINGS, noise=noise, seed=0)
    slopes = known.moments(np.exp(np.eye(2)))[0].T
    weighted = np.linalg.solve(scatter if noise is None else scatter + noise, slopes)
    covariance = np.linalg.inv(slopes.T @ weighted + np.eye(2))
    x = np.log(found.flat)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((x.mean(axis=0) - covariance @ weighted.T @ observed) / sd, 0.0, atol=0.15)
    np.testing.assert_allclose(x.std(axis=0) / sd, 1.0, atol=0.1)
    np.testing.assert_allclose(np.corrcoef(x.T)[0, 1], covariance[0, 1] / sd.prod(), atol=0.1)
    assert found.sentences() == []
    assert found.simulations == reported(found).rounds[-1].simulations + 512 <= 3072  # half a round looked elsewhere
    assert reported(found).elsewhere == (0.0,)
    assert (found.effective_size > 1000).all()


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_curved_means_and_noise_that_depends_on_the_parameters() -> None:
    known = curved()
    observed = known.observed(TRUTH, 5, seed=2)
    found = emulated(known, known, observed, SETTINGS, replicates=5, seed=0)
    shift, ratio = compared(found, known, observed, 5)
    np.testing.assert_allclose(shift, 0.0, atol=0.25)
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)
    predicted = found.statistics.reshape(-1, 3)
    assert (np.abs(predicted.mean(axis=0) - observed) < 2 * predicted.std(axis=0)).all()


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_failures_count_as_evidence() -> None:
    """Six data sets that did not fail tell against λ at which simulations fail."""
    known = fragile()
    observed = known.observed((2.4, 0.8), 6, seed=3)
    found = emulated(known, known, observed, replace(SETTINGS, simulations=6144), replicates=6, seed=0)
    assert found.sentences() == []
    shift, ratio = compared(found, known, observed, 6)
    np.testing.assert_allclose(shift, 0.0, atol=0.3)
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)
    blind = replace(known, fails=lambda values: np.zeros(len(values)))
    assert compared(found, blind, observed, 6)[0].min() < -0.5


def test_data_that_the_prior_does_not_reach_are_told_of() -> None:
    known = linear()
    observed = known.observed(TRUTH, 1, seed=4)
    observed[0] = 40.0
    said = emulated(known, known, observed, replace(SMALL, simulations=64), seed=7).warnings
    assert any(f"{known.labels[0]} was observed as 40, the prior's simulations have" in one for one in said)


class Stops:
    """A simulator that comes to an end after so many rows."""

    def __init__(self, known: Known, rows: int) -> None:
        self.known, self.rows = known, rows
        self.parameters, self.observables = known.parameters, known.observables

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        self.rows -= len(values)
        if self.rows < 0:
            raise KeyboardInterrupt
        return self.known(values, seeds)


@pytest.mark.usefixtures("unchecked")
def test_a_run_that_was_stopped_goes_on_to_the_same_bits(tmp_path: Path, undisturbed: Posterior) -> None:
    known = linear()
    observed = known.observed(TRUTH, 1, seed=4)
    assert len(reported(undisturbed).rounds) == 2
    for rows in (40, 100):
        with (
            Store(tmp_path / f"{rows}.h5", known.free, known.labels) as store,
            pytest.raises(KeyboardInterrupt),
        ):
            emulated(Stops(known, rows), known, observed, SMALL, seed=7, store=store)
    with Store(tmp_path / "100.h5", known.free, known.labels) as store:
        kept = len(store)
        again = emulated(Stops(known, 128 - kept), known, observed, SMALL, seed=7, store=store)
    assert kept == 96
    np.testing.assert_array_equal(again.values, undisturbed.values)
    np.testing.assert_array_equal(again.statistics, undisturbed.statistics)
    other = emulated(known, known, observed, SMALL, seed=8)
    assert (other.values[:, :10] != undisturbed.values[:, :10]).all()


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_a_longer_run_has_use_for_all_of_a_shorter_one(tmp_path: Path) -> None:
    """Although its last round was a part of one."""
    known = linear()
    observed = known.observed(TRUTH, 1, seed=4)
    with Store(tmp_path / "simulations.h5", known.free, known.labels) as store:
        short = emulated(known, known, observed, replace(SMALL, simulations=100), seed=7, store=store)
        assert short.simulations == len(store) == 100
        emulated(known, known, observed, SMALL, seed=7, store=store)
        assert len(store) == 128
        once = emulated(known, known, observed, replace(SMALL, simulations=64), seed=7, store=store)
    assert "not settled: whether one round more would move it is not known" in "\n".join(once.warnings)


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_simulations_of_other_runs_are_learnt_from(undisturbed: Posterior) -> None:
    known = linear()
    observed = known.observed(TRUTH, 1, seed=4)
    own = known.prior.quantile(np.random.default_rng(1).random((300, len(known.free))))
    outside = own.copy()
    outside[:, 0] = 1e6
    values, seeds = np.concatenate([own, outside]), np.arange(600).astype(np.uint64)
    statistics = known(values, seeds)
    store = Simulations(known.free, known.labels)
    store.reuse(values, seeds, statistics)
    found = emulated(known, known, observed, replace(SMALL, simulations=192), seed=7, store=store)
    assert [one.simulations for one in reported(found).rounds] == [364, 428, 492]
    assert (found.simulations, reported(found).reused) == (192, 300)
    first, seeds = Problem(known, known.prior, observed).prior_values(64, 7), seed_of(7, range(64))
    store = Simulations(known.free, known.labels)
    store.reuse(first, seeds, known(first, seeds))
    np.testing.assert_array_equal(
        emulated(known, known, observed, SMALL, seed=7, store=store).values, undisturbed.values
    )
    with wrong_types(), pytest.raises(InputError, match="reuse: values and statistics have shapes"):
        store.reuse(first, seeds, known(first, seeds)[:5])


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_posteriors_save_what_the_emulator_said(tmp_path: Path) -> None:
    known = linear()
    heard = list[tuple[str, float]]()
    networks = replace(FEW, members=5)  # fewer disagree in fewer directions than 4 statistics
    settings = replace(SMALL, simulations=192, training=networks)
    found = emulated(
        known,
        known,
        known.moments(np.array([TRUTH]))[0][0],
        settings,
        replicates=50_000,
        seed=1,
        progress=lambda what, share: heard.append((what, share)),
    )
    assert found.values.shape[1] >= 50  # however long the chains hang together
    assert "the posterior has not settled: it moved by" in "\n".join(found.warnings)
    assert "of the variance of the data and widens the posterior" in "\n".join(found.warnings)
    assert [what for what, _ in heard] == ["round 1", "round 2", "done"]
    found.save(tmp_path / "posterior.npz")
    back = Posterior.load(tmp_path / "posterior.npz")
    assert reported(back).rounds[-1].cross_validation.labels == ("s0", "s1", "s2", "s3")
    for one, other in zip(reported(back).rounds, reported(found).rounds, strict=True):
        assert (one.moved, one.error_share) == (other.moved, other.error_share)
        np.testing.assert_array_equal(one.cross_validation.covariance, other.cross_validation.covariance)
    assert back.sentences() == found.sentences()
    assert back.method == "emulator"
    assert back.status is found.status is Status.STILL_MOVING
    assert back.replicates == 50_000
    assert found.backend is not None
    write_chains(tmp_path / "chains.h5", found.backend)
    chains = HDFBackend(tmp_path / "chains.h5", read_only=True)
    assert chains.iteration == reported(found).steps == 500
    draws = np.swapaxes(found.values, 0, 1)
    kept = [  # how many are burn-in, and how far apart the others are, is a matter of how long they hang together
        chains.get_chain(discard=burnt, thin=thin)
        for thin in range(1, 6)
        for burnt in range(251)
        if (500 - burnt) // thin == len(draws)
    ]
    values = known.prior.values(np.reshape(kept, (-1, 2))).reshape(-1, *draws.shape)
    assert (values == draws).all(axis=(1, 2, 3)).any()
    np.testing.assert_allclose(chains.accepted / 500, found.acceptance)
    assert len(chains.get_last_sample().random_state) == 5


def test_what_is_refused() -> None:
    known = linear()
    observed = np.zeros(4)
    with pytest.raises(InputError, match=r"observed is .* 4 finite statistics are expected"):
        emulated(known, known, np.zeros(3), SMALL)
    with pytest.raises(InputError, match="replicates is 0, it must be at least 1"):
        emulated(known, known, observed, SMALL, replicates=0)
    for replicates, told in ((2.5, "2.5"), (True, "true"), (np.nan, "nan")):
        with wrong_types(), pytest.raises(InputError, match=f"replicates is {told}, it must be a whole number"):
            emulated(known, known, observed, SMALL, replicates=replicates)
    lopsided, contrary, flawed = np.eye(4), np.diag([1e12, 1.0, 1.0, 1.0]), np.eye(4)
    lopsided[0, 1], contrary[2, 3], contrary[3, 2], flawed[3, 3] = 0.5, 2.0, 2.0, np.nan
    for noise in (np.eye(3), -np.eye(4), lopsided, contrary, flawed, 0.1):
        with wrong_types(), pytest.raises(InputError, match="noise must be a covariance of 4 statistics"):
            emulated(known, known, observed, SMALL, noise=noise)
    with pytest.raises(InputError, match="first is 100, it must be a power of two"):
        SequentialEmulator(first=100)
    with pytest.raises(InputError, match="simulations is 64, it must be at least those of the first round, 512"):
        SequentialEmulator(first=512, simulations=64)
    with pytest.raises(InputError, match="simulations succeeded"):
        emulated(replace(known, fails=lambda values: np.ones(len(values))), known, observed, SMALL)
    with pytest.raises(InputError, match=r"the first round has 16 simulations, .* needs at least 24"):
        emulated(known, known, observed, replace(SMALL, first=16))


def test_the_first_round_is_as_large_as_the_budget_and_the_parameters_ask_for() -> None:
    sizes = [SequentialEmulator(simulations=most).round_sizes(2) for most in (4096, 512, 96)]
    assert sizes == [(512, 512), (256, 256), (64, 64)]
    assert SequentialEmulator(first=128, each=32).round_sizes(2) == (128, 32)
    assert SequentialEmulator(simulations=96).resolved(2).first == 64


@pytest.mark.slow
def test_ranks_of_the_truth_are_uniform() -> None:
    """Simulation-based calibration (Talts et al. 2018, arXiv:1804.06788) over draws from the prior."""
    known = curved()
    ranks = []
    for number in range(40):
        truth = known.prior.sample(1, np.random.default_rng(number))[0]
        observed = known.observed(tuple(truth), 3, seed=1000 + number)
        found = emulated(known, known, observed, SETTINGS, replicates=3, seed=number)
        ranks.append((found.flat < truth).mean(axis=0))
    shares = np.sort(np.array(ranks), axis=0)
    expected = (np.arange(40) + 0.5) / 40
    assert np.abs(shares - expected[:, None]).max() < 1.63 / np.sqrt(40)  # Kolmogorov–Smirnov at 1 %
