"""Pilot simulations: λ from the prior, what comes of them, and what that says before anything is sampled."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import (
    NEAR_AREA,
    Distance,
    KernelName,
    LiDistance,
    Mahalanobis,
    WeightedCurves,
    log_kernel,
)
from yeastfit.inference.polynomial import PolynomialRegression, monomials, sobol_points
from yeastfit.inference.posterior.prior import Prior
from yeastfit.inference.posterior.simulation_store import Recorded
from yeastfit.inference.simulator import Simulator, Stream, labels_of, seed_of, stream_of

DistanceName = Literal["li", "mahalanobis", "curves"]

NEAREST = 5  # simulations per parameter that a covariance is made of, at least


@dataclass(frozen=True)
class Pilot:
    """Simulations 0..n−1 of a run.

    x: λ in the prior's coordinates; log_prior: density in them. distances: inf where a simulation came to nothing.
    warnings: in words, of observations that the prior does not reach.
    """

    x: Float[np.ndarray, "draw free"]
    log_prior: Float[np.ndarray, " draw"]
    statistics: Float[np.ndarray, "draw statistic"]
    distances: Float[np.ndarray, " draw"]
    warnings: list[str]

    def quantile(self, share: float) -> float:
        """ε that this share of the simulations that came to something reaches; above 0."""
        whole = self.distances[np.isfinite(self.distances)]
        found = float(np.quantile(whole, share, method="higher"))
        return found if found > 0 else float(np.min(whole[whole > 0], initial=1.0))

    def weights(self, kernel: KernelName, epsilon: float) -> Float[np.ndarray, " draw"]:
        """K_ε, scaled to sum 1."""
        log_weights = log_kernel(kernel, self.distances, epsilon)
        if not np.isfinite(log_weights).any():
            raise InputError(
                f"epsilon is {epsilon:g}, none of {len(self.distances)} simulations from the prior comes that close, "
                f"the nearest has distance {self.distances.min():g}: a larger epsilon, more simulations, or another "
                f"prior or model is needed{''.join(f'; {one}' for one in self.warnings)}"
            )
        weights = np.exp(log_weights - log_weights.max())
        return weights / weights.sum()

    def covariance(self, epsilon: float) -> Float[np.ndarray, "free free"]:
        """Of x, of those within ε or of the nearest where these are too few."""
        free = self.x.shape[1]
        whole = int(np.isfinite(self.distances).sum())
        count = min(whole, max(int(np.sum(self.distances <= epsilon)), NEAREST * (free + 1)))
        nearest = np.argsort(self.distances, kind="stable")[:count]
        found = np.atleast_2d(np.cov(self.x[nearest], rowvar=False)) if count > free else np.zeros((free, free))
        if np.linalg.eigvalsh(found)[0] <= 0:
            raise InputError(
                f"{count} pilot simulations came to something, too few for a covariance: give a larger pilot"
            )
        return found


def first_values(prior: Prior, count: int, seed: int) -> Float[np.ndarray, "draw free"]:
    """λ of simulations 0..count−1 of a run, the same for every method: scrambled Sobol' points of the prior."""
    return prior.quantile(sobol_points(count, len(prior.free), stream_of(seed, Stream.PRIOR, 0)))


def pilot_of(recorded: Recorded, prior: Prior, distance: Distance, count: int, seed: int) -> Pilot:
    """The first simulations of a run, which stored ones of any method serve for."""
    values = first_values(prior, count, seed)
    statistics = recorded(values, seed_of(seed, np.arange(count)))
    distances = distance(statistics)
    came = np.isfinite(statistics).all(axis=1)
    if not came.any():
        raise InputError(f"all {count} simulations from the prior came to nothing: look at the simulator or the prior")
    x = prior.coordinates(values)
    warnings = unreached(statistics[came], distance.observed, recorded.labels)
    if not np.isfinite(distances).any():
        raise InputError(
            f"none of {count} simulations from the prior has an area within {100 * NEAR_AREA:g} % of the observed one: "
            f"{'; '.join(warnings) or 'a larger pilot or another prior is needed'}"
        )
    return Pilot(x, prior.log_density_of_coordinates(x), statistics, distances, warnings)


def distance_of(
    name: DistanceName,
    recorded: Recorded,
    prior: Prior,
    observed: Float[np.ndarray, " statistic"],
    pilot: int,
    seed: int,
) -> Distance:
    """Li et al.'s; or by the scatter of the pilot's simulations about a quadratic in their coordinates.

    Where area is among the statistics, Li et al.'s makes a condition of the last one.

    That scatter is what colonies of one λ differ by, which data sets should be compared by; over all of the prior's λ
    statistics differ much more. Raises `InputError` where the pilot is too small to tell it.
    """
    if name == "li":
        areas = [k for k, label in enumerate(recorded.labels) if label.startswith("area at ")]
        return LiDistance(observed, areas[-1] if areas and len(observed) > 1 else None)
    found = pilot_of(recorded, prior, WeightedCurves(observed, np.ones(len(observed))), pilot, seed)
    whole = np.isfinite(found.distances)
    x, statistics = found.x[whole], found.statistics[whole]
    x = (x - x.mean(axis=0)) / x.std(axis=0)
    terms = monomials(x)
    needed = terms.shape[1] + 2 * len(observed)
    if len(x) < needed:
        raise InputError(
            f"pilot: {len(x)} of {pilot} simulations came to something, the scatter of {len(observed)} statistics "
            f"needs at least {needed}"
        )
    covariance = PolynomialRegression.of(terms, statistics).covariance
    if name == "curves":
        return WeightedCurves(observed, np.sqrt(np.diag(covariance)))
    return Mahalanobis(observed, 0.5 * (covariance + covariance.T))


def check_problem(simulator: Simulator, prior: Prior, distance: Distance) -> None:
    """Raises `InputError` where simulator, prior and data do not go together."""
    if prior.free != simulator.parameters.names:
        raise InputError(
            f"prior is of {', '.join(prior.free)}, the simulator takes {', '.join(simulator.parameters.names)}"
        )
    if len(distance.observed) != len(labels_of(simulator)):
        raise InputError(
            f"observed has {len(distance.observed)} statistics, the simulator gives {', '.join(labels_of(simulator))}"
        )


def unreached(
    statistics: Float[np.ndarray, "draw statistic"], observed: Float[np.ndarray, " statistic"], labels: tuple[str, ...]
) -> list[str]:
    """Observations outside all that was simulated, in words."""
    low, high = statistics.min(axis=0), statistics.max(axis=0)
    out = np.flatnonzero((observed < low) | (observed > high))
    return [
        f"{labels[k]} was observed as {observed[k]:.4g}, the prior's simulations have {low[k]:.4g}..{high[k]:.4g}"
        for k in out
    ]
