"""Pilot simulations: λ from the prior, and what their simulations say before anything is sampled."""

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
from yeastfit.inference.polynomial import PolynomialRegression, monomials
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.simulator import Simulator, seed_of

DistanceName = Literal["li", "mahalanobis", "curves"]
DISTANCES: tuple[DistanceName, ...] = ("mahalanobis", "curves", "li")

NEAREST = 5  # simulations per parameter, at least, that a covariance is estimated from


@dataclass(frozen=True)
class Pilot:
    """Simulations 0..n−1 of a run.

    Attributes:
        x: λ in the prior's coordinates.
        log_prior: Density in them.
        statistics: Simulated.
        distances: From the data; inf where a simulation failed.
        warnings: In words, of observations that the prior does not reach.
    """

    x: Float[np.ndarray, "draw free"]
    log_prior: Float[np.ndarray, " draw"]
    statistics: Float[np.ndarray, "draw statistic"]
    distances: Float[np.ndarray, " draw"]
    warnings: list[str]

    def quantile(self, share: float) -> float:
        """ε that this share of the successful simulations reaches; above 0."""
        finite = self.distances[np.isfinite(self.distances)]
        epsilon = float(np.quantile(finite, share, method="higher"))
        return epsilon if epsilon > 0 else float(np.min(finite[finite > 0], initial=1.0))

    def weights(self, kernel: KernelName, epsilon: float) -> Float[np.ndarray, " draw"]:
        """K_ε, scaled to sum 1.

        Raises:
            InputError: No simulation comes that close.
        """
        log_weights = log_kernel(kernel, self.distances, epsilon)
        if not np.isfinite(log_weights).any():
            raise InputError(
                f"tolerance is {epsilon:g}, none of {len(self.distances)} simulations from the prior comes that close, "
                f"the nearest has distance {self.distances.min():g}: a larger tolerance, more simulations, or another "
                f"prior or model is needed{''.join(f'; {one}' for one in self.warnings)}"
            )
        weights = np.exp(log_weights - log_weights.max())
        return weights / weights.sum()

    def covariance(self, epsilon: float) -> Float[np.ndarray, "free free"]:
        """Covariance of x of the simulations within ε, or of the nearest where these are too few.

        Raises:
            InputError: Too few simulations were successful.
        """
        free = self.x.shape[1]
        finite = int(np.isfinite(self.distances).sum())
        count = min(finite, max(int(np.sum(self.distances <= epsilon)), NEAREST * (free + 1)))
        nearest = np.argsort(self.distances, kind="stable")[:count]
        covariance = np.zeros((free, free))
        if count > free:
            covariance = np.atleast_2d(np.cov(self.x[nearest], rowvar=False))
        if np.linalg.eigvalsh(covariance)[0] <= 0:
            raise InputError(f"{count} pilot simulations succeeded, too few for a covariance: give a larger pilot")
        return covariance


def pilot_of(problem: Problem, data_sets: Simulator, distance: Distance, count: int, seed: int) -> Pilot:
    """The first simulations of a run, which are the same for every method.

    Arguments:
        problem: Prior and data.
        data_sets: Simulates data sets.
        distance: From the data.
        count: How many.
        seed: Of the run.

    Raises:
        InputError: All failed, or none has a distance from the data.
    """
    values = problem.prior_values(count, seed)
    statistics = data_sets(values, seed_of(seed, np.arange(count)))
    distances = distance(statistics)
    whole = np.isfinite(statistics).all(axis=1)
    if not whole.any():
        raise InputError(f"all {count} simulations from the prior failed: look at the simulator or the prior")
    x = problem.prior.coordinates(values)
    warnings = problem.unreached(statistics[whole])
    if not np.isfinite(distances).any():
        raise InputError(
            f"none of {count} simulations from the prior has an area within {100 * NEAR_AREA:g} % of the observed one: "
            f"{'; '.join(warnings) or 'a larger pilot or another prior is needed'}"
        )
    return Pilot(x, problem.prior.log_density_of_coordinates(x), statistics, distances, warnings)


def no_pilot(problem: Problem) -> Pilot:
    """One without simulations, where nothing is asked of it."""
    nothing = np.zeros(0)
    return Pilot(np.zeros((0, len(problem.prior.free))), nothing, np.zeros((0, len(problem.labels))), nothing, [])


def is_estimated(distance: Distance | str) -> bool:
    """Whether a distance is scaled by a pilot: known ones are not, nor that of Li et al."""
    return isinstance(distance, str) and distance != "li"


def check_pilot(distance: Distance | str, count: int, free: int, statistics: int) -> int:
    """Check that a pilot is large enough for a distance that is scaled by it.

    Arguments:
        distance: A name, or a distance that is known.
        count: Pilot simulations.
        free: Parameters.
        statistics: That are compared, at least.

    Returns:
        How many simulations are needed.

    Raises:
        InputError: There are fewer.
    """
    if not is_estimated(distance):
        return 0
    needed = (free + 1) * (free + 2) // 2 + 2 * statistics  # terms of a quadratic, and statistics
    if count < needed:
        raise InputError(f"pilot is {count}, the scatter of {statistics} statistics needs at least {needed}")
    return needed


def distance_of(name: DistanceName, problem: Problem, data_sets: Simulator, count: int, seed: int) -> Distance:
    """A distance from the problem's data.

    `li` is that of Li et al.; where area is among the statistics, the last area becomes a condition. The others compare
    statistics by their scatter about a quadratic in the prior's coordinates, over pilot simulations. That scatter is
    what simulations with one λ differ by; over the whole prior they differ much more.

    Arguments:
        name: One of `DISTANCES`.
        problem: Prior and data.
        data_sets: Simulates data sets.
        count: Pilot simulations.
        seed: Of the run.

    Raises:
        InputError: The pilot is too small to estimate the scatter.
    """
    observed = problem.observed
    if name == "li":
        areas = [k for k, one in enumerate(problem.simulator.observables) if one.statistic == "area"]
        return LiDistance(observed, areas[-1] if areas and len(observed) > 1 else None)
    needed = check_pilot(name, count, len(problem.prior.free), len(observed))
    pilot = pilot_of(problem, data_sets, WeightedCurves(observed, np.ones(len(observed))), count, seed)
    whole = np.isfinite(pilot.distances)
    x, statistics = pilot.x[whole], pilot.statistics[whole]
    x = (x - x.mean(axis=0)) / x.std(axis=0)
    terms = monomials(x)
    if len(x) < needed:
        raise InputError(
            f"pilot: {len(x)} of {count} simulations succeeded, the scatter of {len(observed)} statistics "
            f"needs at least {needed}"
        )
    covariance = PolynomialRegression.of(terms, statistics).covariance
    if name == "curves":
        return WeightedCurves(observed, np.sqrt(np.diag(covariance)))
    return Mahalanobis(observed, 0.5 * (covariance + covariance.T))
