"""Draws from a posterior: moments, quantiles, and how many independent draws they are worth."""

from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.posterior.chain_diagnostics import FEWEST_DRAWS, ChainDiagnostics, diagnose
from yeastfit.inference.prior.prior import Prior
from yeastfit.text import quoted


@dataclass(frozen=True, kw_only=True, eq=False)
class Draws:
    """Draws of λ, in chains or weighted, each with its simulated statistics.

    Attributes:
        prior: Of the parameters.
        labels: Names of the statistics.
        observed: The data.
        replicates: How many replicates `observed` is the mean of.
        noise: Covariance of the errors of measurement of `observed`.
        varying: Names of the parameters that scatter between colonies, where some alone do (`Variation`).
        values: λ.
        weights: Sum to 1 over all chains and draws; equal for chains.
        log_probability: As the method keeps it, up to a constant; nan where it keeps none.
        log_likelihood: Of each draw, up to a constant, where the method has one.
        acceptance: Share of accepted proposals of each chain, or of each population of weighted draws.
        statistics: Simulated with each draw; nan where none are.
        worth: Independent draws per parameter, where the method knows better than chains or weights tell.

    Raises:
        InputError: A value is not finite, the weights do not sum to 1, or `worth` is not of the parameters.
    """

    prior: Prior
    labels: tuple[str, ...]
    observed: Float[np.ndarray, " statistic"]
    replicates: int = 1
    noise: Float[np.ndarray, "statistic statistic"] | None = None
    varying: tuple[str, ...] = ()
    values: Float[np.ndarray, "chain draw free"]
    weights: Float[np.ndarray, "chain draw"]
    log_probability: Float[np.ndarray, "chain draw"]
    acceptance: Float[np.ndarray, " part"]
    statistics: Float[np.ndarray, "chain draw statistic"]
    worth: Float[np.ndarray, " free"] | None = None
    log_likelihood: Float[np.ndarray, "chain draw"] | None = None

    def __post_init__(self) -> None:
        total = self.weights.sum()
        if not (np.isfinite(self.values).all() and (self.weights >= 0).all() and np.isclose(total, 1.0)):
            raise InputError(f"values must be finite and weights at least 0 with sum 1, their sum is {total:g}")
        if self.worth is not None and np.shape(self.worth) != (len(self.free),):
            raise InputError(f"worth has the shape {np.shape(self.worth)}, it must be one number per parameter")

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters, the columns of `values`."""
        return self.prior.free

    @property
    def flat(self) -> Float[np.ndarray, "draw free"]:
        """Draws of all chains, chain by chain, in the order of `weights.ravel()`."""
        return self.values.reshape(-1, len(self.free))

    @property
    def weighted(self) -> bool:
        """Whether draws differ in weight."""
        return bool(np.ptp(self.weights) > 1e-9 * self.weights.max())

    @property
    def mean(self) -> Float[np.ndarray, " free"]:
        """Mean of λ."""
        return self.weights.ravel() @ self.flat

    @property
    def sd(self) -> Float[np.ndarray, " free"]:
        """Standard deviation of λ."""
        return np.sqrt(self.weights.ravel() @ (self.flat - self.mean) ** 2)

    def quantile(self, share: float) -> Float[np.ndarray, " free"]:
        """λ below which `share` of the posterior lies, parameter by parameter.

        Interpolated linearly in the share, with each draw at the middle of its weight.

        Raises:
            InputError: The share is not in 0..1.
        """
        if not 0 <= share <= 1:
            raise InputError(f"share is {share}, it must lie in 0..1")
        return np.array([weighted_quantile(column, self.weights.ravel(), share) for column in self.flat.T])

    def interval(self, level: float) -> Float[np.ndarray, "free 2"]:
        """Central interval that holds `level` of the posterior.

        Raises:
            InputError: The level is not in 0..1.
        """
        check_level(level)
        return np.stack([self.quantile(0.5 - 0.5 * level), self.quantile(0.5 + 0.5 * level)], axis=1)

    def drawn(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "draw free"]:
        """`count` of the draws, with replacement, each as likely as its weight says."""
        return self.flat[rng.choice(self.weights.size, size=count, p=self.weights.ravel() / self.weights.sum())]

    @cached_property
    def chains(self) -> ChainDiagnostics | None:
        """Diagnostics of the chains, in the prior's coordinates; None for weighted draws and for very short chains."""
        count, draws = self.weights.shape
        if self.weighted or draws < FEWEST_DRAWS:
            return None
        x = self.prior.coordinates(self.flat).reshape(self.values.shape)
        each = len(self.acceptance) == count
        acceptance = self.acceptance if each else np.full(count, self.acceptance[-1])
        return diagnose(x, free=self.free, acceptance=acceptance)

    @property
    def effective_size(self) -> Float[np.ndarray, " free"]:
        """Independent draws that would give the mean with the same error.

        `worth` where the method states it; N/τ of chains, τ their autocorrelation time; else 1 / Σw² (Kish).
        """
        if self.worth is not None:
            return self.worth
        if self.chains is not None:
            return self.chains.effective_size
        return np.full(len(self.free), 1.0 / np.sum(self.weights**2))


def check_level(level: Any) -> None:
    """Raise `InputError` where the level of an interval is no share."""
    if not isinstance(level, Real) or not 0 <= float(level) <= 1:
        raise InputError(f"level is {quoted(level)}, it must be a number in 0..1, such as 0.9 for 90 %")


def weighted_quantile(values: Float[np.ndarray, " draw"], weights: Float[np.ndarray, " draw"], share: float) -> float:
    """Quantile of weighted draws, interpolated as in `Draws.quantile`."""
    order = np.argsort(values, kind="stable")
    each = weights[order]
    middles = (np.cumsum(each) - 0.5 * each) / each.sum()
    return float(np.interp(share, middles, values[order]))
