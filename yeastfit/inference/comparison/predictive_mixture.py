"""What a posterior predicts of a single colony: a mixture of the emulator's normal distributions, one of each draw.

    p(y | data) = Σ_i w_i p_i N(y; m(λ_i), C(λ_i) + M + E(λ_i) + N)

m and C are the emulator's mean and scatter of one colony, E its own error, p the probability that the colony comes to
something, and N the covariance of errors of measurement, as in the likelihood (`emulator`). Where λ scatters between
colonies, m and C are of colonies around λ, and M is the covariance of errors that each has for itself
(`single_colonies`); otherwise it is 0.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp, ndtr

from yeastfit.inference.neural_likelihood.emulator import Emulator, Square
from yeastfit.inference.prior.places import Places

HALVINGS = 60  # of the bracket of a quantile, which is exact to rounding then
FAR = 40.0  # standard deviations from the outermost mean, beyond which there is nothing


@dataclass(frozen=True)
class PredictiveMixture:
    """Normal distributions of a colony's statistics, one of each draw.

    Attributes:
        mean: m.
        covariance: C + M + E + N.
        log_weight: log w p.
    """

    mean: Float[np.ndarray, "draw statistic"]
    covariance: Float[np.ndarray, "draw statistic statistic"]
    log_weight: Float[np.ndarray, " draw"]

    @staticmethod
    def of(
        emulator: Emulator,
        values: Float[np.ndarray, "draw free"] | Places[np.ndarray],
        noise: Square | None = None,
        weights: Float[np.ndarray, " draw"] | None = None,
        single: Square | None = None,
    ) -> "PredictiveMixture":
        """At draws of a posterior.

        Arguments:
            emulator: Of one colony's statistics.
            values: λ, or where colonies of it are.
            noise: N, in the statistics' units.
            weights: w; all equal by default.
            single: M; 0 by default.
        """
        mean, scatter, error, success = emulator.moments(values)
        scatter = scatter + (0.0 if single is None else single)
        share = np.full(len(mean), 1.0 / len(mean)) if weights is None else weights / weights.sum()
        with np.errstate(divide="ignore"):
            log_weight = np.log(share) + np.log(success)
        return PredictiveMixture(mean, scatter + error + (0.0 if noise is None else noise), log_weight)

    def log_density(self, colony: Float[np.ndarray, " statistic"]) -> float:
        """log p(y | data), of the statistics in their own units."""
        root = np.linalg.cholesky(self.covariance)
        away = np.linalg.solve(root, (colony - self.mean)[:, :, None])[:, :, 0]
        volume = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        normal = -0.5 * (away**2).sum(axis=1) - volume - 0.5 * len(colony) * np.log(2 * np.pi)
        return float(logsumexp(self.log_weight + normal))

    def below(self, values: Float[np.ndarray, "*row statistic"]) -> Float[np.ndarray, "*row statistic"]:
        """Predicted probability of each statistic to be no larger than this, of colonies whose simulation succeeded."""
        return np.einsum("d,...dk->...k", self._share, ndtr((values[..., None, :] - self.mean) / self._sd))

    def quantiles(self, shares: Float[np.ndarray, " share"]) -> Float[np.ndarray, "share statistic"]:
        """Of each statistic, by halving a bracket."""
        low, high = ((self.mean + side * FAR * self._sd) for side in (-1.0, 1.0))
        low, high = (
            np.broadcast_to(one, (len(shares), self.mean.shape[1])) for one in (low.min(axis=0), high.max(axis=0))
        )
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            above = self.below(middle) > shares[:, None]
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return 0.5 * (low + high)

    @property
    def _share(self) -> Float[np.ndarray, " draw"]:
        return np.exp(self.log_weight - logsumexp(self.log_weight))

    @property
    def _sd(self) -> Float[np.ndarray, "draw statistic"]:
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
