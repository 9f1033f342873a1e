"""A reference posterior, as exact as simulation allows, and the distance of a sampler's result from it.

x are the prior's coordinates: log λ where its distribution is one of log λ. The data o are the mean of the statistics
of R colonies. Single colonies at low-discrepancy points of a box give, by least squares,

    m(x): mean, a cubic;    C(x): scatter, a quadratic through products of the residuals;    o | x ~ N(m(x), C(x) / R).

The posterior is a sum over a finer set of such points. A first box around the truth locates it; a second box around it
reaches `WIDTH` standard deviations. Its own error is half the difference between two such posteriors, from one half of
the colonies each. The mean of R colonies is assumed normal. A check without that assumption: the nearest of many
simulated data sets, drawn uniformly from the box of `NEAR` standard deviations, with regression adjustment.

**Error** of means μ and standard deviations σ of x relative to the reference: the largest, over parameters, of
|μ − μ_ref| / σ_ref and |log(σ / σ_ref)|.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from yeastfit.errors import InputError
from yeastfit.inference.abc.distances import Mahalanobis
from yeastfit.inference.abc.regression_adjustment import Accepted
from yeastfit.inference.polynomial import monomials, sobol_points
from yeastfit.inference.posterior.problem import Problem
from yeastfit.inference.prior.distributions import Distribution
from yeastfit.inference.prior.prior import Prior
from yeastfit.inference.simulator import Replicates, Simulator, seed_of

WIDTH, NEAR = 4.5, 3.0  # standard deviations
POINTS = 16_384  # of the sum over the posterior
SHELL, LOST = 0.95, 0.01  # of the box's reach; largest share of the posterior beyond it
DATA_SEED, FIRST_SEED, POOL_SEED, POINTS_SEED, WITNESS_SEED = 80_001, 80_002, 80_003, 80_004, 80_005

Coordinates = Float[np.ndarray, "draw free"]
Statistics = Float[np.ndarray, "draw statistic"]
Vector = Float[np.ndarray, " free"]


@dataclass(frozen=True)
class Moments:
    """Mean and standard deviation of x."""

    mean: Vector
    sd: Vector

    @staticmethod
    def of(x: Coordinates, weights: Float[np.ndarray, " draw"]) -> "Moments":
        """Of weighted draws; the weights sum to 1."""
        mean = weights @ x
        return Moments(mean, np.sqrt(weights @ (x - mean) ** 2))

    def error(self, found: "Moments") -> float:
        """The error of `found`, with this as the reference."""
        shift, width = (found.mean - self.mean) / self.sd, np.log(found.sd / self.sd)
        return float(max(np.abs(shift).max(), np.abs(width).max()))


@dataclass(frozen=True)
class Case:
    """What is inferred. colonies: simulates single colonies. observed: mean of `replicates` of them, at `truth`."""

    colonies: Simulator
    prior: Prior
    observed: Float[np.ndarray, " statistic"]
    replicates: int
    truth: Vector

    @staticmethod
    def at(colonies: Simulator, prior: Prior, truth: Vector, replicates: int) -> "Case":
        """With data simulated at these λ."""
        data_set = Replicates(colonies, replicates)(truth[None], seed_of(DATA_SEED, [0]))[0]
        if not np.isfinite(data_set).all():
            raise InputError(f"truth is {truth}, a colony there failed")
        return Case(colonies, prior, data_set, replicates, truth)

    @property
    def problem(self) -> Problem:
        """What a sampler solves."""
        return Problem(self.colonies, self.prior, self.observed, self.replicates)

    @property
    def data_sets(self) -> Simulator:
        """Simulates data sets: means of as many colonies as were observed."""
        return Replicates(self.colonies, self.replicates) if self.replicates > 1 else self.colonies


@dataclass(frozen=True)
class Box:
    """A box in x, inside the prior's support."""

    low: Vector
    high: Vector

    @staticmethod
    def around(prior: Prior, centre: Vector, reach: Vector) -> "Box":
        """centre ± reach."""
        low, high = prior.coordinates(prior.support.T)
        return Box(np.maximum(low, centre - reach), np.minimum(high, centre + reach))

    def points(self, count: int, seed: int) -> Coordinates:
        """Low-discrepancy points."""
        return self.low + (self.high - self.low) * sobol_points(count, len(self.low), seed)

    def at_edge(self, prior: Prior, x: Coordinates) -> Bool[np.ndarray, " draw"]:
        """Which points lie near an edge that is not the prior's own."""
        low, high = prior.coordinates(prior.support.T)
        units = self.units(x)
        return (((units < -SHELL) & (self.low > low)) | ((units > SHELL) & (self.high < high))).any(axis=1)

    def prior(self, prior: Prior) -> Prior:
        """A flat prior over the box, in the same coordinates."""
        ends = prior.values(np.stack([self.low, self.high])).T.tolist()
        families = ["log-uniform" if one.logarithmic else "uniform" for one in prior.distributions.values()]
        return Prior(
            {
                name: Distribution(family, {"low": low, "high": high})
                for name, family, (low, high) in zip(prior.free, families, ends, strict=True)
            }
        )

    def units(self, x: Coordinates) -> Coordinates:
        """Coordinates from −1 to 1 in each direction."""
        return (2 * x - self.low - self.high) / (self.high - self.low)


@dataclass(frozen=True)
class Surfaces:
    """m and C over a box, as coefficients of monomials."""

    box: Box
    mean: Float[np.ndarray, "cubic statistic"]
    scatter: Float[np.ndarray, "quadratic statistic statistic"]

    @staticmethod
    def through(box: Box, x: Coordinates, statistics: Statistics) -> "Surfaces":
        """By least squares, without failed simulations."""
        whole = np.isfinite(statistics).all(axis=1)
        cubic, quadratic = (monomials(box.units(x[whole]), degree) for degree in (3, 2))
        mean = np.linalg.lstsq(cubic, statistics[whole], rcond=None)[0]
        rest = statistics[whole] - cubic @ mean
        products = (rest[:, :, None] * rest[:, None, :]).reshape(len(rest), -1)
        scatter = np.linalg.lstsq(quadratic, products, rcond=None)[0] * len(rest) / (len(rest) - cubic.shape[1])
        return Surfaces(box, mean, scatter.reshape(-1, *2 * statistics.shape[1:]))

    def at(self, x: Coordinates) -> tuple[Statistics, Float[np.ndarray, "draw statistic statistic"]]:
        """m and C at some points."""
        units = self.box.units(x)
        return monomials(units, 3) @ self.mean, np.tensordot(monomials(units, 2), self.scatter, axes=1)

    def posterior(self, case: Case) -> tuple[Coordinates, Float[np.ndarray, " draw"]]:
        """Points of the box with their posterior weights."""
        x = self.box.points(POINTS, POINTS_SEED)
        mean, scatter = self.at(x)
        root = np.linalg.cholesky(scatter / case.replicates)
        off = np.linalg.solve(root, (case.observed - mean)[..., None])[..., 0]
        log_density = case.prior.log_density_of_coordinates(x) - 0.5 * np.sum(off**2, axis=1)
        log_density -= np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        weights = np.exp(log_density - log_density.max())
        return x, weights / weights.sum()


@dataclass(frozen=True)
class Reference:
    """Moments of the posterior, their error, and the surfaces behind them."""

    moments: Moments
    own_error: float
    surfaces: Surfaces

    @staticmethod
    def of(case: Case, reach: Vector, pool: int) -> "Reference":
        """From `pool` colonies, a quarter of them in the first box, truth ± reach.

        Raises `InputError` if the second box does not contain the posterior.
        """
        centre = case.prior.coordinates(case.truth[None])[0]
        first = grown(case, Box.around(case.prior, centre, reach), pool // 4, FIRST_SEED)
        where = Moments.of(*Surfaces.through(*first).posterior(case))
        box, x, statistics = grown(
            case, Box.around(case.prior, where.mean, WIDTH * where.sd), pool - pool // 4, POOL_SEED
        )
        surfaces = Surfaces.through(box, x, statistics)
        points, weights = surfaces.posterior(case)
        lost = float(weights[box.at_edge(case.prior, points)].sum())
        if lost > LOST:
            raise InputError(f"reach is {reach}: {100 * lost:.1f} % of the posterior lies at the edge of its box")
        halves = [
            Moments.of(*Surfaces.through(box, *half).posterior(case))
            for half in zip(np.array_split(x, 2), np.array_split(statistics, 2), strict=True)
        ]
        return Reference(Moments.of(points, weights), 0.5 * halves[0].error(halves[1]), surfaces)

    def witness(self, case: Case, data_sets: int, nearest: int) -> tuple[Moments, list[str]]:
        """Moments of the nearest simulated data sets after regression adjustment, and why it failed if it did."""
        prior, observed = case.prior, case.observed
        box = Box.around(prior, self.moments.mean, NEAR * self.moments.sd)
        x = box.points(data_sets, WITNESS_SEED)
        statistics = case.data_sets(prior.values(x), seed_of(WITNESS_SEED, range(data_sets)))
        scatter = self.surfaces.at(self.moments.mean[None])[1][0] / case.replicates
        distances = Mahalanobis(observed, 0.5 * (scatter + scatter.T))(statistics)
        near = np.argsort(distances, kind="stable")[:nearest]
        even = np.full(nearest, 1.0 / nearest)
        accepted = Accepted(prior.values(x[near]), even, statistics[near], distances[near], observed, box.prior(prior))
        values, weights, why = accepted.adjusted()
        return Moments.of(prior.coordinates(values), weights), why


def grown(case: Case, box: Box, count: int, seed: int) -> tuple[Box, Coordinates, Statistics]:
    """Single colonies at points of a box."""
    x = box.points(count, seed)
    return box, x, case.colonies(case.prior.values(x), seed_of(seed, range(count)))
