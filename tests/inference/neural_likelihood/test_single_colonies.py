"""Single colonies whose parameters scatter: their likelihood beside a dense one, and what is inferred of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types
from known_likelihoods import Known, Positive, curved, fragile, linear, positive, simulations
from scipy.special import ndtr, ndtri
from scipy.stats import multivariate_normal

from benchmarks import variation as study
from benchmarks.variation_models import ClosedForm, Studied, closed_form_prior
from yeastfit import InputError, Posterior, infer
from yeastfit.inference.neural_likelihood import sequential
from yeastfit.inference.neural_likelihood.densities import densities
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.log_posterior import LogPosterior
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.rounds import EmulatorDiagnostics
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.neural_likelihood.single_colonies import (
    excess_scatter,
    likelihood_of_colonies,
)
from yeastfit.inference.neural_likelihood.training import train
from yeastfit.inference.neural_likelihood.training_rounds import proposed
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.places import Places
from yeastfit.inference.prior.variation import ColonyCoordinates, Variation, Varied, absent
from yeastfit.inference.simulator import Simulator

FEW = TrainingSettings(members=3, width=16, steps=200)
SMALL = SequentialEmulator(first=128, simulations=128, walkers=32, most_steps=500, training=FEW)


def emulator_of(known: Known) -> Emulator:
    values, statistics = simulations(known, 512, 0)
    return train(values, statistics, prior=known.prior, labels=known.labels, seed=0, settings=FEW)


@pytest.fixture(scope="module")
def plane() -> tuple[Positive, Emulator]:
    known = positive(linear())
    return known, emulator_of(known)


def likelihood(emulator: Emulator, problem: Problem, values: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Log p of the colonies at λ and τ(z), by z of this τ."""
    assert problem.variation is not None
    zero, sd = problem.variation.zero, problem.variation.sd
    z = -ndtri((1 - zero) * 2 * ndtr(-tau / sd))
    np.testing.assert_allclose(problem.variation.tau(z), tau, atol=1e-12)
    rows = np.column_stack([problem.prior.coordinates(values), z])
    return densities(likelihood_of_colonies(emulator, problem), rows)


def dense(known: Known, emulator: Emulator, problem: Problem, values: np.ndarray, tau: float) -> float:
    """log p of all colonies as one long normal vector, without those entries that are missing."""
    assert problem.colonies is not None
    places = ColonyCoordinates.of(known.parameters, problem.varying).around(values[None], np.array([tau]))
    mean, scatter, error, success = emulator.moments(places)
    spread = scatter[0] if problem.colony_noise is None else scatter[0] + problem.colony_noise
    common = error[0] if problem.noise is None else error[0] + problem.noise
    count = len(problem.colonies)
    whole = np.kron(np.eye(count), spread) + np.kron(np.ones((count, count)), common)
    there = np.isfinite(problem.colonies.ravel())
    law = multivariate_normal(np.tile(mean[0], count)[there], whole[np.ix_(there, there)])
    return float(law.logpdf(problem.colonies.ravel()[there])) + count * np.log(success[0])


def test_a_scatter_without_end_has_no_density(plane: tuple[Positive, Emulator]) -> None:
    """τ(z) is infinite from z = 38 on, where proposals may lie."""
    known, emulator = plane
    rows = known(np.tile([1.3, 0.8], (6, 1)), np.arange(6))
    density = LogPosterior(emulator, Problem.of(known, known.prior, rows, variation=Variation()))
    found = density(np.array([[0.2, -0.2, 1.0], [0.2, -0.2, 40.0]]))
    assert np.isfinite(found[0])
    assert found[1] == -np.inf


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("missing", [False, True])
def test_the_likelihood_is_that_of_all_colonies_as_one_vector(
    plane: tuple[Positive, Emulator], missing: bool, alone: bool
) -> None:
    """Also where one parameter varies alone."""
    known, emulator = plane
    rows = known(np.tile([1.3, 0.8], (6, 1)), np.arange(6))
    if missing:
        rows[0, 1] = rows[1, 1] = rows[3, [0, 2]] = np.nan
    noise = np.diag([0.02, 0.1, 0.05, 0.01]) + 0.01
    variation = Variation(varying=known.parameters.names[1:] if alone else ())
    problem = Problem.of(known, known.prior, rows, noise=noise, colony_noise=2 * noise, variation=variation)
    around = problem.places(np.ones((1, 2)), np.ones((1, 1)))
    assert isinstance(around, Places)
    assert around.values.shape[1] == (3 if alone else 5)
    places = np.array([[1.3, 0.8], [1.1, 1.0], [1.5, 0.7]])
    tau = np.array([0.0, 0.2, 0.5])
    found = likelihood(emulator, problem, places, tau)
    expected = [dense(known, emulator, problem, *each) for each in zip(places, tau.tolist(), strict=True)]
    np.testing.assert_allclose(found, expected, rtol=2e-4)


def test_without_scatter_it_differs_from_that_of_the_mean_by_what_their_scatter_says(
    plane: tuple[Positive, Emulator],
) -> None:
    """Where C does not depend on λ, the two have the same shape: log p(o_1 … o_R | λ, 0) − log p(ō | λ) is constant."""
    known, emulator = plane
    rows = known(np.tile([1.3, 0.8], (7, 1)), np.arange(7))
    problem = Problem.of(known, known.prior, rows, variation=Variation())
    places = known.prior.quantile(0.35 + 0.3 * np.random.default_rng(0).random((40, 2)))
    of_rows = likelihood(emulator, problem, places, np.zeros(40))
    of_mean = emulator.log_likelihood(places, rows.mean(axis=0), 7)
    left = of_rows - of_mean - (of_rows - of_mean).mean()
    assert np.abs(left).max() < 0.1 * np.ptp(of_mean)
    assert np.corrcoef(of_rows, of_mean)[0, 1] > 0.999


def sampled(
    emulator: Emulator, values: np.ndarray, tau: float, coordinates: ColonyCoordinates, count: int = 8000
) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance of colonies that succeed, and how many do, by many λ_r through the same emulator."""
    draws = np.random.default_rng(1).standard_normal((count, values.shape[1]))
    mean, scatter, _, success = emulator.moments(coordinates.moved(np.tile(values, (count, 1)), tau * draws))
    share = success / success.sum()
    middle = share @ mean
    between = np.einsum("r,ri,rj->ij", share, mean - middle, mean - middle)
    return middle, np.einsum("r,rij->ij", share, scatter) + between, float(success.mean())


@pytest.mark.thorough
@pytest.mark.parametrize("tau", [0.0, 0.2, 0.5])
def test_moments_of_colonies_are_those_at_scattered_parameters(tau: float) -> None:
    """Cubature against sampling through the same emulator, of a curved mean, beside first order, which is farther."""
    known = positive(curved())
    emulator, coordinates = emulator_of(known), ColonyCoordinates.of(known.parameters)
    for values in np.array([[[1.2, 0.9]], [[0.8, 1.3]]]):
        mean, scatter, _, _ = emulator.moments(coordinates.around(values, np.array([tau])))
        alone, one, _, _ = emulator.moments(values)
        exact, spread, _ = sampled(emulator, values, tau, coordinates)
        sd = np.sqrt(np.diag(spread))
        np.testing.assert_allclose(mean[0], exact, atol=0.05 * sd.max())
        np.testing.assert_allclose(np.sqrt(np.diag(scatter[0])), sd, rtol=0.12)
        if tau == 0.5:
            above, below = (emulator.moments(coordinates.moved(values, h * np.eye(2)))[0] for h in (1e-2, -1e-2))
            slopes = (above - below) / 2e-2
            first = one[0] + tau**2 * slopes.T @ slopes
            assert np.abs(mean[0] - exact).max() < 0.2 * np.abs(alone[0] - exact).max()
            assert np.abs(scatter[0] - spread).max() < np.abs(first - spread).max()


def test_a_place_counts_by_its_share(plane: tuple[Positive, Emulator]) -> None:
    """A share of a half is as much as a place that is given twice of four; a success is as likely as its shares say."""
    values = np.array([[[1.2, 0.9], [0.8, 1.3], [1.5, 0.7]], [[0.4, 1.0], [2.5, 1.1], [0.9, 1.0]]])
    by_share = Places(values, np.array([0.5, 0.25, 0.25]))
    repeated = Places(values[:, [0, 0, 1, 2]], np.full(4, 0.25))
    failing = emulator_of(positive(fragile()))
    for emulator in (plane[1], failing):
        for found, expected in zip(emulator.moments(by_share), emulator.moments(repeated), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
        np.testing.assert_allclose(emulator.success_error(by_share), emulator.success_error(repeated), rtol=1e-5)
        rng = np.random.default_rng(0), np.random.default_rng(0)
        np.testing.assert_allclose(emulator.draw(by_share, rng[0]), emulator.draw(repeated, rng[1]), rtol=1e-3)
    each = failing.moments(values[0])[3]
    np.testing.assert_allclose(failing.moments(by_share)[3][0], by_share.shares @ each, rtol=1e-5)
    assert np.ptp(each) > 0.01


def test_moments_of_colonies_of_a_plane_are_exact(plane: tuple[Positive, Emulator]) -> None:
    """C + τ² J Jᵀ about the mean at λ, for a mean that is linear in log λ, up to what the emulator makes of it."""
    known, emulator = plane
    values, tau = np.array([[1.2, 0.9]]), 0.3
    coordinates = ColonyCoordinates.of(known.parameters)
    slopes = known.moments(np.exp(np.eye(2)))[0].T
    alone, one, _, _ = emulator.moments(values)
    mean, scatter, _, _ = emulator.moments(coordinates.around(values, np.array([tau])))
    exact = one[0] + tau**2 * slopes @ slopes.T
    assert np.abs(scatter[0] - exact).max() < 0.15 * np.diag(exact).max()
    np.testing.assert_allclose(mean[0], alone[0], atol=0.1 * np.sqrt(np.diag(exact)).max())
    same = emulator.moments(coordinates.around(values, np.zeros(1)))
    for found, expected in zip(same, emulator.moments(values), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


@pytest.mark.thorough
@pytest.mark.parametrize("tau", [0.0, 0.3, 0.8])
def test_colonies_that_succeed_are_those_at_scattered_parameters(tau: float) -> None:
    """Cubature against sampling through the same emulator, of a probability that falls with a."""
    known = positive(fragile())
    emulator, coordinates = emulator_of(known), ColonyCoordinates.of(known.parameters)
    values = np.array([[0.4, 1.0], [1.2, 0.9], [2.5, 1.1]])
    mean, scatter, _, success = emulator.moments(coordinates.around(values, np.full(3, tau)))
    for k, one in enumerate(values):
        middle, spread, share = sampled(emulator, one[None], tau, coordinates)
        np.testing.assert_allclose(success[k], share, atol=0.02 if tau else 1e-6)
        sd = np.sqrt(np.diag(spread))
        assert np.abs((mean[k] - middle) / sd).max() < 0.03
        np.testing.assert_allclose(scatter[k] / np.outer(sd, sd), spread / np.outer(sd, sd), atol=0.12)
    assert np.ptp(success) > 0.3
    rows = known.moments(np.tile(values[1], (5, 1)))[0]
    problem = Problem.of(known, known.prior, rows, variation=Variation())
    found = likelihood(emulator, problem, values[1:2], np.array([tau]))
    np.testing.assert_allclose(found, dense(known, emulator, problem, values[1], tau), rtol=2e-4)


@pytest.fixture(scope="module")
def small() -> study.Study:
    """The study's closed form with a small emulator."""
    model = Studied("closed form", closed_form_prior(), ClosedForm, 512, "")
    simulator = ClosedForm()
    problem = Problem(simulator, model.prior, np.zeros(5))
    values = problem.prior_values(512, 0)
    rows = simulator(values, np.arange(512))
    emulator = train(values, rows, prior=model.prior, labels=problem.labels, seed=0, settings=FEW)
    return study.Study(model, simulator, emulator)


@pytest.mark.thorough
@pytest.mark.parametrize("tau", [0.0, 0.3])
def test_scatter_is_found_and_intervals_are_right(small: study.Study, tau: float) -> None:
    """Of 12 sets: coverage of 80 to 100 % at 90 %, where taking all colonies for one λ has far less with scatter."""
    truth, found = np.array([1.5, 0.4, 0.7, tau]), list[tuple[float, float]]()
    hits, hits_of_one = list[bool](), list[bool]()
    for number in range(12):
        rows = Varied(small.simulator)(np.tile(truth, (14, 1)), 1000 * (number + 1) + np.arange(14))
        for variation, kept in ((Variation(), hits), (None, hits_of_one)):
            problem = Problem.of(small.simulator, small.model.prior, rows, variation=variation)
            told = study.posterior(LogPosterior(small.emulator, problem), problem, seed=number)
            low, high = np.array(told["q05"])[:3], np.array(told["q95"])[:3]
            kept.extend(((low <= truth[:3]) & (truth[:3] <= high)).tolist())
            if variation is not None:
                found.append((told["median"][3], told["absent"]))
    middle, absence = np.mean(found, axis=0)
    assert np.mean(hits) >= 0.8
    if tau:
        assert np.mean(hits_of_one) < 0.75
        assert abs(middle - tau) < 0.06
        assert absence < 0.01
    else:
        assert np.mean(hits_of_one) >= 0.8
        assert absence > 0.6
        assert middle < 0.03


def test_what_scatters_more_than_the_model_is_told_of(small: study.Study) -> None:
    truth = np.array([[1.5, 0.4, 0.7]])
    for tau, said in ((0.0, 0), (0.4, 1)):
        rows = Varied(small.simulator)(np.repeat(np.column_stack([truth, [[tau]]]), 14, axis=0), np.arange(14))
        problem = Problem.of(small.simulator, small.model.prior, rows)
        found = excess_scatter(small.emulator, problem, truth)
        assert len(found) == said
        assert all(one.startswith("the 14 replicates scatter ") for one in found)


@pytest.fixture(scope="module")
def inferred() -> tuple[Posterior, Posterior, np.ndarray]:
    """With variation and without, of the same rows."""
    simulator: Simulator = ClosedForm()
    rows = Varied(simulator)(np.tile([1.5, 0.4, 0.7, 0.3], (10, 1)), np.arange(50, 60))
    with wrong_types():
        found = [
            infer(simulator, closed_form_prior(), rows, method=SMALL, variation=one, seed=2)
            for one in (Variation(), None)
        ]
    return found[0], found[1], rows


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_rounds_simulate_where_single_colonies_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of colonies of a plane that scatter by 0.7 in log λ: proposals are of draws that scatter by τ; else of draws."""
    known, asked = positive(linear()), list[tuple[np.ndarray, np.ndarray]]()
    each = np.exp(np.random.default_rng(2).normal(np.log([1.3, 0.8]), 0.7, (40, 2)))
    rows = np.concatenate([known(one[None], np.array([k])) for k, one in enumerate(each)])

    def seen(draws: np.ndarray, colonies: np.ndarray, *rest: Any) -> np.ndarray:
        asked.append((draws, colonies))
        return proposed(draws, colonies, *rest)

    monkeypatch.setattr(sequential, "proposed", seen)
    settings = replace(SMALL, simulations=512, settle=1e-3)
    found = infer(known, known.prior, rows, method=settings, variation=Variation())
    assert isinstance(found.diagnostics, EmulatorDiagnostics)
    assert len(found.diagnostics.rounds) == len(asked) + 1 == 4
    draws, colonies = asked[-1]
    scatter = np.sqrt(colonies.var(axis=0) - draws.var(axis=0))
    np.testing.assert_allclose(scatter, found.mean[2], rtol=0.2)
    assert (colonies.std(axis=0) > 2 * draws.std(axis=0)).all()
    infer(known, known.prior, rows, method=settings)
    assert all(colonies is draws for draws, colonies in asked[3:])


@pytest.mark.usefixtures("unchecked")
def test_a_scatter_wider_than_its_prior_is_told_of() -> None:
    """By rows of a plane that scatter by 1 in every log λ, where the prior has 0.3; of 0.2 nothing is said."""
    known = positive(linear())
    for tau, told in ((1.0, True), (0.2, False)):
        each = np.exp(np.random.default_rng(2).normal(np.log([1.3, 0.8]), tau, (14, 2)))
        rows = np.concatenate([known(one[None], np.array([k])) for k, one in enumerate(each)])
        warnings = infer(known, known.prior, rows, method=SMALL, variation=Variation()).warnings
        assert any("colony_variation is" in one for one in warnings) is told


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_switched_off_it_is_the_posterior_of_the_mean_to_the_bit(
    inferred: tuple[Posterior, Posterior, np.ndarray],
) -> None:
    _, off, rows = inferred
    mean = infer(ClosedForm(), closed_form_prior(), rows.mean(axis=0), method=SMALL, replicates=10, seed=2)
    np.testing.assert_array_equal(off.values, mean.values)
    np.testing.assert_array_equal(off.statistics, mean.statistics)
    assert off.free == mean.free == ("a", "b", "c")
    assert any("replicates scatter" in one for one in off.warnings)


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_a_posterior_with_variation_predicts_saves_and_exports_it(
    inferred: tuple[Posterior, Posterior, np.ndarray], tmp_path: Path
) -> None:
    found, off, _ = inferred
    assert found.free == ("a", "b", "c", "colony_variation")
    absence = absent(found)
    assert absence is not None
    assert absence < 0.05
    assert 0.2 < found.mean[3] < 0.45
    assert absent(off) is None
    assert (found.sd[:3] > off.sd).all()
    assert not any("replicates scatter" in one for one in found.warnings)
    predicted = found.predict(ClosedForm(), draws=60, seed=3)
    alone = replace(found, replicates=1).predict(ClosedForm(), draws=60, seed=3)
    still = replace(off, replicates=1).predict(ClosedForm(), draws=60, seed=3)
    assert predicted.free == found.free
    assert predicted.values.shape == (60, 4)
    assert (alone.statistics.std(axis=0) > 1.3 * still.statistics.std(axis=0)).mean() > 0.5
    with pytest.raises(InputError, match="simulator is of a, b, c, colony_variation, the posterior of a, b, c"):
        off.predict(Varied(ClosedForm()))
    found.save(tmp_path / "posterior.npz")
    back = Posterior.load(tmp_path / "posterior.npz")
    assert back.prior.asdict()["colony_variation"] == {"distribution": "spike-half-normal", "zero": 0.5, "sd": 0.3}
    np.testing.assert_array_equal(back.values, found.values)
    pytest.importorskip("arviz")
    exported = found.to_arviz(predicted)
    np.testing.assert_array_equal(exported["posterior"]["colony_variation"], found.values[:, :, 3])
    assert np.isfinite(exported["log_prior"]["colony_variation"]).all()


def test_what_is_refused() -> None:
    simulator, prior, rows = ClosedForm(), closed_form_prior(), np.ones((4, 5))
    with pytest.raises(InputError, match="variation: the data are means, and single colonies are needed"):
        infer(simulator, prior, rows[0], replicates=4, variation=Variation())
    with pytest.raises(InputError, match="variation: abc-smc takes all colonies for those of one λ"):
        infer(simulator, prior, rows, method="abc-smc", variation=Variation())
    with pytest.raises(InputError, match=r"colonies have shape \(4, 4\), 5 statistics are expected"), wrong_types():
        Problem(simulator, prior, np.ones(5), 4, colonies=rows[:, :4])
    with pytest.raises(InputError, match=r"variation: a may be finite"):
        infer(linear(), linear().prior, np.ones((4, 4)), variation=Variation())
