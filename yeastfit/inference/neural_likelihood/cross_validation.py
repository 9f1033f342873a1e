"""Cross-validation of an emulator: standardised residuals of simulations held out from training, ideally N(0, 1).

**Misfit Δ.** e [row, statistic] are the residuals, Q an orthonormal basis of the T terms of a quadratic in x over the
rows. Where the emulator's mean is right, Qᵀe holds T draws of each statistic's noise, whose variance σ² is known from
the rest. Where it is wrong by something smooth, there is more:

    Δ_k = max(0, Σ (Qᵀe)²_k − T σ_k²) / rows.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

MOST_CHANCE = 4.0  # standard errors that still count as chance
MEAN_OFF = 0.1  # standard deviations from 0 that are warned of
VARIANCE_OFF = 0.2  # difference from 1 that is warned of


@dataclass(frozen=True)
class CrossValidation:
    """How far held-out residuals e are from independent draws of N(0, 1).

    Entry k of e is statistic k less its expectation given λ and the statistics before it, over its standard deviation.

    Attributes:
        labels: Names of the statistics.
        mean: Of e; should be 0.
        covariance: Of e; should be the identity.
        misfit: Δ.
        rows: How many residuals.
    """

    labels: tuple[str, ...]
    mean: Float[np.ndarray, " statistic"]
    covariance: Float[np.ndarray, "statistic statistic"]
    misfit: Float[np.ndarray, " statistic"]
    rows: int

    @staticmethod
    def of(
        residuals: Float[np.ndarray, "row statistic"],
        features: Float[np.ndarray, "row feature"],
        labels: tuple[str, ...],
    ) -> "CrossValidation":
        """Of residuals, with the terms of the quadratic in each row as `features`."""
        rows, count = residuals.shape
        basis = np.linalg.qr(features)[0]
        explained = np.sum((basis.T @ residuals) ** 2, axis=0)
        left = (np.sum(residuals**2, axis=0) - explained) / max(rows - basis.shape[1], 1)
        misfit = np.maximum(explained - basis.shape[1] * left, 0.0) / rows
        covariance = np.cov(residuals, rowvar=False).reshape(count, count)
        return CrossValidation(labels, residuals.mean(axis=0), covariance, misfit, rows)

    def sentences(self) -> list[str]:
        """What is off by more than chance allows for so few residuals; empty where all is well."""
        sentences = []
        chance = MOST_CHANCE / np.sqrt(self.rows)
        for label, mean, variance in zip(self.labels, self.mean, np.diag(self.covariance), strict=True):
            if abs(mean) > max(chance, MEAN_OFF):
                sentences.append(f"emulator: held-out {label} is off by {mean:+.2f} standard deviations on average")
            if abs(variance - 1.0) > max(chance * np.sqrt(2.0), VARIANCE_OFF):
                sentences.append(
                    f"emulator: held-out {label} scatters with {variance:.2f} times the variance it should have"
                )
        pairs = np.triu(self.covariance, 1)
        row, column = np.unravel_index(np.abs(pairs).argmax(), pairs.shape)
        if abs(pairs[row, column]) > max(chance, VARIANCE_OFF):
            pair = f"{self.labels[row]} and {self.labels[column]}"
            sentences.append(
                f"emulator: held-out residuals of {pair} have a covariance of {pairs[row, column]:+.2f}, not 0"
            )
        return sentences
