"""How far simulated statistics are from observed ones, and how much a distance weighs at a tolerance ε.

    Li et al. 2024:   d = (1/K) √Σ_k ((o_k − s_k) / (1 + o_k))²,   K statistics; theirs were three
    Mahalanobis:      d = √((s − o)ᵀ C⁻¹ (s − o)),   C a covariance of the simulator's statistics
    weighted curves:  d = √(1/K Σ_k ((s_k − o_k) / scale_k)²)

o observed, s simulated. Where a simulation failed, d = ∞. Li et al. accept no simulation whose area is more
than 5 % off the observed one, and compare by the other statistics. Kernels K_ε(d), of which only ratios matter:

    indicator:  1 where d ≤ ε, else 0            Gaussian:  exp(−d² / 2ε²)
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import Square, correlation_root, whitened
from yeastfit.text import quoted

KernelName = Literal["indicator", "gaussian"]
KERNELS: tuple[KernelName, ...] = ("indicator", "gaussian")
NEAR_AREA = 0.05  # of the observed one

Statistics = Float[np.ndarray, "draw statistic"]
Vector = Float[np.ndarray, " statistic"]


@dataclass(frozen=True)
class LiDistance:
    """Differences relative to 1 + observed, for statistics of shapes, which are at least 0.

    Attributes:
        observed: Statistics.
        area: Number of the statistic, if any, that must lie within 5 % of the observed one instead of entering d.
    """

    observed: Vector
    area: int | None = None

    def __post_init__(self) -> None:
        _check_finite("observed", self.observed)
        count = len(self.observed)
        if self.area is not None and not (0 <= self.area < count and count > 1 and self.observed[self.area] > 0):
            raise InputError(f"area is {self.area}, it must be the number of an observed area among {count} statistics")
        if (self.observed <= -1).any():
            raise InputError(f"observed holds {self.observed.min():g}, this distance is one of statistics above −1")

    def __call__(self, simulated: Statistics) -> Float[np.ndarray, " draw"]:
        """d of Li et al."""
        if self.area is None:
            return _root_of_squares(simulated, self.observed, 1 + self.observed) / len(self.observed)
        rest, area = np.delete(self.observed, self.area), self.observed[self.area]
        others = LiDistance(rest)(np.delete(simulated, self.area, axis=1))
        near = np.abs(simulated[:, self.area] - area) <= NEAR_AREA * area
        return np.where(near, others, np.inf)


@dataclass(frozen=True)
class WeightedCurves:
    """Root mean squared difference, each statistic in units of its scale, such as a standard deviation."""

    observed: Vector
    scale: Vector

    def __post_init__(self) -> None:
        _check_finite("observed", self.observed)
        _check_finite("scale", self.scale)
        if self.scale.shape != self.observed.shape or (self.scale <= 0).any():
            raise InputError(f"scale is {self.scale}, it needs {len(self.observed)} values above 0, as observed has")

    def __call__(self, simulated: Statistics) -> Float[np.ndarray, " draw"]:
        """d of weighted curves."""
        return _root_of_squares(simulated, self.observed, self.scale) / np.sqrt(len(self.observed))


@dataclass(frozen=True)
class Mahalanobis:
    """Differences in standard deviations of uncorrelated combinations of the statistics."""

    observed: Vector
    covariance: Float[np.ndarray, "statistic statistic"]

    def __post_init__(self) -> None:
        _check_finite("observed", self.observed)
        _check_finite("covariance", self.covariance)
        count, variances = len(self.observed), np.diag(self.covariance)
        if self.covariance.shape != (count, count) or not np.allclose(self.covariance, self.covariance.T):
            raise InputError(f"covariance has shape {self.covariance.shape}, it must be symmetric, {count} by {count}")
        if (variances <= 0).any():
            raise InputError(f"covariance: statistic {np.argmin(variances)} does not vary, leave it out")
        _ = self._root

    @staticmethod
    def of(observed: Vector, simulated: Statistics) -> "Mahalanobis":
        """With the covariance of simulated statistics, leaving out simulations that failed."""
        whole = simulated[np.isfinite(simulated).all(axis=1)]
        if len(whole) <= len(observed):
            raise InputError(
                f"simulated holds {len(whole)} data sets that succeeded, the covariance of {len(observed)} "
                f"statistics needs at least {len(observed) + 1}"
            )
        return Mahalanobis(observed, np.atleast_2d(np.cov(whole, rowvar=False)))

    def __call__(self, simulated: Statistics) -> Float[np.ndarray, " draw"]:
        """d of Mahalanobis."""
        scale, root = self._root
        differences, whole = _differences(simulated, self.observed, scale)
        return np.where(whole, np.linalg.norm(whitened(root, differences.T).T, axis=1), np.inf)

    @cached_property
    def _root(self) -> tuple[Vector, Square]:
        """Standard deviations, and the root of the correlations. Raise `InputError` where these are singular."""
        of, advice = f"{len(self.observed)} statistics", "estimate it from more simulations than there are statistics"
        return correlation_root(self.covariance, argument="covariance", of=of, advice=advice)


def log_kernel(kernel: KernelName, distance: Float[np.ndarray, " draw"], epsilon: float) -> Float[np.ndarray, " draw"]:
    """log K_ε(d); −inf where the weight is 0. An infinite ε accepts every finite distance."""
    if kernel == "indicator":
        return np.where((distance <= epsilon) & np.isfinite(distance), 0.0, -np.inf)
    return -0.5 * (distance / epsilon) ** 2 if np.isfinite(epsilon) else np.where(np.isfinite(distance), 0.0, -np.inf)


Distance = LiDistance | WeightedCurves | Mahalanobis


def _root_of_squares(simulated: Statistics, observed: Vector, scale: Vector) -> Float[np.ndarray, " draw"]:
    differences, whole = _differences(simulated, observed, scale)
    return np.where(whole, np.linalg.norm(differences, axis=1), np.inf)


def _differences(simulated: Statistics, observed: Vector, scale: Vector) -> tuple[Statistics, np.ndarray]:
    """(s − o) / scale, 0 where a row is not finite, and which rows are."""
    if simulated.shape[1] != len(observed):
        raise InputError(f"simulated has {simulated.shape[1]} statistics, observed has {len(observed)}")
    whole = np.isfinite(simulated).all(axis=1)
    return np.where(whole[:, None], simulated - observed, 0.0) / scale, whole


def _check_finite(name: str, values: np.ndarray) -> None:
    if not values.size or not np.isfinite(values).all():
        raise InputError(f"{name} is {quoted(values)}, it must be finite numbers")
