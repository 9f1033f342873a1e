"""Problems whose ABC posterior is known, each with its simulator, prior, distance and exact answer."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy import stats
from simulators import observables_named, parameters_named

from yeastfit.inference.abc.distances import Distance, WeightedCurves
from yeastfit.inference.posterior.draws import weighted_quantile
from yeastfit.inference.posterior.result import Posterior
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.samplers import infer
from yeastfit.observable import Observable
from yeastfit.parameter_set import ParameterSet
from yeastfit.storage import as_json


@dataclass(frozen=True)
class Drawing:
    """A simulator that calls `draw(λ, rng)` row by row."""

    free: tuple[str, ...]
    labels: tuple[str, ...]
    draw: Callable[[np.ndarray, np.random.Generator], np.ndarray]

    @property
    def parameters(self) -> ParameterSet:
        return parameters_named(self.free)

    @property
    def observables(self) -> tuple[Observable, ...]:
        return observables_named(self.labels)

    def __call__(
        self, values: Float[np.ndarray, "proposal free"], seeds: Int[np.ndarray, " proposal"]
    ) -> Float[np.ndarray, "proposal statistic"]:
        pairs = zip(values, seeds, strict=True)
        return np.array([self.draw(row, np.random.default_rng(seed)) for row, seed in pairs], dtype=float)


@dataclass(frozen=True)
class Known:
    """exact(ε): points and weights of the posterior, with the Gaussian kernel unless it says otherwise."""

    simulator: Any
    prior: Prior
    distance: Distance
    exact: Callable[[float], tuple[Float[np.ndarray, "point free"], Float[np.ndarray, " point"]]]


def gaussian(observed: float = 0.8, sigma: float = 1.0, count: int = 4) -> Known:
    """Mean of a Gaussian from the mean of `count` draws: with the Gaussian kernel its variance is σ²/n + ε²."""
    prior = Prior.of({"mean": {"distribution": "normal", "mean": 0.0, "sd": 2.0}})

    def draw(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return values + sigma / np.sqrt(count) * rng.standard_normal(1)

    def exact(epsilon: float) -> tuple[np.ndarray, np.ndarray]:
        precision = 1 / 4 + 1 / (sigma**2 / count + epsilon**2)
        mean = observed / (sigma**2 / count + epsilon**2) / precision
        return _quantiles(stats.norm(mean, precision**-0.5))

    distance = WeightedCurves(np.array([observed]), np.array([1.0]))
    return Known(Drawing(("mean",), ("average",), draw), prior, distance, exact)


def beta_binomial(successes: int = 7, trials: int = 20) -> Known:
    """Beta prior, binomial data, distance |difference|: exact where ε < 1, with the indicator kernel."""
    prior = Prior.of({"share": {"distribution": "beta", "a": 2.0, "b": 2.0}})

    def draw(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return rng.binomial(trials, values)

    def exact(epsilon: float) -> tuple[np.ndarray, np.ndarray]:
        assert epsilon < 1
        return _quantiles(stats.beta(2 + successes, 2 + trials - successes))

    distance = WeightedCurves(np.array([float(successes)]), np.array([1.0]))
    return Known(Drawing(("share",), ("successes",), draw), prior, distance, exact)


def banana(noise: float = 0.3) -> Known:
    """s = (a, b + a²) + noise observed at (0, 0.5): b = 0.5 − a² but for noise; exact on a grid, Gaussian kernel."""
    prior = Prior.of(
        {
            "a": {"distribution": "normal", "mean": 0, "sd": 1.0},
            "b": {"distribution": "uniform", "low": -3.0, "high": 3.0},
        }
    )
    observed = np.array([0.0, 0.5])

    def draw(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return np.array([0.5 * values[0], values[1] + values[0] ** 2]) + noise * rng.standard_normal(2)

    def exact(epsilon: float) -> tuple[np.ndarray, np.ndarray]:
        a, b = (one.ravel() for one in np.meshgrid(np.linspace(-4, 4, 401), np.linspace(-3, 3, 401), indexing="ij"))
        points, variance = np.stack([a, b], axis=1), noise**2 + epsilon**2
        misfit = (0.5 * a - observed[0]) ** 2 + (b + a**2 - observed[1]) ** 2
        weights = np.exp(prior.log_density(points) - 0.5 * misfit / variance)
        return points, weights / weights.sum()

    distance = WeightedCurves(observed, np.full(2, 2**-0.5))  # so that d² is the plain sum of squares
    return Known(Drawing(("a", "b"), ("first", "second"), draw), prior, distance, exact)


def run(known: Known, sampler: Any, **more: Any) -> Posterior:
    """The posterior by a method of ABC with the problem's distance."""
    return infer(
        known.simulator, known.prior, known.distance.observed, method=replace(sampler, distance=known.distance), **more
    )


def assert_same(posterior: Posterior, expected: Posterior) -> None:
    """Bit by bit."""
    for name in ("values", "weights", "log_probability", "acceptance", "statistics"):
        np.testing.assert_array_equal(getattr(posterior, name), getattr(expected, name))
    assert (posterior.simulations, posterior.status) == (expected.simulations, expected.status)
    assert as_json(posterior.diagnostics.asdict()) == as_json(expected.diagnostics.asdict())


def _quantiles(law: stats.rv_continuous) -> tuple[np.ndarray, np.ndarray]:
    """4000 points of equal weight."""
    points = law.ppf((np.arange(4000) + 0.5) / 4000)
    return points[:, None], np.full(4000, 1 / 4000)


def assert_agrees(posterior: Posterior, known: Known, epsilon: float, sizes: np.ndarray | None = None) -> None:
    """Mean, standard deviation and the ends of 50 and 90 % intervals within four standard errors of the exact ones.

    sizes: independent draws that the posterior is worth, by default their own estimate.
    """
    points, weights = known.exact(epsilon)
    mean = weights @ points
    sd = np.sqrt(weights @ (points - mean) ** 2)
    kurtosis = weights @ (points - mean) ** 4 / sd**4
    size = posterior.effective_size if sizes is None else sizes
    np.testing.assert_array_less(np.abs(posterior.mean - mean) / sd, 4 / np.sqrt(size))
    np.testing.assert_array_less(np.abs(posterior.sd / sd - 1), 4 * np.sqrt((kurtosis - 1) / (4 * size)))
    for level in (0.5, 0.9):
        for k, ends in enumerate(posterior.interval(level)):
            below = np.array([weights[points[:, k] <= end].sum() for end in ends])
            expected = np.array([0.5 - level / 2, 0.5 + level / 2])
            error = 4 * np.sqrt(expected * (1 - expected) / size[k]) + 0.01  # and what a grid of points rounds
            assert (np.abs(below - expected) < error).all(), f"{level}: {ends} hold {below}"


def exact_interval(known: Known, epsilon: float, level: float) -> Float[np.ndarray, "free 2"]:
    """Central interval of the exact posterior."""
    points, weights = known.exact(epsilon)
    shares = (0.5 - level / 2, 0.5 + level / 2)
    return np.array([[weighted_quantile(column, weights, share) for share in shares] for column in points.T])


class Killed(Exception):
    pass


class Interrupted:
    """A simulator that works for a number of calls, then raises at each."""

    def __init__(self, simulator: Drawing, calls: int) -> None:
        self.simulator, self.calls = simulator, calls
        self.parameters, self.observables = simulator.parameters, simulator.observables
        self.sizes = set[int]()

    def __call__(self, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        self.calls -= 1
        if self.calls < 0:
            raise Killed
        self.sizes.add(len(values))
        return self.simulator(values, seeds)
