"""Mean curves and their derivatives from pairs of colonies around a point.

Pair k is grown with one key at θ ± s ε_k, θ the entries of log λ that are free, s the spread, ε_k a row of a randomly
signed and permuted Hadamard matrix, so that all entries vary at once and orthogonally. With c_k half the sum and h_k
half the difference of the two curves,

    m = mean of c_k,        J = least squares of h_k on s ε_k.

What is even in ε, the curvature, cancels in J, whose bias is of order s² by third derivatives; it shifts m by
½ s² tr H. J's errors are what h_k scatters around the plane (Box & Hunter 1961, doi:10.1080/00401706.1961.10489951).

**Scatter.** The two of a pair share their key, so they are not independent; but cov y = cov c + cov h whatever they
have in common, where c is left without its mean and h without its slopes. What curvature adds is of order s⁴.
cov c / pairs is the covariance of m's Monte-Carlo errors, cov h / (pairs · s²) that of one column of J over curves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg import hadamard

from yeastfit.errors import InputError

CurveSquare = Float[np.ndarray, "curve curve"]


@dataclass(frozen=True)
class Scatter:
    """A covariance over curves, and the degrees of freedom it was estimated with."""

    covariance: CurveSquare
    freedom: int

    @property
    def correlation(self) -> CurveSquare:
        """1 on the diagonal and 0 beside it for a curve that does not vary."""
        scale = np.sqrt(np.diag(self.covariance))
        known = np.where(scale > 0, scale, 1.0)
        found = self.covariance / np.outer(known, known)
        np.fill_diagonal(found, 1.0)
        return found


@dataclass(frozen=True)
class Local:
    """Mean curves around a point to first order.

    error: standard errors of J's entries. common, apart: of c and h. pairs: that came out. scatter: of one colony.
    """

    mean: Float[np.ndarray, " curve"]
    jacobian: Float[np.ndarray, "curve entry"]
    error: Float[np.ndarray, "curve entry"]
    common: Scatter
    apart: Scatter
    pairs: int
    scatter: Scatter

    @property
    def mean_covariance(self) -> CurveSquare:
        """Of the Monte-Carlo errors of `mean`."""
        return self.common.covariance / self.pairs


def design(pairs: int, free: int, rng: np.random.Generator) -> Float[np.ndarray, "pair entry"]:
    """Rows of ±1 with orthogonal columns: Hadamard matrices without their first column, signs and columns at random.

    Orthogonal where pairs is a multiple of `order(free)`, and nearly so elsewhere.
    """
    size = order(free)
    rows = hadamard(size)[:, 1:]
    blocks = [rows[:, rng.permutation(size - 1)[:free]] * rng.choice([-1, 1], free) for _ in range(-(-pairs // size))]
    return np.concatenate(blocks)[:pairs].astype(float)


def order(free: int) -> int:
    """Rows of the smallest Hadamard matrix that has a column for each entry beside its first."""
    return 1 << free.bit_length()


def paired(
    centre: Float[np.ndarray, " entry"], units: Float[np.ndarray, "pair entry"], spread: float
) -> Float[np.ndarray, "colony entry"]:
    """Where the colonies of all pairs are grown: first one of each, then the other."""
    return centre + spread * np.concatenate([units, -units])


def regress(curves: Float[np.ndarray, "colony curve"], units: Float[np.ndarray, "pair entry"], spread: float) -> Local:
    """The mean and its derivative from colonies grown at `paired` points.

    Pairs with a value that is not finite are left out. Raises `InputError` where more than half of them are.
    """
    up, down = curves[: len(units)], curves[len(units) :]
    half, middle = 0.5 * (up - down), 0.5 * (up + down)
    good = np.isfinite(half).all(axis=1)
    if good.sum() < 0.5 * len(good):
        raise InputError(f"{(~good).sum()} of {len(good)} pairs of colonies came to nothing (not finite): lower dt")
    steps = spread * units[good]
    slopes, _, _, _ = np.linalg.lstsq(steps, half[good], rcond=None)
    rest = half[good] - steps @ slopes
    freedom = max(1, int(good.sum()) - units.shape[1])
    error = np.sqrt(np.outer((rest**2).sum(axis=0) / freedom, np.diag(np.linalg.inv(steps.T @ steps))))
    apart, common = Scatter(rest.T @ rest / freedom, freedom), of_members(middle[good])
    scatter = Scatter(common.covariance + apart.covariance, common.freedom + freedom)
    return Local(middle[good].mean(axis=0), slopes.T, error, common, apart, int(good.sum()), scatter)


def regress_together(
    curves: Sequence[Float[np.ndarray, "colony curve"]], units: Float[np.ndarray, "pair entry"], spread: float
) -> Local:
    """`regress` around the middle of several points close to each other, where the same pairs were grown.

    A pair's curves are averaged over the points before they are compared with other pairs': so the errors are right
    whatever a pair has in common from point to point, and smaller than those of one point where chaos sets in.
    scatter is the mean over points, with the degrees of freedom of one.
    """
    found = [regress(each, units, spread) for each in curves]
    if len(found) == 1:
        return found[0]
    together = regress(np.mean(curves, axis=0), units, spread)
    covariance = np.mean([local.scatter.covariance for local in found], axis=0)
    return replace(together, scatter=Scatter(covariance, min(local.scatter.freedom for local in found)))


def of_members(curves: Float[np.ndarray, "member curve"]) -> Scatter:
    """Covariance of what is finite among independent colonies, and its degrees of freedom."""
    good = curves[np.isfinite(curves).all(axis=1)]
    rest = good - good.mean(axis=0) if len(good) else good
    freedom = max(1, len(good) - 1)
    return Scatter(rest.T @ rest / freedom, freedom)


def pooled(alone: Scatter, common: Scatter, apart: Scatter) -> CurveSquare:
    """S of independent colonies and of pairs together: (ν₀ S₀ + ν (S_c + S_h)) / (ν₀ + ν), ν = ν_c + ν_h."""
    freedom = common.freedom + apart.freedom
    whole = alone.freedom * alone.covariance + freedom * (common.covariance + apart.covariance)
    return whole / (alone.freedom + freedom)
