"""Simulators with Gaussian statistics whose mean and covariance are known, for emulators of the likelihood."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.special import expit
from scipy.stats import qmc
from simulators import observables_named, parameters_named

from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.simulator import seed_of
from yeastfit.observable import Observable
from yeastfit.parameter_set import Parameter, ParameterSet

Moments = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Known:
    """moments(λ): mean [row, statistic] and covariance. fails(λ): probability that a simulation fails."""

    prior: Prior
    labels: tuple[str, ...]
    moments: Callable[[np.ndarray], Moments]
    fails: Callable[[np.ndarray], np.ndarray] = lambda values: np.zeros(len(values))

    @property
    def free(self) -> tuple[str, ...]:
        return self.prior.free

    @property
    def parameters(self) -> ParameterSet:
        return parameters_named(self.free)

    @property
    def observables(self) -> tuple[Observable, ...]:
        return observables_named(self.labels)

    def __call__(
        self, values: Float[np.ndarray, "proposal free"], seeds: Int[np.ndarray, " proposal"]
    ) -> Float[np.ndarray, "proposal statistic"]:
        mean, covariance = self.moments(values)
        streams = [np.random.default_rng(seed) for seed in seeds]
        noise = np.array([one.standard_normal(len(self.labels)) for one in streams])
        found = mean + np.einsum("rij,rj->ri", np.linalg.cholesky(covariance), noise)
        found[np.array([one.random() for one in streams]) < self.fails(values)] = np.nan
        return found

    def observed(self, values: tuple[float, ...], replicates: int, seed: int) -> Float[np.ndarray, " statistic"]:
        """Mean over data sets, none of which failed."""
        rows = np.repeat(np.array([values]), 20 * replicates, axis=0)
        found = self(rows, seed_of(seed, range(len(rows))))
        return found[np.isfinite(found).all(axis=1)][:replicates].mean(axis=0)

    def posterior(self, observed: np.ndarray, replicates: int) -> Moments:
        """Mean and covariance in the prior's coordinates, of two parameters, summed over a grid twice."""
        low, high = self.prior.coordinates(self.prior.quantile(np.array([[0.0, 0.0], [1.0, 1.0]])))
        for _ in range(3):
            axes = [np.linspace(*ends, 161) for ends in zip(low, high, strict=True)]
            x = np.stack([one.ravel() for one in np.meshgrid(*axes, indexing="ij")], axis=1)
            values = self.prior.values(x)
            mean, covariance = self.moments(values)
            off = observed - mean
            log_density = self.prior.log_density_of_coordinates(x) - 0.5 * np.linalg.slogdet(covariance)[1]
            log_density += replicates * np.log1p(-self.fails(values))
            log_density -= (
                0.5 * replicates * np.einsum("ri,ri->r", off, np.linalg.solve(covariance, off[..., None])[..., 0])
            )
            weights = np.exp(log_density - log_density.max())
            weights /= weights.sum()
            center = weights @ x
            spread = (x - center).T @ ((x - center) * weights[:, None])
            reach = 7 * np.sqrt(np.diag(spread))
            low, high = np.maximum(low, center - reach), np.minimum(high, center + reach)
        return center, spread


class Positive(Known):
    """The same with parameters that are above 0, so that colonies can scatter."""

    @property
    def parameters(self) -> ParameterSet:
        return ParameterSet(tuple(Parameter(name, name, name, (1e-3, 1e3), 1.0, positive=True) for name in self.free))


def positive(known: Known) -> Positive:
    return Positive(known.prior, known.labels, known.moments, known.fails)


def simulations(known: Known, count: int, seed: int) -> Moments:
    """λ of low discrepancy and their statistics."""
    values = known.prior.quantile(qmc.Sobol(len(known.free), rng=np.random.default_rng(seed)).random_base2(11)[:count])
    return values, known(values, seed_of(seed, range(count)))


def linear(statistics: int = 4) -> Known:
    """log λ → M log λ + noise of a full covariance."""
    rng = np.random.default_rng(0)
    slopes, half = rng.normal(size=(2, statistics)), rng.normal(size=(statistics, statistics))
    scatter = half @ half.T / statistics + 0.2 * np.eye(statistics)

    def moments(values: np.ndarray) -> Moments:
        return np.log(values) @ slopes, np.broadcast_to(scatter, (len(values), statistics, statistics))

    return Known(wide_prior(), tuple(f"s{k}" for k in range(statistics)), moments)


def curved() -> Known:
    """Curved means, noise that depends on λ by factors, and a correlation of 0.6 that does not."""
    correlation = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, 0.0], [0.0, 0.0, 1.0]])

    def moments(values: np.ndarray) -> Moments:
        a, b = np.log(values).T
        mean = np.stack([np.exp(0.7 * a) + b, 3 * np.tanh(a) + b**2, a * b + 2 * b], axis=1)
        sd = np.stack([0.3 * np.exp(0.5 * a), 0.4 + 0.2 * b**2, 0.5 * np.exp(-0.3 * b)], axis=1)
        return mean, sd[:, :, None] * sd[:, None, :] * correlation

    return Known(wide_prior(), ("p", "q", "r"), moments)


def folded() -> Known:
    """One statistic is the same on both sides of log a = 0, and flat between."""
    normal = {"distribution": "log-normal", "median": 1.0, "sd": 1.5}

    def moments(values: np.ndarray) -> Moments:
        x = np.log(values)
        mean = np.stack([1.0 + 0.3 * np.tanh(3.0 * (np.abs(x[:, 0]) - 1.0)), x[:, 1]], axis=1)
        return mean, np.tile(0.09 * np.eye(2), (len(values), 1, 1))

    return Known(Prior.of({"a": normal, "b": normal}), ("s", "t"), moments)


def fragile() -> Known:
    """`linear`, but simulations fail with a probability that rises with a, to 0.8."""
    whole = linear()

    def fails(values: np.ndarray) -> np.ndarray:
        return 0.8 * expit(3 * (np.log(values[:, 0]) - 0.8))

    return Known(whole.prior, whole.labels, whole.moments, fails)


def wide_prior() -> Prior:
    """Log-uniform over a factor of 50 in a and in b."""
    return Prior.of(
        {name: {"distribution": "log-uniform", "low": np.exp(-2), "high": np.exp(2)} for name in ("a", "b")}
    )
