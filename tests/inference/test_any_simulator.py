"""A simulator that is no colony, through public names only: a population that grows logistically.

N(t) = K / (1 + (K / N0 − 1) e^{−r t}), and each replicate has its own N0, log-normal, and noise of measurement.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import wrong_types

import yeastfit

HOURS = (2.0, 4.0, 6.0, 8.0, 10.0, 14.0)
TRUTH = {"rate": 0.6, "capacity": 80.0, "founders": 3.0}
SETTINGS = yeastfit.FitSettings(members=(16, 64, 128))


@dataclass
class Logistic:
    """Counts of cells; `noise` is their relative scatter."""

    times: tuple[float, ...] = HOURS
    noise: float = 0.05
    parameters: yeastfit.ParameterSet = field(
        default_factory=lambda: yeastfit.ParameterSet(
            (
                yeastfit.Parameter("rate", "r", "growth rate", (0.1, 3.0), 0.5, unit="1/h"),
                yeastfit.Parameter("capacity", "K", "cells at the end", (10.0, 1000.0), 100.0),
                yeastfit.Parameter("founders", "N0", "cells at the start", (0.5, 20.0), 2.0),
            )
        )
    )

    @property
    def observables(self) -> tuple[yeastfit.Observable, ...]:
        return tuple(yeastfit.Observable("count", time) for time in self.times)

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        normal = np.array([np.random.default_rng(int(seed)).normal(size=1 + len(self.times)) for seed in seeds])
        rate, capacity, founders = values.T[:, :, None]
        own = founders * np.exp(0.1 * normal[:, :1])
        mean = capacity / (1 + (capacity / own - 1) * np.exp(-rate * np.array(self.times)))
        return mean * (1 + self.noise * normal[:, 1:])


class Silent:
    """Has what a simulator has but its call."""

    parameters, observables = Logistic().parameters, Logistic().observables


def replicates(truth: dict[str, float], seed: int, count: int = 10) -> yeastfit.Targets:
    rng = np.random.default_rng(seed)
    rows = Logistic()(np.tile(list(truth.values()), (count, 1)), rng.integers(2**32, size=count))
    return yeastfit.Targets.from_replicates({"count": rows}, HOURS)


def fitted(seed: int) -> yeastfit.Fit:
    return yeastfit.fit(replicates(TRUTH, 1000 + seed), Logistic(), seed=seed, settings=SETTINGS)


def test_a_fit_finds_what_was_put_in_with_errors_of_the_right_size(tmp_path: Path) -> None:
    """Pulls of three parameters over 12 data sets: their rms is known to 12 %, more with ten replicates' scatter."""
    results = [fitted(seed) for seed in range(12)]
    pulls = np.array(
        [
            [np.log(found.values[name] / true) / found.log_standard_errors[name] for name, true in TRUTH.items()]
            for found in results
        ]
    )
    assert 0.6 < np.sqrt(np.mean(pulls**2)) < 1.6
    assert all(found.converged for found in results)
    first = results[0]
    assert first.status in (yeastfit.FitStatus.CONVERGED, yeastfit.FitStatus.WITHIN_NOISE)
    assert first.parameters == pytest.approx(first.values)
    assert first.standard_errors["rate"] < 0.1 * first.values["rate"]
    assert [row["role"] for row in first.rows()] == ["free"] * 3
    first.save(tmp_path / "fit.json")
    assert yeastfit.Fit.load(tmp_path / "fit.json").values == first.values
    assert yeastfit.plot.fit(first).axes[1].get_xlabel() == "time"


def test_the_same_seed_gives_the_same_fit() -> None:
    np.testing.assert_array_equal(fitted(3).theta, fitted(3).theta)


@pytest.mark.thorough
def test_a_bootstrap_and_a_profile_need_the_simulator_again() -> None:
    found = fitted(0)
    with pytest.raises(yeastfit.InputError, match="simulator is missing: this fit is of one that was handed in"):
        yeastfit.explore(found)
    explored = yeastfit.explore(found, Logistic(), runs=128)
    low, high = explored.profile("rate").intervals["95%"]
    assert low < found.values["rate"] < high
    assert explored.bootstrap(50).unconverged == 0


def test_two_conditions_share_what_they_share() -> None:
    poor = {**TRUTH, "capacity": 30.0}
    data = {"rich": replicates(TRUTH, 1), "poor": replicates(poor, 2)}
    found = yeastfit.fit(data, Logistic(), own=["capacity"], settings=SETTINGS, seed=1)
    assert found.free == ("rate", "capacity of rich", "capacity of poor", "founders")
    for name, true in (("rate", 0.6), ("capacity of rich", 80.0), ("capacity of poor", 30.0), ("founders", 3.0)):
        assert abs(np.log(found.values[name] / true)) < 4 * found.log_standard_errors[name]
    rich, small = found.conditions
    assert rich.parameters["rate"] == small.parameters["rate"]
    assert rich.parameters["capacity"] > 2 * small.parameters["capacity"]


def test_a_finer_simulator_corrects_a_coarse_one() -> None:
    """The coarse one counts a tenth too few."""

    class Coarse(Logistic):
        def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
            return 0.9 * super().__call__(values, seeds)

    data = replicates(TRUTH, 5)
    right, wrong, corrected = (
        np.log(yeastfit.fit(data, simulator, fine=fine, settings=SETTINGS, seed=2).values["capacity"])
        for simulator, fine in ((Logistic(), None), (Coarse(), None), (Coarse(), Logistic()))
    )
    assert wrong - right == pytest.approx(-np.log(0.9), abs=0.03)
    assert corrected == pytest.approx(right, abs=0.03)


def test_sensitivity_information_and_the_next_measurement(tmp_path: Path) -> None:
    found = yeastfit.sensitivity(simulator=Logistic(), at=TRUTH, runs=1024, seed=4)
    rate, capacity, founders = TRUTH.values()
    growth = np.exp(-rate * np.array(HOURS))
    bent = 1 + (capacity / founders - 1) * growth
    exact = np.stack(
        [
            capacity * rate * np.array(HOURS) * (capacity / founders - 1) * growth / bent**2,
            capacity / bent - capacity**2 / founders * growth / bent**2,
            capacity**2 / founders * growth / bent**2,
        ],
        axis=1,
    )
    off = found.jacobian - exact
    assert (np.abs(off) < np.maximum(5 * found.error, 0.05 * np.abs(exact).max())).all()
    assert found.at == TRUTH
    information = yeastfit.information_of(found, replicates=10)
    assert set(information.log_standard_errors) == set(TRUTH)
    assert not information.sentences()
    next_one = yeastfit.design(found, measured_times=[2.0, 4.0], steps=1, measurement_error=0.0)
    assert next_one.sequence[0].time >= 8.0, "nothing measured so far tells the capacity"
    next_one.save(tmp_path / "design.json")
    assert yeastfit.Design.load(tmp_path / "design.json").sentences() == next_one.sentences()
    with pytest.raises(yeastfit.InputError, match="method is 'pathwise', the simulator has no derivatives of its own"):
        yeastfit.sensitivity(simulator=Logistic(), method="pathwise")
    with pytest.raises(yeastfit.InputError, match="times is of colonies"):
        yeastfit.sensitivity(simulator=Logistic(), times=[1.0])


def test_what_does_not_go_together_is_named() -> None:
    data = replicates(TRUTH, 1)
    with pytest.raises(yeastfit.InputError, match="simulator gives count at 1, count at 2; the targets are count at 2"):
        yeastfit.fit(data, Logistic(times=(1.0, 2.0)))
    with pytest.raises(yeastfit.InputError, match="free is of colonies, the simulator that is given has its own"):
        yeastfit.fit(data, Logistic(), free=["rate"])
    with pytest.raises(yeastfit.InputError, match="targets have no imaging: colonies need to know"):
        yeastfit.fit(data)


@pytest.mark.parametrize(
    ("simulator", "words"),
    [(len, "has no parameters and no observables"), (Logistic, "is a class"), (Silent(), "cannot be called")],
    ids=("function", "class", "uncalled"),
)
def test_what_is_no_simulator_is_refused(simulator: Any, words: str) -> None:
    prior = yeastfit.Prior.default(Logistic().parameters)
    with wrong_types(), pytest.raises(yeastfit.InputError, match=rf"simulator \(.*\) {words}"):
        yeastfit.fit(replicates(TRUTH, 1), simulator)
    with wrong_types(), pytest.raises(yeastfit.InputError, match=rf"fine \(.*\) {words}"):
        yeastfit.fit(replicates(TRUTH, 1), Logistic(), fine=simulator)
    with wrong_types(), pytest.raises(yeastfit.InputError, match=rf"simulator \(.*\) {words}"):
        yeastfit.infer(simulator, prior, [1.0] * len(HOURS))


def test_the_mean_at_the_estimate_is_corrected_for_curvature() -> None:
    """Ensembles lie around a point, which shifts means of a steep curve; simulations at the point itself undo that."""
    times = (3.0, 6.0)
    rate = yeastfit.Parameter("rate", "r", "growth rate", (0.1, 3.0), 0.5)

    class Exponential:
        parameters = yeastfit.ParameterSet((rate,))
        observables = tuple(yeastfit.Observable("size", time) for time in times)

        def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
            noise = np.array([np.random.default_rng(int(seed)).normal(size=len(times)) for seed in seeds])
            return np.exp(values * np.array(times)) * (1 + 0.05 * noise)

    mean = np.exp(0.5 * np.array(times))
    targets = yeastfit.Targets.from_means({"size": mean}, times, scatter={"size": 0.05 * mean}, replicates=20)

    def mean_pull(refined: int) -> float:
        settings = yeastfit.FitSettings(refined=refined)
        results = [yeastfit.fit(targets, Exponential(), settings=settings, seed=seed) for seed in range(4)]
        return float(np.mean([np.log(one.values["rate"] / 0.5) / one.log_standard_errors["rate"] for one in results]))

    assert mean_pull(0) < -4
    assert abs(mean_pull(96)) < 1.5  # three standard errors of the mean of four


@dataclass
class Failing(Logistic):
    """One of which every fifth seed fails."""

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        rows = super().__call__(values, seeds)
        rows[np.asarray(seeds) % 5 == 0] = np.nan
        return rows


@dataclass
class Bounded(Logistic):
    """One that refuses what its parameters do not admit, as shares above 1 are refused."""

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        most = np.array([one.largest for one in self.parameters.parameters])
        return np.where((values <= most).all(axis=1, keepdims=True), super().__call__(values, seeds), np.nan)


def bounded(room: float) -> Bounded:
    """With a rate of at most so many times the true one."""
    one, most = Bounded(), room * TRUTH["rate"]
    first, *others = one.parameters.parameters
    one.parameters = yeastfit.ParameterSet((replace(first, plausible=(0.1, most), largest=most), *others))
    return one


def test_pairs_beyond_the_largest_value_are_named() -> None:
    said = "in pairs around it, rate is simulated up to .*, its largest is .*: hold it, or take a posterior"
    with pytest.raises(yeastfit.SimulationError, match=said):
        yeastfit.sensitivity(simulator=bounded(1.01), at=TRUTH)


def test_pairs_close_to_the_largest_value_go_as_far_as_that() -> None:
    found, free = (yeastfit.sensitivity(simulator=one, at=TRUTH) for one in (bounded(1.02), Logistic()))
    assert not found.warnings
    apart = np.abs(found.jacobian - free.jacobian) / np.hypot(found.error, free.error)
    assert apart.max() < 4
    assert (free.error[:, 0] < found.error[:, 0]).all()  # that is what it costs


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_fit_close_to_the_largest_value_recovers_it(seed: int) -> None:
    found = yeastfit.fit(replicates(TRUTH, seed), bounded(1.05), seed=seed, settings=SETTINGS)
    assert found.status == "converged"
    for name, true in TRUTH.items():
        assert abs(np.log(found.values[name] / true)) < 4 * found.log_standard_errors[name]


def test_simulations_that_failed_are_told_of() -> None:
    """Also by a simulator that does not count what it ran into."""
    found = yeastfit.sensitivity(simulator=Failing(), at=TRUTH)
    assert any("simulations failed (not finite), or their partners" in one for one in found.warnings)
    whole = yeastfit.sensitivity(simulator=Logistic(), at=TRUTH)
    assert not any("failed" in one for one in whole.warnings)
    by_fit = yeastfit.fit(replicates(TRUTH, 1), Failing(), seed=1, settings=SETTINGS)
    assert any("simulations failed (not finite) and were left out" in one for one in by_fit.warnings)
