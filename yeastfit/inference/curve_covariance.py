"""Covariances of mean curves, and what has unit variance under them.

Means over R replicates scatter with S / R, S the covariance of one replicate. What they are compared with may scatter
too, and measuring adds errors that replicates do not average out.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.numbers import array_of
from yeastfit.observable import Observable

ROUNDING = 1e-10  # of the largest eigenvalue: smaller ones are rounding errors

Square = Float[np.ndarray, "observable observable"]


def mean_covariance(
    scatter: Square,
    *,
    replicates: float | Float[np.ndarray, " observable"],
    members: float = np.inf,
    freedom: float = np.inf,
) -> Square:
    """Covariance of means over replicates, compared with an ensemble's.

        Σ_kl = S_kl h (1 / max(R_k, R_l) + 1 / members),    h = ν / (ν − n − 1)

    Arguments:
        scatter: S, of one replicate's n values.
        replicates: R, behind each mean: one number, or one for each. Those behind a mean with fewer are among those
            behind a mean with more.
        members: Of the ensemble that the data are compared with.
        freedom: ν, degrees of freedom that S was estimated with; its inverse is too large by h on average (Hartlap et
            al. 2007, doi:10.1051/0004-6361:20066170).

    Raises:
        InputError: R or members is not above 0, or there are too few degrees of freedom.
    """
    count = len(scatter)
    behind = np.broadcast_to(array_of(replicates, "replicates"), count)
    if not (behind > 0).all():
        raise InputError(f"replicates is {replicates}, every mean needs more than 0")
    if isinstance(members, str) or not members > 0:
        raise InputError(f"members is {members}, it must be above 0")
    if freedom <= count + 1:
        raise InputError(
            f"freedom is {freedom:g}: the covariance of {count} means needs more than {count + 1} degrees of freedom, "
            "so more runs, or fewer statistics and times"
        )
    inflation = 1.0 if np.isinf(freedom) else freedom / (freedom - count - 1)
    return inflation * scatter * (1.0 / np.maximum(behind[:, None], behind) + 1.0 / members)


def measurement_covariance(
    observables: Sequence[Observable], mean: Float[np.ndarray, " observable"], relative: float | Mapping[str, float]
) -> Square:
    """Covariance of a relative error of every mean, half of its variance common to all times of a statistic.

    Arguments:
        observables: What the means are of.
        mean: The means.
        relative: The error: one number, or one for each statistic.

    Raises:
        InputError: An error is below 0 or above 1, or a statistic has none.
    """
    statistics = [one.statistic for one in observables]
    if isinstance(relative, Mapping) and (missing := [name for name in statistics if name not in relative]):
        raise InputError(f"measurement_error is of {', '.join(relative) or 'nothing'}, {missing[0]} needs one, too")
    each = [relative[name] if isinstance(relative, Mapping) else relative for name in statistics]
    shares = array_of(each, "measurement_error")
    if not ((shares >= 0) & (shares <= 1)).all():
        raise InputError(f"measurement_error is {relative}, it must be at least 0, and at most 1, which is 100 %")
    error = shares * mean
    same = np.array([[one == other for other in statistics] for one in statistics], dtype=float)
    return 0.5 * same.reshape(len(error), -1) * np.outer(error, error) + 0.5 * np.diag(error**2)


def correlation_root(
    covariance: Square, *, argument: str, of: str, advice: str
) -> tuple[Float[np.ndarray, " observable"], Square]:
    """Standard deviations s and lower triangular C with Σ = diag(s) C Cᵀ diag(s), C Cᵀ the correlations.

    Arguments:
        covariance: Σ.
        argument: For the error: where Σ came from.
        of: For the error: whose correlations they are.
        advice: For the error: what would be right.

    Raises:
        InputError: The correlations are singular.
    """
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    least = float(np.linalg.eigvalsh(correlation).min()) if len(correlation) else 1.0
    if not least > ROUNDING:
        raise InputError(
            f"{argument}: the smallest eigenvalue of the correlations of {of} is {least:.1g}, it must be above "
            f"{ROUNDING:g}: {advice}"
        )
    return scale, np.linalg.cholesky(correlation)


def whitened(root: Square, values: Float[np.ndarray, "observable *more"]) -> Float[np.ndarray, "observable *more"]:
    """L⁻¹ x, of unit variance where x has the covariance L Lᵀ and L is lower triangular."""
    return scipy.linalg.solve_triangular(root, values, lower=True)
