"""ABC-SMC against posteriors that are known, against ABC-MCMC, and against itself after a kill."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import known_posteriors
import numpy as np
import pytest
from known_posteriors import Interrupted, Killed, assert_agrees, assert_same, run
from numpy.random import Generator

from yeastfit import InputError
from yeastfit.inference.abc.mcmc import AbcMcmc
from yeastfit.inference.abc.population import Mixture, Population
from yeastfit.inference.abc.smc import AbcSmc, SmcDiagnostics
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.posterior.status import Status
from yeastfit.inference.samplers import infer
from yeastfit.inference.store.simulation_store import Store
from yeastfit.inference.store.simulations import Simulations

GAUSSIAN = known_posteriors.gaussian()
SMC = AbcSmc(simulations=100_000, batch=64)
SHORT = AbcSmc(population=60, batch=16, populations=4, acceptance=0.0, simulations=100_000)


def reported(posterior: Posterior) -> SmcDiagnostics:
    assert isinstance(posterior.diagnostics, SmcDiagnostics)
    return posterior.diagnostics


def opened(folder: Path) -> Store:
    return Store(folder / "simulations.h5", ("mean",), ("average",))


# --- known answers ----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("unchecked")
def test_gaussian_mean_as_epsilon_falls() -> None:
    """The indicator kernel of a difference adds ε²/3 of variance, as the Gaussian one does with ε/√3; then nothing."""
    plain = replace(GAUSSIAN, exact=lambda epsilon: GAUSSIAN.exact(epsilon / np.sqrt(3)))
    widths = []
    for epsilon in (1.5, 0.5, 0.1):
        found = run(GAUSSIAN, replace(SMC, tolerance=epsilon, adjust=False, population=400), seed=1)
        assert reported(found).tolerances[-1] == epsilon
        assert reported(found).end == f"tolerance {epsilon:g} was reached"
        assert_agrees(found, plain, epsilon)
        widths.append(found.sd[0])
    assert widths[0] > 1.3 * widths[2]
    assert_agrees(found, GAUSSIAN, 0.0)


@pytest.mark.usefixtures("unchecked")
def test_beta_binomial_is_exact_below_one() -> None:
    known = known_posteriors.beta_binomial()
    found = run(known, replace(SMC, tolerance=0.5, population=500), seed=2)
    assert_agrees(found, known, 0.5)
    assert (found.statistics == 7).all()


@pytest.mark.usefixtures("unchecked")
def test_distances_that_repeat_end_by_themselves() -> None:
    known = known_posteriors.beta_binomial()
    found = run(known, replace(SMC, population=400, quantile=0.9), seed=5)
    assert (found.statistics == 7).all()
    assert reported(found).end == "tolerance 0 was reached"
    assert_agrees(found, known, 0.0)


@pytest.mark.usefixtures("unchecked")
def test_banana_and_regression() -> None:
    known = known_posteriors.banana()
    found = run(known, replace(SMC, tolerance=0.35, population=400), seed=4)
    assert_agrees(found, known, 0.0)


def test_regression_takes_out_what_epsilon_adds() -> None:
    """Observation and mean are jointly Gaussian, so that the regression is exact at any ε."""
    settings = replace(SMC, tolerance=1.5, population=800)
    wide, found = (run(GAUSSIAN, replace(settings, adjust=adjust), seed=5) for adjust in (False, True))
    points, weights = GAUSSIAN.exact(0.0)
    exact = np.sqrt(weights @ points**2 - (weights @ points) ** 2)
    assert wide.sd[0] > 1.3 * exact[0]
    assert_agrees(found, GAUSSIAN, 0.0)


@pytest.mark.usefixtures("unchecked")
def test_smc_and_mcmc_agree() -> None:
    known, epsilon = known_posteriors.banana(), 0.5
    populations = run(known, replace(SMC, tolerance=epsilon, adjust=False, population=400), seed=6)
    chains = run(known, AbcMcmc(steps=600, walkers=8, tolerance=epsilon), seed=7)
    error = np.hypot(populations.sd / np.sqrt(populations.effective_size), chains.sd / np.sqrt(chains.effective_size))
    np.testing.assert_array_less(np.abs(populations.mean - chains.mean), 4 * error)
    for level in (0.5, 0.9):
        error_of_ends = 4 * error[:, None] * (1.3 if level < 0.8 else 2.1)  # √(q (1 − q)) over a Gaussian's density
        apart = np.abs(populations.interval(level) - chains.interval(level))
        np.testing.assert_array_less(apart / error_of_ends, 1.0)


def test_simulations_that_come_to_nothing_by_chance_change_nothing() -> None:
    def draw(values: np.ndarray, rng: Generator) -> np.ndarray:
        return np.where(rng.random() < 0.3, np.nan, values + 0.5 * rng.standard_normal(1))

    known = replace(GAUSSIAN, simulator=replace(GAUSSIAN.simulator, draw=draw))
    found = run(known, replace(SMC, tolerance=0.2, population=400), seed=8)
    assert found.acceptance[0] == pytest.approx(0.7, abs=0.06)
    assert_agrees(found, known, 0.0)


def test_a_mixture_is_the_density_of_its_draws() -> None:
    """Of the draws within ε, each with the spread of all of them around it."""
    rng = np.random.default_rng(0)
    x, weights = rng.normal(size=(60, 1)), rng.random(60)
    few = Population(x, weights / weights.sum(), x[:, 0], x, x[:, 0], 1.0, 1.0, 60)
    mixture = Mixture.of(few, 0.5)
    near = x[:, 0] <= 0.5
    assert 20 < near.sum() < 60
    grid = np.linspace(-12, 12, 4001)
    density = np.exp(mixture.log_density(grid[:, None]))
    density /= np.trapezoid(density, grid)
    drawn = mixture.draw(40000, rng)[:, 0]
    near_weights = weights[near] / weights[near].sum()
    centre = near_weights @ x[near, 0]
    spread = near_weights @ (x[near, 0] - centre) ** 2
    assert drawn.mean() == pytest.approx(centre, abs=4 * drawn.std() / np.sqrt(40000))
    assert np.trapezoid(grid * density, grid) == pytest.approx(centre, abs=1e-6)
    for variance in (drawn.var(), np.trapezoid((grid - centre) ** 2 * density, grid)):
        assert variance == pytest.approx(3 * spread, rel=0.05)  # of x_j, and of C_j, which is twice that on average
    low, high = np.quantile(drawn, [0.05, 0.95])
    shares = np.interp([low, high], grid, np.cumsum(density) * (grid[1] - grid[0]))
    np.testing.assert_allclose(shares, [0.05, 0.95], atol=0.01)


def test_proposals_of_few_draws_within_epsilon_are_made_from_the_nearest() -> None:
    x = np.random.default_rng(1).normal(size=(60, 2))
    few = Population(x, np.full(60, 1 / 60), x[:, 0], x, np.arange(60.0), 100.0, 1.0, 60)
    np.testing.assert_array_equal(Mixture.of(few, 3.0).x, x[:20])
    with pytest.raises(InputError, match="population is 60, its draws have no covariance"):
        Mixture.of(replace(few, x=np.repeat(x[:, :1], 2, axis=1)), 3.0)


# --- budgets and ends -------------------------------------------------------------------------------------------------


def test_it_ends_where_it_is_told_to() -> None:
    ends = {
        "all 3 populations were made": replace(SHORT, populations=3),
        "the budget of 400 simulations allows for no further": replace(SHORT, simulations=400, populations=20),
        "the share of accepted proposals fell to": replace(SHORT, acceptance=0.4, populations=20),
        "the tolerance falls no further than": replace(SHORT, gain=0.8, populations=20),
    }
    for end, settings in ends.items():
        found = run(GAUSSIAN, settings, seed=9)
        assert end in reported(found).end
        assert found.simulations <= settings.simulations
        assert found.warnings == ()
    found = run(GAUSSIAN, replace(SHORT, tolerance=0.001), seed=9)
    assert found.status is Status.TOLERANCE_NOT_REACHED
    assert "tolerance 0.001 was not reached, it ended at" in found.warnings[0]


def test_a_population_that_takes_too_long_is_given_up() -> None:
    found = run(GAUSSIAN, replace(SHORT, tolerance=1e-4, quantile=0.0, acceptance=0.1, populations=20), seed=10)
    assert "proposals came within the tolerance" in reported(found).end
    assert found.simulations < 1000


def test_a_prior_that_excludes_the_data_is_said() -> None:
    found = run(known_posteriors.gaussian(observed=50.0), replace(SHORT, tolerance=0.1), seed=11)
    assert "average was observed as 50, the prior's simulations have" in found.warnings[0]
    assert "tolerance 0.1 was not reached" in found.warnings[1]


def test_a_sample_of_the_prior_is_said_to_be_one() -> None:
    found = run(GAUSSIAN, replace(SHORT, populations=1), seed=4)
    assert reported(found).tolerances == (np.inf,)
    assert found.status is Status.STILL_THE_PRIOR
    assert "the sample is one of the prior, nearer ones did not come: " in "\n".join(found.warnings)
    assert "one of the prior" not in "\n".join(run(GAUSSIAN, SHORT, seed=4).warnings)


def test_a_simulator_of_nothing_is_said() -> None:
    nothing = replace(GAUSSIAN.simulator, draw=lambda values, rng: values * np.nan)
    with pytest.raises(InputError, match="population is 60, fewer of 992 simulations from the prior have a distance"):
        run(replace(GAUSSIAN, simulator=nothing), replace(SHORT, simulations=1000))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"population": 1}, "population is 1, it must be a whole number of at least 2"),
        ({"quantile": 1.0}, "quantile is 1.0, it must be at least 0 and below 1"),
        ({"tolerance": -1.0}, "tolerance is -1.0, it must be at least 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(SHORT, **change)


def test_a_population_without_a_covariance_is_refused_before_the_pilot() -> None:
    with pytest.raises(InputError, match="population is 2, it must be larger than the number of free parameters, 2"):
        run(known_posteriors.banana(), replace(SHORT, population=2))


# --- kill and resume --------------------------------------------------------------------------------------------------


def test_killed_again_and_again_it_comes_to_the_same_bits(tmp_path: Path) -> None:
    settings, rng = replace(SHORT, tolerance=0.3), np.random.default_rng(12)
    expected = run(GAUSSIAN, settings, seed=13)
    kills = 0
    while True:
        interrupted = Interrupted(GAUSSIAN.simulator, 1 + int(rng.integers(0, 8)))
        try:
            with opened(tmp_path) as store:
                found = run(replace(GAUSSIAN, simulator=interrupted), settings, seed=13, store=store)
            break
        except Killed:
            kills += 1
    assert kills >= 3
    assert interrupted.sizes == {16}
    assert_same(found, expected)
    assert found.warnings == expected.warnings


def test_a_torn_file_comes_to_the_same_bits(tmp_path: Path) -> None:
    expected = run(GAUSSIAN, SHORT, seed=14)
    with opened(tmp_path) as store:
        run(GAUSSIAN, replace(SHORT, populations=3), seed=14, store=store)
    path = tmp_path / "simulations.h5"
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 1000)
    with opened(tmp_path) as store:
        found = run(GAUSSIAN, SHORT, seed=14, store=store)
        assert "was torn" in found.warnings[0]
        assert_same(found, expected)
        assert found.warnings[1:] == expected.warnings
        nothing = Interrupted(GAUSSIAN.simulator, 0)
        again = run(replace(GAUSSIAN, simulator=nothing), SHORT, seed=14, store=store)
        assert "was torn" in again.warnings[0]
        assert_same(again, expected)


def test_simulations_are_single_ones_and_those_of_the_pilot_count() -> None:
    store = Simulations(("mean",), ("average",))
    settings = replace(SHORT, replicates=3, distance="mahalanobis", pilot=20)
    known, data = GAUSSIAN, np.array([0.8])
    found = infer(known.simulator, known.prior, data, method=settings, seed=15, store=store)
    assert found.simulations == len(store) + 3 * 20  # the first population asks for those of the pilot again
    assert found.simulations <= settings.simulations_at_most


def test_a_number_of_replicates_is_also_that_of_simulated_data_sets() -> None:
    """As `infer` says of its likelihood; a sampler that is made already keeps its own."""
    data = np.array([0.8])
    plain: dict[str, Any] = {"population": 60, "populations": 4, "acceptance": 0.0, "simulations": 100_000, "batch": 16}
    given = infer(GAUSSIAN.simulator, GAUSSIAN.prior, data, method="abc-smc", replicates=3, seed=15, **plain)
    expected = infer(
        GAUSSIAN.simulator, GAUSSIAN.prior, data, method=replace(SHORT, replicates=3), replicates=3, seed=15
    )
    assert given.settings["replicates"] == 3
    assert_same(given, expected)
    own = infer(GAUSSIAN.simulator, GAUSSIAN.prior, data, method=replace(SHORT, populations=1), replicates=3, seed=15)
    assert own.settings["replicates"] == 1


def test_more_populations_go_on_from_fewer() -> None:
    store = Simulations(("mean",), ("average",))
    fewer, nothing = replace(SHORT, populations=2), Interrupted(GAUSSIAN.simulator, 0)
    run(GAUSSIAN, fewer, seed=15, store=store)
    longer = run(GAUSSIAN, SHORT, seed=15, store=store)
    assert len(store) == longer.simulations
    assert_same(longer, run(GAUSSIAN, SHORT, seed=15))
    assert_same(run(replace(GAUSSIAN, simulator=nothing), fewer, seed=15, store=store), run(GAUSSIAN, fewer, seed=15))
    cheaper = replace(SHORT, simulations=200)
    assert_same(run(GAUSSIAN, cheaper, seed=15, store=store), run(GAUSSIAN, cheaper, seed=15))


def test_simulations_of_one_method_serve_another() -> None:
    store = Simulations(("mean",), ("average",))
    run(GAUSSIAN, replace(SHORT, populations=1), seed=17, store=store)
    made = len(store)
    run(GAUSSIAN, AbcMcmc(steps=1, walkers=4, pilot=made), seed=17, store=store)
    assert len(store) == made + 4


def test_a_posterior_comes_back_from_its_file(tmp_path: Path) -> None:
    found = run(GAUSSIAN, SHORT, seed=18)
    found.save(tmp_path / "posterior.npz")
    again = Posterior.load(tmp_path / "posterior.npz")
    assert_same(again, found)
    assert reported(again).end == reported(found).end
    assert reported(again).rows() == reported(found).rows()
    np.testing.assert_array_equal(again.effective_size, found.effective_size)
    assert again.method == "abc-smc"
