"""ABC-SMC against posteriors that are known, against ABC-MCMC, and against itself after a kill."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import known_posteriors
import numpy as np
import pytest
from known_posteriors import Interrupted, Killed, Known, assert_agrees
from numpy.random import Generator

from yeastfit import InputError
from yeastfit.inference.abc.mcmc import abc_mcmc
from yeastfit.inference.abc.mcmc_settings import McmcSettings
from yeastfit.inference.abc.population import Mixture, Population
from yeastfit.inference.abc.smc import SmcSettings, abc_smc
from yeastfit.inference.posterior.samples import Samples
from yeastfit.inference.posterior.simulation_store import Store

GAUSSIAN = known_posteriors.gaussian()
SHORT = SmcSettings(population=60, batch=16, populations=4, acceptance=0.0)


def run(known: Known, settings: SmcSettings, **more: Any) -> Samples:
    return abc_smc(known.simulator, known.prior, known.distance, settings, **more)


def assert_same(found: Samples, expected: Samples) -> None:
    """Bit by bit."""
    for name in ("values", "weights", "log_probability", "acceptance", "statistics"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for name in ("simulations", "diagnostics", "warnings"):
        assert getattr(found, name) == getattr(expected, name)


# --- known answers ----------------------------------------------------------------------------------------------------


def test_gaussian_mean_as_epsilon_falls() -> None:
    """The indicator kernel of a difference adds ε²/3 of variance, as the Gaussian one does with ε/√3; then nothing."""
    plain = replace(GAUSSIAN, exact=lambda epsilon: GAUSSIAN.exact(epsilon / np.sqrt(3)))
    widths = []
    for epsilon in (1.5, 0.5, 0.1):
        found = run(GAUSSIAN, SmcSettings(epsilon=epsilon, adjust=False, population=400), seed=1)
        assert found.diagnostics["epsilon"][-1] == epsilon
        assert found.diagnostics["end"] == f"epsilon {epsilon:g} was reached"
        assert_agrees(found, plain, epsilon)
        widths.append(found.sd[0])
    assert widths[0] > 1.3 * widths[2]
    assert_agrees(found, GAUSSIAN, 0.0)


def test_beta_binomial_is_exact_below_one() -> None:
    known = known_posteriors.beta_binomial()
    found = run(known, SmcSettings(epsilon=0.5, population=500), seed=2)
    assert_agrees(found, known, 0.5)
    assert (found.statistics == 7).all()


def test_distances_that_repeat_end_by_themselves() -> None:
    known = known_posteriors.beta_binomial()
    found = run(known, SmcSettings(population=400, quantile=0.9), seed=5)
    assert (found.statistics == 7).all()
    assert found.diagnostics["end"] == "epsilon 0 was reached"
    assert_agrees(found, known, 0.0)


def test_banana_and_regression() -> None:
    known = known_posteriors.banana()
    found = run(known, SmcSettings(epsilon=0.35, population=400), seed=4)
    assert_agrees(found, known, 0.0)


def test_regression_takes_out_what_epsilon_adds() -> None:
    """Observation and mean are jointly Gaussian, so that the regression is exact at any ε."""
    settings = SmcSettings(epsilon=1.5, population=800)
    wide, found = (run(GAUSSIAN, replace(settings, adjust=adjust), seed=5) for adjust in (False, True))
    points, weights = GAUSSIAN.exact(0.0)
    exact = np.sqrt(weights @ points**2 - (weights @ points) ** 2)
    assert wide.sd[0] > 1.3 * exact[0]
    assert_agrees(found, GAUSSIAN, 0.0)


def test_smc_and_mcmc_agree() -> None:
    known, epsilon = known_posteriors.banana(), 0.5
    populations = run(known, SmcSettings(epsilon=epsilon, adjust=False, population=400), seed=6)
    chains = abc_mcmc(known.simulator, known.prior, known.distance, McmcSettings(steps=600, epsilon=epsilon), seed=7)
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
    found = run(known, SmcSettings(epsilon=0.2, population=400), seed=8)
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
        "epsilon falls no further than": replace(SHORT, gain=0.8, populations=20),
    }
    for end, settings in ends.items():
        found = run(GAUSSIAN, settings, seed=9)
        assert end in found.diagnostics["end"]
        assert found.simulations <= settings.simulations
        assert found.warnings == []
    found = run(GAUSSIAN, replace(SHORT, epsilon=0.001), seed=9)
    assert "epsilon 0.001 was not reached, it ended at" in found.warnings[0]


def test_a_population_that_takes_too_long_is_given_up() -> None:
    found = run(GAUSSIAN, replace(SHORT, epsilon=1e-4, quantile=0.0, acceptance=0.1, populations=20), seed=10)
    assert "proposals came within epsilon" in found.diagnostics["end"]
    assert found.simulations < 1000


def test_a_prior_that_excludes_the_data_is_said() -> None:
    found = run(known_posteriors.gaussian(observed=50.0), replace(SHORT, epsilon=0.1), seed=11)
    assert "average was observed as 50, the prior's simulations have" in found.warnings[0]
    assert "epsilon 0.1 was not reached" in found.warnings[1]


def test_a_sample_of_the_prior_is_said_to_be_one() -> None:
    found = run(GAUSSIAN, replace(SHORT, populations=1), seed=4)
    assert found.diagnostics["epsilon"] == [np.inf]
    assert "the sample is one of the prior, nearer ones did not come: " in "\n".join(found.warnings)
    assert "one of the prior" not in "\n".join(run(GAUSSIAN, SHORT, seed=4).warnings)


def test_a_simulator_of_nothing_is_said() -> None:
    nothing = replace(GAUSSIAN.simulator, draw=lambda values, rng: values * np.nan)
    with pytest.raises(InputError, match="population is 60, fewer of 992 simulations from the prior came to anything"):
        run(replace(GAUSSIAN, simulator=nothing), replace(SHORT, simulations=1000))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"population": 1}, "population is 1, it must be at least 2"),
        ({"quantile": 1.0}, "quantile is 1.0, it must be at least 0 and below 1"),
        ({"epsilon": -1.0}, "epsilon is -1.0, it must be at least 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(SHORT, **change)


# --- kill and resume --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stored", [True, False])
def test_killed_again_and_again_it_comes_to_the_same_bits(tmp_path: Path, stored: bool) -> None:
    settings, rng = replace(SHORT, epsilon=0.3), np.random.default_rng(12)
    expected = run(GAUSSIAN, settings, seed=13)
    kills = 0
    while True:
        store = Store(tmp_path / "simulations.h5", ("mean",), ("average",)) if stored else None
        least = 1 if stored else 12  # without a store, a population has to be made in one go
        interrupted = Interrupted(GAUSSIAN.simulator, least + int(rng.integers(0, 8)))
        try:
            found = abc_smc(
                interrupted, GAUSSIAN.prior, GAUSSIAN.distance, settings, seed=13, path=tmp_path / "p.npz", store=store
            )
            break
        except Killed:
            kills += 1
        finally:
            if store is not None:
                store.close()
    assert kills >= (3 if stored else 1)
    assert interrupted.sizes == {16}
    assert_same(found, expected)


def test_torn_files_come_to_the_same_bits(tmp_path: Path) -> None:
    expected = run(GAUSSIAN, SHORT, seed=14)
    path, simulations = tmp_path / "populations.npz", tmp_path / "simulations.h5"
    with Store(simulations, ("mean",), ("average",)) as store:
        run(GAUSSIAN, replace(SHORT, populations=3), seed=14, path=path, store=store)
    for one in (path, simulations):
        with one.open("r+b") as file:
            file.truncate(one.stat().st_size - 1000)
    with Store(simulations, ("mean",), ("average",)) as store:
        with pytest.raises(InputError, match=r"populations\.npz: no populations can be read, remove it"):
            run(GAUSSIAN, SHORT, seed=14, path=path, store=store)
        path.unlink()
        found = run(GAUSSIAN, SHORT, seed=14, path=path, store=store)
        assert "was torn" in found.warnings[0]
        assert_same(replace(found, warnings=found.warnings[1:]), expected)
        nothing = Interrupted(GAUSSIAN.simulator, 0)
        again = abc_smc(nothing, GAUSSIAN.prior, GAUSSIAN.distance, SHORT, seed=14, store=store)
        assert "was torn" in again.warnings[0]
        assert_same(replace(again, warnings=again.warnings[1:]), expected)


def test_more_populations_go_on_from_fewer(tmp_path: Path) -> None:
    path = tmp_path / "populations.npz"
    run(GAUSSIAN, replace(SHORT, populations=2), seed=15, path=path)
    longer = run(GAUSSIAN, SHORT, seed=15, path=path)
    assert_same(longer, run(GAUSSIAN, SHORT, seed=15))
    fewer, nothing = replace(SHORT, populations=2), Interrupted(GAUSSIAN.simulator, 0)
    found = abc_smc(nothing, GAUSSIAN.prior, GAUSSIAN.distance, fewer, seed=15, path=path)
    assert_same(found, run(GAUSSIAN, fewer, seed=15))
    cheaper = replace(SHORT, simulations=200)
    assert_same(run(GAUSSIAN, cheaper, seed=15, path=path), run(GAUSSIAN, cheaper, seed=15))
    assert_same(run(GAUSSIAN, SHORT, seed=15, path=path), longer)
    with pytest.raises(InputError, match=r"holds other populations: quantile was 0.5, now it is 0.4; seed was 15"):
        run(GAUSSIAN, replace(SHORT, quantile=0.4), seed=16, path=path)


def test_simulations_of_one_method_serve_another(tmp_path: Path) -> None:
    with Store(tmp_path / "simulations.h5", ("mean",), ("average",)) as store:
        run(GAUSSIAN, replace(SHORT, populations=1), seed=17, store=store)
        made = len(store)
        settings = McmcSettings(steps=1, walkers=4, pilot=made)
        abc_mcmc(GAUSSIAN.simulator, GAUSSIAN.prior, GAUSSIAN.distance, settings, seed=17, store=store)
        assert len(store) == made + 4
