"""The emulator on simulators whose mean and scatter are known, what it says of itself, and what it refuses."""

import jax
import numpy as np
import pytest
from known_likelihoods import Known, curved, fragile, linear, simulations

from yeastfit import InputError
from yeastfit.inference.neural_likelihood import emulator as emulator_module
from yeastfit.inference.neural_likelihood import network, training
from yeastfit.inference.neural_likelihood.coordinates import Coordinates
from yeastfit.inference.neural_likelihood.cross_validation import CrossValidation
from yeastfit.inference.neural_likelihood.emulator import Emulator
from yeastfit.inference.neural_likelihood.network import TrainingSettings
from yeastfit.inference.neural_likelihood.sequential import SequentialEmulator
from yeastfit.inference.neural_likelihood.training import train
from yeastfit.inference.prior.prior import Prior

QUICK = TrainingSettings(members=3)


def trained(known: Known, count: int = 1024, seed: int = 0, settings: TrainingSettings = QUICK) -> Emulator:
    values, statistics = simulations(known, count, seed)
    return train(values, statistics, prior=known.prior, labels=known.labels, seed=seed, settings=settings)


@pytest.fixture(scope="module")
def of_curved() -> Emulator:
    return trained(curved(), 2048)


def inside(known: Known, count: int = 200) -> np.ndarray:
    """λ in the middle of the prior."""
    return known.prior.quantile(0.1 + 0.8 * np.random.default_rng(3).random((count, len(known.free))))


def test_mean_and_scatter_of_a_curved_simulator(of_curved: Emulator) -> None:
    """Mean within a fraction of the scatter, standard deviations and correlations within a tenth."""
    known = curved()
    values = inside(known)
    mean, scatter, _, success = of_curved.moments(values)
    sd = np.sqrt(np.diagonal(scatter, axis1=1, axis2=2))
    exact_mean, exact_scatter = known.moments(values)
    exact_sd = np.sqrt(np.diagonal(exact_scatter, axis1=1, axis2=2))
    assert np.sqrt(np.mean(((mean - exact_mean) / exact_sd) ** 2)) < 0.15
    assert np.sqrt(np.mean(np.log(sd / exact_sd) ** 2)) < 0.1
    correlation = scatter[:, 0, 1] / (sd[:, 0] * sd[:, 1])
    assert np.abs(correlation - 0.6).max() < 0.1
    np.testing.assert_array_equal(success, 1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("statistics", [2, network.FEW_STATISTICS + 1])
def test_correlations_depend_on_coordinates_where_statistics_are_few(statistics: int) -> None:
    """s_2 has the correlation x with s_1, others none; where there are more, one correlation is learnt, about 0."""
    rng = np.random.default_rng(0)
    prior = Prior.of({"x": {"distribution": "uniform", "low": -0.9, "high": 0.9}})
    values, rows = rng.uniform(-0.9, 0.9, (2048, 1)), rng.standard_normal((2048, statistics))
    x = values[:, 0]
    rows[:, 1] = x * rows[:, 0] + np.sqrt(1 - x**2) * rows[:, 1]
    labels = [f"s{k}" for k in range(statistics)]
    found = train(values, rows, prior=prior, labels=labels, seed=0, settings=QUICK)
    at = np.array([-0.8, -0.4, 0.0, 0.4, 0.8])
    scatter = found.moments(at[:, None])[1]
    sd = np.sqrt(np.diagonal(scatter, axis1=1, axis2=2))
    correlation = scatter[:, 0, 1] / (sd[:, 0] * sd[:, 1])
    expected = at if statistics == 2 else np.zeros(5)
    np.testing.assert_allclose(correlation, expected, atol=0.15)


@pytest.mark.thorough
def test_the_error_it_claims_is_the_error_it_makes() -> None:
    """On average over simulations that might as well have been made, in the variance of one data set."""
    made, claimed = [], []
    for known in (curved(), linear()):
        values = inside(known)
        exact, _ = known.moments(values)
        for seed in range(3):
            mean, scatter, error, _ = trained(known, seed=seed, settings=TrainingSettings()).moments(values)
            precision, off = np.linalg.inv(scatter), mean - exact
            made.append(np.einsum("ri,rij,rj->r", off, precision, off).mean())
            claimed.append(np.einsum("rij,rji->r", precision, error).mean())
    assert 0.8 < np.mean(claimed) / np.mean(made) < 1.25


def test_held_out_residuals_are_standard_normal(of_curved: Emulator) -> None:
    found = of_curved.cross_validation
    assert found.rows == 2048
    np.testing.assert_allclose(found.mean, 0.0, atol=4 / np.sqrt(2048))
    np.testing.assert_allclose(found.covariance, np.eye(3), atol=0.12)
    assert found.sentences() == []


def test_log_likelihood_is_a_density_of_replicates_means(of_curved: Emulator) -> None:
    """Against the exact one of the mean of R data sets, and against its own moments."""
    known = curved()
    values = inside(known, 20)
    mean, scatter, error, _ = of_curved.moments(values)
    noise = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 0.1]])
    for replicates, added in ((1, None), (5, None), (5, noise)):
        observed = mean[0]
        off = observed - mean
        covariance = scatter / replicates + error + (0.0 if added is None else added)
        expected = -0.5 * np.einsum("ri,rij,rj->r", off, np.linalg.inv(covariance), off)
        expected -= 0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1]
        found = of_curved.log_likelihood(values, observed, replicates, added)
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)
    drawn = of_curved.draw(np.repeat(values[:1], 20000, axis=0), np.random.default_rng(0), 5)
    np.testing.assert_allclose(np.cov(drawn, rowvar=False), scatter[0] / 5 + error[0], rtol=0.06, atol=2e-3)
    drawn = of_curved.draw(np.repeat(values[:1], 20000, axis=0), np.random.default_rng(0), 5, noise)
    np.testing.assert_allclose(np.cov(drawn, rowvar=False), scatter[0] / 5 + error[0] + noise, rtol=0.06, atol=5e-3)


def test_draws_are_the_same_however_many_are_made_at_a_time(
    of_curved: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = inside(curved(), 100)
    found = of_curved.draw(values, np.random.default_rng(1), replicates=3)
    monkeypatch.setattr(emulator_module, "ROWS", 32)
    again = of_curved.draw(values, np.random.default_rng(1), replicates=3)
    np.testing.assert_allclose(again, found, rtol=1e-4, atol=1e-6)  # single precision, of numbers about 1


def test_more_simulations_and_draws_compile_nothing(caplog: pytest.LogCaptureFixture) -> None:
    def used(count: int, draws: int) -> None:
        trained(linear(), count).draw(inside(linear(), draws), np.random.default_rng(1))

    used(256, 10)
    with jax.log_compiles():
        used(300, 300)
        jax.jit(lambda x: x + 1)(np.ones(3))  # a count that does count
    compiled = [record.getMessage() for record in caplog.records if record.getMessage().startswith("Compiling")]
    assert len(compiled) == 1, compiled
    assert "lambda" in compiled[0]


def test_the_same_seed_gives_the_same_emulator() -> None:
    one, two, other = (trained(linear(), 256, seed) for seed in (0, 0, 1))
    values = inside(linear(), 5)
    np.testing.assert_array_equal(one.moments(values)[0], two.moments(values)[0])
    assert (one.moments(values)[0] != other.moments(values)[0]).all()


@pytest.mark.thorough
def test_members_learn_the_same_together_and_each_on_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """On any number of threads to the last bit, with a probability of success, too; together but for rounding."""
    values = inside(fragile(), 50)

    def found() -> np.ndarray:
        emulator = trained(fragile(), 256, settings=TrainingSettings(members=3, steps=200))
        return emulator.log_likelihood(values, emulator.center)

    own = found()
    monkeypatch.setattr(network, "available_processors", lambda: 7)
    np.testing.assert_array_equal(found(), own)
    monkeypatch.setattr(training, "fitted", network.fitted_together)
    together = found()
    np.testing.assert_allclose(together, own, rtol=1e-3, atol=1e-3)


def test_simulations_that_fail_give_a_probability_of_success() -> None:
    known = fragile()
    found = trained(known, 2048)
    assert found.failed > 100
    values = np.array([[np.exp(-1.0), 1.0], [np.exp(1.0), 1.0], [np.exp(1.7), 1.0]])
    mean, scatter, error, success = found.moments(values)
    np.testing.assert_allclose(success, 1 - known.fails(values), atol=0.1)
    made = np.log(success) - np.log1p(-known.fails(values))
    assert (np.abs(made) < 4.0 * np.sqrt(found.success_error(values))).all()
    observed = mean[1]
    without = found.log_likelihood(values, observed, 4) - 4 * np.log(success)
    covariance = scatter / 4 + error
    off = observed - mean
    expected = -0.5 * np.einsum("ri,rij,rj->r", off, np.linalg.inv(covariance), off)
    np.testing.assert_allclose(without, expected - 0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1], rtol=1e-3)


def test_what_is_off_is_told_in_words() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=1000)
    terms = np.stack([np.ones(1000), x, x**2], axis=1)
    residuals = rng.normal(size=(1000, 3)) * [1.0, 1.5, 1.0] + [0.3, 0.0, 0.0]
    residuals[:, 2] += 0.5 * x
    found = CrossValidation.of(residuals, terms, ("area", "length", "count"))
    assert found.sentences()[0].startswith("emulator: held-out area is off by +0.")
    assert "held-out length scatters with 2." in found.sentences()[1]
    np.testing.assert_allclose(found.misfit, [0.09, 0.0, 0.25], atol=0.04)


def test_what_is_refused() -> None:
    known = linear()
    values, statistics = simulations(known, 64, 0)

    def refused(match: str, values: np.ndarray = values, statistics: np.ndarray = statistics) -> None:
        with pytest.raises(InputError, match=match):
            train(values, statistics, prior=known.prior, labels=known.labels, seed=0, settings=QUICK)

    refused("20 of 20 simulations succeeded, an emulator of 2 parameters .* needs", values[:20], statistics[:20])
    refused("s1 is the same in all simulations", statistics=statistics * [1, 0, 1, 1])
    refused("leave out statistics that follow from others", statistics=statistics[:, [0, 1, 2, 2]])
    refused("a must be finite and vary", values=np.stack([np.ones(64), values[:, 1]], axis=1))
    refused("shapes", statistics=statistics[:, :2])
    with pytest.raises(InputError, match="members is 1, it must be at least 2"):
        TrainingSettings(members=1)


def test_more_coordinates_are_trained_for_longer() -> None:
    """1000 steps for up to three, and 1000 for each one more; more and narrower networks then; what is asked for."""
    assert [TrainingSettings().resolved(free).steps for free in (1, 3, 4, 5)] == [1000, 1000, 2000, 3000]
    sizes = [(one.members, one.width) for one in (TrainingSettings().resolved(free) for free in (1, 3, 4, 5))]
    assert sizes == [(5, 64), (5, 64), (12, 32), (12, 32)]
    assert TrainingSettings(members=3, width=16, steps=200).resolved(5) == TrainingSettings(3, 16, steps=200)
    assert SequentialEmulator().resolved(5).training.steps == 3000
    counts = [TrainingSettings(steps=200).for_simulations(count).steps for count in (10, 6143, 6144, 12_288)]
    assert counts == [200, 200, 400, 800]


def test_shares_are_seen_by_their_angle() -> None:
    """x is arcsin √u of a beta distribution's u, standardised, and log λ of a log-uniform one."""
    prior = Prior.of(
        {
            "a": {"distribution": "beta", "a": 2.0, "b": 5.0, "low": -1.0, "high": 3.0},
            "b": {"distribution": "log-uniform", "low": 0.1, "high": 10.0},
        }
    )
    values = prior.quantile(np.random.default_rng(0).random((50, 2)))
    coordinates = Coordinates.of(prior, values)
    x = coordinates.of_values(values)
    np.testing.assert_allclose(x.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(x.std(axis=0), 1.0)
    plain = np.column_stack([np.arcsin(np.sqrt((values[:, 0] + 1.0) / 4.0)), np.log(values[:, 1])])
    np.testing.assert_allclose(x * plain.std(axis=0) + plain.mean(axis=0), plain)
    ends = np.array([[-1.0, 1.0], [3.0, 1.0]])
    angles = coordinates.of_values(ends)[:, 0] * plain[:, 0].std() + plain[:, 0].mean()
    np.testing.assert_allclose(angles, [0.0, np.pi / 2], atol=1e-12)
