"""What curves can tell about λ: the Fisher information of log λ.

Mean curves y = m(λ) + noise, noise ~ N(0, Σ), J = ∂m / ∂log λ [curve, free]. A Gaussian prior of standard deviation τ_k
in log λ_k adds to what the data know (Kay 1993, Fundamentals of Statistical Signal Processing, section 3.9):

    F = JᵀWJ + diag(1 / τ²),    W = Σ⁻¹,    cov log λ̂ = F⁻¹.

**Noise of J.** J comes from a finite number of colonies. Its column i has errors with covariance N_i = D_i ρ D_i, where
D_i holds the standard errors and ρ their correlations over curves; columns are independent, as `sensitivity`'s design
is orthogonal. On average that noise adds tr(W N_i) to entry (i, i) of JᵀWJ, however little the data see. It goes:

    A = JᵀWJ − diag(tr(W N_i)).

What is left of it, and which directions the data do not see, is told by the result (`information_result`).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from yeastfit.errors import InputError
from yeastfit.inference.information.result import ROUNDING, Information
from yeastfit.inference.paired_regression import CurveSquare


def information(
    jacobian: Float[np.ndarray, "curve free"],
    covariance: CurveSquare,
    *,
    free: Sequence[str],
    error: Float[np.ndarray, "curve free"] | None = None,
    correlation: CurveSquare | None = None,
    prior: Mapping[str, float] | None = None,
    limit: float = 1.0,
) -> Information:
    """Fisher information of log λ in mean curves with covariance Σ (see above).

    jacobian: J. covariance: Σ, see `experiment`. free: names of J's columns. error: standard errors of J's
    entries, none by default; correlation: ρ, by default they are independent from curve to curve. prior: standard
    deviation in log λ by name. limit: error of log λ beyond which a direction is blind.

    Curves that neither scatter nor depend on λ are left out. Raises `InputError` for shapes that disagree, values that
    are not finite, a curve without variance that depends on λ, and a singular covariance.
    """
    names, prior = tuple(free), dict(prior or {})
    error = np.zeros_like(jacobian) if error is None else error
    correlation = np.eye(len(jacobian)) if correlation is None else correlation
    _check(jacobian, covariance, error, correlation, names, prior, limit)
    alive = ~_mute(jacobian, covariance, error)
    square = np.ix_(alive, alive)
    whiten = _inverse_root(covariance[square])
    whitened = whiten @ jacobian[alive]
    spread = np.einsum("ck,kf->fck", whiten, error[alive])
    noises = spread @ correlation[square] @ spread.transpose(0, 2, 1)
    bias = np.trace(noises, axis1=1, axis2=2)
    data = whitened.T @ whitened - np.diag(bias)
    return Information(names, data, np.einsum("icd,jdc->ij", noises, noises), prior, limit)


def _mute(jacobian: np.ndarray, covariance: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Curves that never vary; raises where such a curve depends on λ all the same."""
    mute = np.diag(covariance) <= 0
    contradicting = np.flatnonzero(mute & ((jacobian != 0) | (error != 0)).any(axis=1))
    if contradicting.size:
        raise InputError(
            f"covariance: curve {contradicting[0]} has no variance but depends on λ, it would tell it without error: "
            "give a measurement error"
        )
    return mute


def _inverse_root(covariance: CurveSquare) -> CurveSquare:
    """L⁻¹ of Σ = L Lᵀ, by way of the correlations."""
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    least = float(np.linalg.eigvalsh(correlation).min()) if len(correlation) else 1.0
    if least <= ROUNDING:
        raise InputError(
            f"covariance: the smallest eigenvalue of the correlations of {len(scale)} curves is {least:.1g}, it must "
            "be above 0: estimate it from more runs, leave out curves that repeat others, or give a measurement error"
        )
    return np.linalg.inv(np.linalg.cholesky(correlation)) / scale


def _check(
    jacobian: np.ndarray,
    covariance: np.ndarray,
    error: np.ndarray,
    correlation: np.ndarray,
    free: tuple[str, ...],
    prior: Mapping[str, float],
    limit: float,
) -> None:
    """Raises `InputError` where an argument makes no sense."""
    curves = len(jacobian)
    for name, values, shape in (
        ("jacobian", jacobian, (curves, len(free))),
        ("error", error, (curves, len(free))),
        ("covariance", covariance, (curves, curves)),
        ("correlation", correlation, (curves, curves)),
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
    for name, width in prior.items():
        if name not in free:
            raise InputError(f"prior names {name!r}, which is not free: {', '.join(free)} are")
        if not (np.isfinite(width) and width > 0):
            raise InputError(f"prior of {name} is {width}, its standard deviation in log λ must be above 0")
    if not limit > 0:
        raise InputError(f"limit is {limit}, it must be above 0")
