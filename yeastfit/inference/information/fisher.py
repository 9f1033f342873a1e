"""What mean curves can tell about λ: the Fisher information of log λ.

Means y = m(λ) + noise, noise ~ N(0, Σ), J = ∂m / ∂log λ. A Gaussian prior of standard deviation τ_k in log λ_k adds to
what the data know (Kay 1993, Fundamentals of Statistical Signal Processing, section 3.9):

    F = JᵀWJ + diag(1 / τ²),    W = Σ⁻¹,    cov log λ̂ = F⁻¹.

**Noise of J.** J comes from a finite number of simulations. Its column i has errors with covariance N_i = D_i ρ D_i,
where D_i holds the standard errors and ρ their correlations over the means; columns are independent, as the design of a
`sensitivity` is orthogonal. On average that noise adds tr(W N_i) to entry (i, i) of JᵀWJ, however little the data see.
It is taken out:

    A = JᵀWJ − diag(tr(W N_i)).

`information.result` tells the noise that is left from what the data see.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.curve_covariance import Square, correlation_root
from yeastfit.inference.information.result import Information
from yeastfit.kinds import check_kind
from yeastfit.numbers import POSITIVE

Jacobian = Float[np.ndarray, "observable free"]


def information(
    jacobian: Jacobian,
    covariance: Square,
    *,
    free: Sequence[str],
    error: Jacobian | None = None,
    correlation: Square | None = None,
    prior: Mapping[str, float] | None = None,
    limit: float = 1.0,
) -> Information:
    """Fisher information of log λ in means with covariance Σ.

    Means that neither scatter nor depend on λ are left out.

    Arguments:
        jacobian: J.
        covariance: Σ, see `curve_covariance`.
        free: Names of J's columns.
        error: Standard errors of J's entries, none by default.
        correlation: ρ; by default errors are independent.
        prior: Standard deviation of log λ, by name.
        limit: Error of log λ beyond which a direction is blind.

    Returns:
        What the means determine, direction by direction.

    Raises:
        InputError: Shapes disagree, values are not finite, a mean without variance depends on λ, or Σ is singular.
    """
    names, prior = tuple(free), checked_widths(prior)
    error = np.zeros_like(jacobian) if error is None else error
    correlation = np.eye(len(jacobian)) if correlation is None else correlation
    _check(jacobian, covariance, error, correlation, names, prior, limit)
    alive = ~_mute(jacobian, covariance, error)
    square = np.ix_(alive, alive)
    advice = "estimate it from more runs, leave out means that repeat others, or give a measurement error"
    of = f"{alive.sum()} means"
    scale, root = correlation_root(covariance[square], argument="covariance", of=of, advice=advice)
    whiten = np.linalg.inv(root) / scale
    whitened = whiten @ jacobian[alive]
    spread = np.einsum("ck,kf->fck", whiten, error[alive])
    noises = spread @ correlation[square] @ spread.transpose(0, 2, 1)
    bias = np.trace(noises, axis1=1, axis2=2)
    data = whitened.T @ whitened - np.diag(bias)
    return Information(names, data, np.einsum("icd,jdc->ij", noises, noises), prior, limit)


def _mute(jacobian: np.ndarray, covariance: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Means that never vary. Raise `InputError` where such a mean depends on λ all the same."""
    mute = np.diag(covariance) <= 0
    contradicting = np.flatnonzero(mute & ((jacobian != 0) | (error != 0)).any(axis=1))
    if contradicting.size:
        raise InputError(
            f"covariance: mean {contradicting[0]} has no variance but depends on λ, it would tell it without error: "
            "give a measurement error"
        )
    return mute


def checked_widths(prior: Mapping[str, float] | None) -> dict[str, float]:
    """Standard deviations of log λ by name. Raises `InputError` where one is not above 0."""
    check_kind("prior", {} if prior is None else prior, Mapping, "standard deviations of log λ, by parameter")
    return {name: POSITIVE.check(width, f"prior of {name}") for name, width in (prior or {}).items()}


def _check(
    jacobian: np.ndarray,
    covariance: np.ndarray,
    error: np.ndarray,
    correlation: np.ndarray,
    free: tuple[str, ...],
    prior: Mapping[str, float],
    limit: float,
) -> None:
    """Raise `InputError` where an argument makes no sense."""
    means = len(jacobian)
    for name, values, shape in (
        ("jacobian", jacobian, (means, len(free))),
        ("error", error, (means, len(free))),
        ("covariance", covariance, (means, means)),
        ("correlation", correlation, (means, means)),
    ):
        if values.shape != shape:
            raise InputError(f"{name} has shape {values.shape}, with {len(free)} free parameters it must be {shape}")
        if not np.isfinite(values).all():
            raise InputError(f"{name} holds {np.sum(~np.isfinite(values))} values that are not finite")
    if not free or len(set(free)) != len(free):
        raise InputError(f"free is {list(free)}, it must name at least one parameter, each once")
    if not np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-12 * np.abs(covariance).max(initial=0.0)):
        raise InputError("covariance is not symmetric")
    if (error < 0).any():
        raise InputError(f"error holds {error.min():g}, standard errors are at least 0")
    for name in prior:
        if name not in free:
            raise InputError(f"prior names {name!r}, which is not free: {', '.join(free)} are")
    POSITIVE.check(limit, "limit")
