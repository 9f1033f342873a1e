"""What judges samplers in benchmarks/samplers.py, and what counts pyABC's simulations, where the answers are known."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float, Int
from known_likelihoods import linear
from simulators import observables_named, parameters_named

from benchmarks import samplers
from benchmarks.reference import Box, Case, Moments, Reference
from benchmarks.report import Report
from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import WeightedCurves
from yeastfit.inference.abc.population import Population
from yeastfit.inference.polynomial import monomials
from yeastfit.inference.prior.prior import Prior
from yeastfit.observable import Observable
from yeastfit.parameter_set import ParameterSet

TRUTH = np.array([1.3, 0.8])


@dataclass(frozen=True)
class Noisy:
    """λ + N(0, 1), of which those with a seed divisible by 5 fail. batches: rows of every call."""

    free: tuple[str, ...] = ("shift",)
    labels: tuple[str, ...] = ("seen",)

    @property
    def parameters(self) -> ParameterSet:
        return parameters_named(self.free)

    @property
    def observables(self) -> tuple[Observable, ...]:
        return observables_named(self.labels)

    batches: list[int] = field(default_factory=list)

    def __call__(
        self, values: Float[np.ndarray, "proposal free"], seeds: Int[np.ndarray, " proposal"]
    ) -> Float[np.ndarray, "proposal statistic"]:
        self.batches.append(len(values))
        noise = np.array([np.random.default_rng(seed).standard_normal() for seed in seeds])
        return np.where(seeds[:, None] % 5 == 0, np.nan, values + noise[:, None])


FLAT = Prior.of({"shift": {"distribution": "uniform", "low": -8.0, "high": 8.0}})
DISTANCE = WeightedCurves(np.array([0.8]), np.array([1.0]))


@pytest.fixture
def pyabc_smc() -> Any:
    """Of benchmarks/rivals.py, where pyABC is installed."""
    pytest.importorskip("pyabc", reason="pyABC comes with the extra benchmarks")
    from benchmarks.rivals import pyabc_smc

    return pyabc_smc


def case(replicates: int = 4) -> Case:
    known = linear()
    return Case(known, known.prior, known.observed(tuple(TRUTH), replicates, seed=1), replicates, TRUTH)


def exact(one: Case) -> Moments:
    mean, covariance = linear().posterior(one.observed, one.replicates)
    return Moments(mean, np.sqrt(np.diag(covariance)))


@pytest.mark.parametrize(
    ("mean", "sd", "error"),
    [
        ((1.0, 2.0), (0.1, 0.2), 0.0),
        ((1.03, 2.0), (0.1, 0.2), 0.3),
        ((0.99, 2.1), (0.1, 0.2), 0.5),
        ((1.0, 2.0), (0.2, 0.2), math.log(2)),
        ((1.0, 2.0), (0.1, 0.1), math.log(2)),
        ((1.02, 2.0), (0.1, 0.25), math.log(1.25)),
    ],
)
def test_the_error_is_the_largest_of_shifts_and_of_logarithms_of_ratios(
    mean: tuple[float, float], sd: tuple[float, float], error: float
) -> None:
    reference = Moments(np.array([1.0, 2.0]), np.array([0.1, 0.2]))
    assert reference.error(Moments(np.array(mean), np.array(sd))) == pytest.approx(error, abs=1e-12)


def test_moments_are_those_of_weighted_draws() -> None:
    found = Moments.of(np.array([[0.0], [1.0], [4.0]]), np.array([0.5, 0.25, 0.25]))
    np.testing.assert_allclose([found.mean[0], found.sd[0]], [1.25, math.sqrt(0.25 + 4.0 - 1.25**2)])


@pytest.mark.parametrize(
    ("errors", "colonies"),
    [
        ((0.9, 0.2, 0.1), 200),
        ((0.2, 0.3, 0.1), 300),
        ((0.2, 0.1, 0.2), 100),
        ((0.2, 0.1, 0.25), None),
        ((0.9, math.inf), None),
        ((), None),
    ],
)
def test_a_run_is_there_from_where_its_error_stays_below(errors: tuple[float, ...], colonies: int | None) -> None:
    trace = [{"colonies": 100 * (k + 1), "error": one} for k, one in enumerate(errors)]
    found = samplers.arrival(trace)
    assert (None if found is None else found["colonies"]) == colonies


def test_monomials_are_all_products_up_to_a_degree() -> None:
    a, b = 2.0, 3.0
    found = monomials(np.array([[a, b]]), 3)[0]
    expected = [1, a, b, a * a, a * b, b * b, a**3, a * a * b, a * b * b, b**3]
    np.testing.assert_array_equal(found, expected)


def test_the_reference_is_the_exact_posterior_within_its_own_error_and_abc_finds_the_same() -> None:
    one = case(replicates=1)
    reference = Reference.of(one, np.array([1.5, 1.5]), 4096)
    assert reference.own_error < 0.1
    assert exact(one).error(reference.moments) < 0.1
    witness, said = reference.witness(one, 2048, 300)
    assert said == []
    assert exact(one).error(witness) < 0.2


def test_chains_are_charged_once_for_their_pilot_and_are_there_when_adjusted() -> None:
    one = case(replicates=1)
    reference = Reference.of(one, np.array([1.5, 1.5]), 4096)
    size = samplers.Size(epsilon=3.0, pilot=1024, steps=150, looks=3, scatter=400)
    found = samplers.Race(one, reference, size).mcmc(1)
    plain, better = found[samplers.MCMC], found[samplers.MCMC_ADJUSTED]
    assert [point["colonies"] for point in plain] == [point["colonies"] for point in better]
    grown = np.diff([0, *(point["colonies"] for point in plain)])
    assert grown[0] > 1024
    assert (grown[1:] <= 32 * 50).all(), "the pilot was simulated again"
    assert better[-1]["error"] < samplers.THRESHOLD < plain[-1]["error"]


def test_a_box_that_does_not_hold_the_posterior_is_refused_and_boxes_end_with_the_prior() -> None:
    one = case()
    away = Case(one.colonies, one.prior, one.observed, one.replicates, TRUTH * np.exp([1.2, 0.0]))
    with pytest.raises(InputError, match="reach"):
        Reference.of(away, np.array([0.1, 0.1]), 1024)
    box = Box.around(one.prior, np.array([1.9, 0.0]), np.array([0.5, 0.5]))
    np.testing.assert_allclose(box.high, [2.0, 0.5])
    np.testing.assert_allclose(box.prior(one.prior).support, np.exp([[1.4, 2.0], [-0.5, 0.5]]))


def test_pyabc_is_charged_for_what_it_judged_and_finds_the_posterior(pyabc_smc: Any) -> None:
    """With an even kernel of half-width ε the variance is 1 + ε²/3."""
    simulator, before = Noisy(), np.random.get_state(legacy=False)["state"]["key"]  # noqa: NPY002
    populations, seconds = pyabc_smc(
        simulator, FLAT, DISTANCE, population=100, epsilon=1.0, most=20_000, block=32, seed=3
    )
    np.testing.assert_array_equal(np.random.get_state(legacy=False)["state"]["key"], before)  # noqa: NPY002
    used = np.diff([0, *(one.simulated for one in populations)])
    assert set(simulator.batches) == {32}
    assert sum(simulator.batches) == sum(32 * math.ceil(count / 32) for count in used)
    assert [one.acceptance for one in populations] == [100 / count for count in used]
    assert seconds == sorted(seconds)
    for one in populations:
        assert len(one.x) == 100
        assert (one.distances <= one.epsilon).all()
        np.testing.assert_allclose(DISTANCE(one.statistics), one.distances)
    assert 110 < used[0] < 150, "a fifth of the simulations failed, and was charged for"
    epsilons = [one.epsilon for one in populations]
    assert epsilons == sorted(epsilons, reverse=True)
    assert epsilons[-1] == 1.0
    for last, epsilon in zip(populations, epsilons[1:-1], strict=False):
        assert np.quantile(last.distances, 0.3) < epsilon < np.quantile(last.distances, 0.7)
    exact = Moments(np.array([0.8]), np.array([math.sqrt(1 + 1 / 3)]))
    assert exact.error(Moments.of(populations[-1].x, populations[-1].weights)) < 0.3


def test_pyabc_repeats_itself_and_ends_with_its_budget(pyabc_smc: Any) -> None:
    def run(simulator: Noisy) -> list[Population]:
        return pyabc_smc(simulator, FLAT, DISTANCE, population=20, epsilon=0.01, most=300, block=16, seed=5)[0]

    simulator = Noisy()
    first, again = run(simulator), run(Noisy())
    np.testing.assert_array_equal(first[-1].x, again[-1].x)
    assert first[-1].simulated <= 300 <= sum(simulator.batches) <= 300 + 16 * (len(first) + 1)


def test_pyabc_has_flat_priors_only(pyabc_smc: Any) -> None:
    prior = Prior.of({"shift": {"distribution": "normal", "mean": 1.0, "sd": 1.0}})
    with pytest.raises(InputError, match="shift is normal"):
        pyabc_smc(Noisy(), prior, DISTANCE, population=50, epsilon=1.0, most=100, block=16, seed=1)


def trace_of(*points: tuple[int, float]) -> samplers.Trace:
    return [{"colonies": count, "seconds": count / 100, "error": error, "epsilon": 1.1} for count, error in points]


def test_the_share_is_of_medians_and_what_did_not_arrive_makes_it_a_bound() -> None:
    runs = {
        samplers.EMULATOR: [trace_of((512, 0.5), (1024, 0.1)), trace_of((512, 0.2)), trace_of((512, 0.1))],
        samplers.SMC: [trace_of((8000, 0.2))] * 3,
        samplers.RIVAL: [trace_of((5000, 0.9), (9000, 0.1)), trace_of((4000, 0.8)), trace_of((10240, 0.1))],
    }
    report = Report("samplers")
    samplers.ratios(report, runs, "colonies", samplers.RIVAL, 0.1)
    samplers.ratios(report, runs, "colonies", samplers.SMC)
    runs[samplers.EMULATOR] = [trace_of((512, 0.5))] * 3
    samplers.ratios(report, runs, "colonies", samplers.RIVAL, 0.1)
    bound, plain, none = report.figures
    assert bound.value == pytest.approx(512 / 9000)
    assert bound.met
    assert "1 of 3 did not arrive" in bound.note
    assert plain.value == pytest.approx(512 / 8000)
    assert (math.isnan(none.value), none.met, none.note) == (True, False, "the emulator did not arrive")


def test_verdicts_count_failures_and_compare_abc_at_one_tolerance(tmp_path: Path) -> None:
    late = [{**point, "epsilon": 2.0} for point in trace_of((3000, 0.6))]
    gone: samplers.Trace = [{"colonies": 800, "seconds": math.nan, "error": math.inf, "said": "none came that close"}]
    runs = {
        samplers.EMULATOR: [trace_of((512, 0.2))] * 3,
        samplers.SMC: [trace_of((8000, 0.2)), trace_of((6000, 0.2))],
        samplers.RIVAL: [trace_of((9000, 0.6)), late],
        samplers.RIVAL_ADJUSTED: [trace_of((9000, 0.2)), late],
        samplers.MCMC: [gone, gone],
        samplers.MCMC_ADJUSTED: [gone, gone],
    }
    report, size = Report("samplers", quick=True), samplers.Size(seeds=(1, 2), tries=(1, 2, 3), epsilon=1.1)
    samplers.verdicts(report, runs, size)
    found = {figure.name: figure for figure in report.figures}
    assert found["emulator: colonies until there"].value == 512
    assert found["ABC-SMC, pyABC: colonies until there"].value == math.inf
    assert found["ABC-SMC, pyABC: colonies until there"].note == "0 of 2 arrived; not within 9000, 3000"
    assert (
        found["ABC-MCMC, yeastfit: colonies until there"].note
        == "0 of 2 arrived; not within 800, 800; none came that close"
    )
    assert found["ABC-SMC, yeastfit: colonies to ε = 1.1"].value == 7000
    assert found["ABC-SMC, pyABC: colonies to ε = 1.1"].value == 9000
    assert found["ABC-SMC, pyABC: colonies to ε = 1.1"].note == "1 of 2 reached it"
    assert found["colonies, emulator / ABC-SMC, pyABC"].value == pytest.approx(512 / 6000)
    assert found["colonies, emulator / ABC-SMC, pyABC"].target is None
    report.print()
    samplers.picture(runs, tmp_path / "samplers.png")
    assert (tmp_path / "samplers.png").stat().st_size > 10_000
    assert "not within 9000, 3000" in samplers.markdown(report, size)
