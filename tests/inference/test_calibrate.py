"""Simulation-based calibration: ranks are uniform where posteriors are exact, over the prior and near data."""

from dataclasses import dataclass

import numpy as np
import pytest
from made_posteriors import made_posterior
from scipy.stats import kstest, multivariate_normal
from simulators import observables_named, parameters_named

from yeastfit import InputError, Posterior, Prior, Problem, SimulationError, Status, calibrate, infer
from yeastfit.inference.posterior.calibration_ranks import Calibration, joint_rank
from yeastfit.inference.store.simulations import Simulations
from yeastfit.progress import Progress

FREE = ("mobility", "aspect_ratio")
PRIOR = Prior.of({name: {"distribution": "normal", "mean": 0.0, "sd": 1.0} for name in FREE})
SCATTER = np.array([[1.0, 0.6], [0.6, 1.0]])


@dataclass
class Gaussian:
    """y ~ N(λ, SCATTER), with λ ~ N(0, 1)."""

    parameters = parameters_named(FREE)
    observables = observables_named(("a", "b"))

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        noise = [np.random.default_rng(seed).multivariate_normal([0, 0], SCATTER) for seed in seeds]
        return values + np.array(noise)


@dataclass(frozen=True)
class Exact:
    """Draws from the posterior of `Gaussian`, given one data set or pairs; `joint` ones, or each parameter's alone."""

    width: float = 1.0
    joint: bool = True

    def run(self, problem: Problem, store: Simulations, seed: int, progress: Progress) -> Posterior:
        data = problem.observed.reshape(-1, 2)
        precision = problem.replicates * len(data) * np.linalg.inv(SCATTER)
        covariance = np.linalg.inv(precision + np.eye(2))
        mean = covariance @ precision @ data.mean(axis=0)
        if not self.joint:
            covariance = np.diag(np.diag(covariance))
        rng = np.random.default_rng(data.tobytes()[0] + seed)
        draws = multivariate_normal(mean, self.width**2 * covariance).rvs(2000, random_state=rng)
        return Posterior.of(problem, draws[None], simulations=1, status=Status.SETTLED)


def p_values(found: Calibration) -> dict[str, float]:
    return {name: kstest(share, "uniform").pvalue for name, share in found.shares().items()}


@pytest.mark.thorough
@pytest.mark.usefixtures("unchecked")
def test_exact_posteriors_are_uniform_and_wrong_ones_are_not() -> None:
    exact = calibrate(Gaussian(), PRIOR, data_sets=200, method=Exact(), replicates=2, seed=2)
    assert min(p_values(exact).values()) > 0.01
    assert {"inside_50", "from_90", "to_90"} < set(exact.rows()[0])
    inside = np.array([row["inside_90"] for row in exact.rows()])
    assert np.abs(inside - 0.9).max() < 3 * np.sqrt(0.9 * 0.1 / 200)
    narrow = calibrate(Gaussian(), PRIOR, data_sets=100, method=Exact(0.4), replicates=2, seed=2)
    assert max(p_values(narrow)[name] for name in FREE) < 1e-3
    assert narrow.rows()[0]["to_90"] < 0.9


def test_near_data_the_truth_is_a_draw_of_the_posterior_of_both() -> None:
    """And the posterior of the simulated data alone would not be uniform: the truths lie near those observed."""
    observed = infer(Gaussian(), PRIOR, [2.0, 1.0], method=Exact())
    near = calibrate(Gaussian(), observed, data_sets=100, method=Exact(), seed=2)
    assert near.near
    assert min(p_values(near).values()) > 0.01
    assert np.abs(near.truths.mean(axis=0) - observed.mean).max() < 0.25


def test_the_joint_rank_finds_what_single_parameters_do_not() -> None:
    """Right for each of six parameters, wrong together: draws are independent, truths move as one."""
    prior = Prior.of({name: {"distribution": "normal", "mean": 0.0, "sd": 1.0} for name in "abcdef"})
    rng, joint, ranks = np.random.default_rng(0), [], []
    for _ in range(200):
        truth, alone = np.repeat(rng.standard_normal(), 6), rng.standard_normal((99, 6))
        joint.append(joint_rank(prior, truth, alone, rng))
        ranks.append((alone < truth).sum(axis=0))
    shares = (np.column_stack([np.array(ranks), joint]) + 0.5) / 100
    assert min(kstest(one, "uniform").pvalue for one in shares[:, :6].T) > 0.01
    assert kstest(shares[:, 6], "uniform").pvalue < 1e-3


def test_what_fails_is_counted_and_nothing_at_all_is_an_error() -> None:
    class Sometimes(Exact):
        def run(self, problem: Problem, *rest: object) -> Posterior:
            if problem.observed[0] > 0:
                raise InputError("no")
            return made_posterior(np.zeros((1, 50, 2)), prior=PRIOR, status=Status.SETTLED)

    found = calibrate(Gaussian(), PRIOR, data_sets=20, method=Sometimes())
    assert len(found.failed) + len(found.truths) == 20
    assert 0 < len(found.failed) < 20
    assert found.failed[0].endswith(": no")

    class Never(Exact):
        def run(self, *rest: object) -> Posterior:
            raise InputError("never")

    with pytest.raises(SimulationError, match="none of 3 data sets has a posterior: data set 1: never"):
        calibrate(Gaussian(), PRIOR, data_sets=3, method=Never())
    with pytest.raises(InputError, match="foo is no setting of any method"):
        calibrate(Gaussian(), PRIOR, data_sets=3, foo=1)
    with pytest.raises(InputError, match="data_sets is 0, it must be a whole number of at least 1"):
        calibrate(Gaussian(), PRIOR, data_sets=0)
