"""Means of a simulator's rows and their derivatives from pairs of simulations around a point.

Pair k is simulated with one seed at θ ± s ε_k, θ the logarithms of the free parameters, s the spread, ε_k a row of a
randomly signed and permuted Hadamard matrix, so that all parameters vary at once and orthogonally. A parameter close to
its largest value has a smaller s of its own (`reaches`). With c_k half the sum and h_k half the difference of the two
rows,

    m = mean of c_k,        J = least squares of h_k on s ε_k.

What is even in ε, the curvature, cancels in J, whose bias is of order s² by third derivatives; it shifts m by
½ s² tr H. The errors of J are the scatter of h_k about the plane (Box & Hunter 1961,
doi:10.1080/00401706.1961.10489951).

**Scatter.** The two simulations of a pair share their seed, so they are not independent; but
cov y = cov c + cov h whatever they have in common, where c is taken less its mean and h less its slopes. Curvature adds
terms of order s⁴. cov c / pairs is the covariance of the Monte-Carlo errors of m, cov h / (pairs · s²) that of one
column of J.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from jaxtyping import Float

from yeastfit.errors import SimulationError
from yeastfit.inference.curve_covariance import Square
from yeastfit.inference.simulator import Rows
from yeastfit.parameter_set import ParameterSet

NARROWEST = 1 / 8  # of the spread: derivatives have eight times the error

Units = Float[np.ndarray, "pair entry"]
Reach = Float[np.ndarray, " entry"]


@dataclass(frozen=True)
class Scatter:
    """A covariance of rows, and the degrees of freedom it was estimated with."""

    covariance: Square
    freedom: float

    @classmethod
    def of_sum(cls, *parts: "Scatter") -> "Scatter":
        """Of a sum of independent numbers, from the scatter S_k of each, with Satterthwaite's degrees of freedom.

        ν = (tr S² + (tr S)²) / Σ_k (tr S_k² + (tr S_k)²) / ν_k in units of the sum's standard deviations, S = Σ S_k
        (Nel & van der Merwe 1986, doi:10.1080/03610928608829342): the sum of all ν_k where parts are alike, and ν of
        the only part that scatters.
        """
        covariance = np.sum([part.covariance for part in parts], axis=0)
        scale = _known(np.sqrt(np.diag(covariance)))

        def square(matrix: Square) -> float:
            scaled = matrix / np.outer(scale, scale)
            return float((scaled**2).sum() + np.trace(scaled) ** 2)

        spread = sum(square(part.covariance) / part.freedom for part in parts)
        return cls(covariance, square(covariance) / spread if spread > 0 else sum(part.freedom for part in parts))

    @property
    def correlation(self) -> Square:
        """1 on the diagonal and 0 beside it for a statistic that does not vary."""
        scale = _known(np.sqrt(np.diag(self.covariance)))
        found = self.covariance / np.outer(scale, scale)
        np.fill_diagonal(found, 1.0)
        return found


@dataclass(frozen=True)
class LocalModel:
    """Means around a point to first order.

    Attributes:
        mean: m.
        jacobian: J.
        error: Standard errors of its entries.
        between_pairs: Of c.
        within_pairs: Of h.
        pairs: Pairs that succeeded.
        scatter: Of one simulation.
    """

    mean: Float[np.ndarray, " observable"]
    jacobian: Float[np.ndarray, "observable entry"]
    error: Float[np.ndarray, "observable entry"]
    between_pairs: Scatter
    within_pairs: Scatter
    pairs: int
    scatter: Scatter

    @property
    def mean_covariance(self) -> Square:
        """Of the Monte-Carlo errors of `mean`."""
        return self.between_pairs.covariance / self.pairs


def hadamard_design(pairs: int, free: int, rng: np.random.Generator) -> Units:
    """Rows of ±1 with orthogonal columns: Hadamard matrices without their first column, signs and columns at random.

    Orthogonal where `pairs` is a multiple of `hadamard_order(free)`, and nearly so elsewhere.
    """
    size = hadamard_order(free)
    rows = scipy.linalg.hadamard(size)[:, 1:]
    blocks = [rows[:, rng.permutation(size - 1)[:free]] * rng.choice([-1, 1], free) for _ in range(-(-pairs // size))]
    return np.concatenate(blocks)[:pairs].astype(float)


def hadamard_order(free: int) -> int:
    """Rows of the smallest Hadamard matrix that has a column for each entry beside its first."""
    return 1 << free.bit_length()


def reaches(parameters: ParameterSet, values: Reach, spread: float) -> Reach:
    """How far pairs go from a point in log λ, by parameter: the spread, but not beyond its largest value.

    Where that is nearer than `NARROWEST` of the spread, and for a parameter that may be exceeded, it is the spread.
    """
    largest = np.array([np.inf if one.exceeded else one.largest for one in parameters.parameters])
    room = (1 - 1e-9) * np.log(largest / values)  # what is computed from it must not be beyond by the last bit
    return np.where(room >= NARROWEST * spread, np.minimum(room, spread), spread)


def paired_points(centre: Reach, units: Units, reach: Reach | float) -> Float[np.ndarray, "simulation entry"]:
    """Where the simulations of all pairs are made: first one of each, then the other."""
    return centre + reach * np.concatenate([units, -units])


def beyond_range(parameters: ParameterSet, values: Reach, spread: float) -> str:
    """In words, which parameters are simulated beyond their largest value in pairs; for errors, empty where none is."""
    told = [
        f"{one.name} is simulated up to {reached:.3g}, its largest is {one.largest:g}"
        for one, reached in zip(
            parameters.parameters, np.exp(reaches(parameters, values, spread)) * values, strict=True
        )
        if reached > one.largest and not one.exceeded
    ]
    if not told:
        return ""
    return f"; in pairs around it, {' and '.join(told)}: hold it, or take a posterior, which has no pairs"


def regress(rows: Rows, units: Units, reach: Reach | float) -> LocalModel:
    """Mean and derivative from simulations at `paired_points`.

    Arguments:
        rows: Of the simulations; pairs with a value that is not finite are left out.
        units: ε.
        reach: s, one for all parameters or one for each.

    Raises:
        SimulationError: More than half of the pairs are left out, or those that remain do not tell all entries apart.
    """
    up, down = rows[: len(units)], rows[len(units) :]
    half, middle = 0.5 * (up - down), 0.5 * (up + down)
    good = np.isfinite(half).all(axis=1)
    if good.sum() < 0.5 * len(good):
        raise SimulationError(f"{(~good).sum()} of {len(good)} pairs of simulations failed (not finite)")
    steps = reach * units[good]
    slopes, _, rank, _ = np.linalg.lstsq(steps, half[good], rcond=None)
    if rank < units.shape[1]:
        raise SimulationError(
            f"{good.sum()} pairs of simulations are too few for {units.shape[1]} parameters: make more"
        )
    rest = half[good] - steps @ slopes
    freedom = max(1, int(good.sum()) - units.shape[1])
    error = np.sqrt(np.outer((rest**2).sum(axis=0) / freedom, np.diag(np.linalg.inv(steps.T @ steps))))
    within, between = Scatter(rest.T @ rest / freedom, freedom), sample_scatter(middle[good])
    scatter = Scatter.of_sum(between, within)
    return LocalModel(middle[good].mean(axis=0), slopes.T, error, between, within, int(good.sum()), scatter)


def regress_averaged(rows: Sequence[Rows], units: Units, reach: Sequence[Reach]) -> LocalModel:
    """`regress` around the middle of several points close to each other, where the same pairs were simulated.

    The rows of a pair are averaged over the points before pairs are compared: so the errors are right whatever a pair
    has in common from point to point, and smaller than those of one point where simulations are chaotic. `scatter` is
    the mean over points, with the degrees of freedom of one.
    """
    found = [regress(each, units, one) for each, one in zip(rows, reach, strict=True)]
    if len(found) == 1:
        return found[0]
    averaged = regress(np.mean(rows, axis=0), units, np.mean(reach, axis=0))
    covariance = np.mean([local.scatter.covariance for local in found], axis=0)
    return replace(averaged, scatter=Scatter(covariance, min(local.scatter.freedom for local in found)))


def sample_scatter(rows: Rows) -> Scatter:
    """Covariance of the finite rows among independent simulations, and its degrees of freedom."""
    good = rows[np.isfinite(rows).all(axis=1)]
    rest = good - good.mean(axis=0) if len(good) else good
    freedom = max(1, len(good) - 1)
    return Scatter(rest.T @ rest / freedom, freedom)


def pooled_covariance(independent: Scatter, pairs: Scatter) -> Square:
    """S of independent simulations and pairs, by their degrees of freedom: (ν₀ S₀ + ν S) / (ν₀ + ν)."""
    whole = independent.freedom * independent.covariance + pairs.freedom * pairs.covariance
    return whole / (independent.freedom + pairs.freedom)


def _known(scale: Float[np.ndarray, " entry"]) -> Float[np.ndarray, " entry"]:
    """1 for what does not vary."""
    return np.where(scale > 0, scale, 1.0)
