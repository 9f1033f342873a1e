"""One derivative from two estimates of it: an unbiased noisy one and a quiet biased one.

The unbiased estimate R is shrunk towards the quiet one P, for each observable,

    J = R + w (P − R),    w = min(V_R / (V_R + V_P), (p − 2) V_R / |P − R|²),

over the p parameters: the first is the blend of least variance where P has no bias, the second the factor of James and
Stein, which takes over as P and R disagree (Green & Strawderman 1991, doi:10.1080/01621459.1991.10475144; blends of
first- and zeroth-order gradients by their variances: Suh et al. 2022, arXiv:2202.00817). The mean squared error over
the p parameters is not above R's, whatever the bias of P is. With fewer than three parameters nothing of the kind
exists, and w is 0.
"""

import numpy as np

from yeastfit.inference.sensitivity.result import Estimate, Jacobian, Means


def combine(unbiased: Estimate, quiet: Estimate) -> tuple[Jacobian, Jacobian, Means]:
    """J, its errors and w. V_R and V_P are means over the parameters, squared distances likewise.

    The bias of P enters the error as what |P − R|² exceeds V_R + V_P by, and half the standard deviation of that.

    Arguments:
        unbiased: R.
        quiet: P; where it is not finite, J is R.
    """
    p = unbiased.jacobian.shape[-1]
    scale = np.where(unbiased.error > 0, unbiased.error, 1.0)  # in units of R's errors, where R has any
    apart = np.mean(((quiet.jacobian - unbiased.jacobian) / scale) ** 2, axis=-1)
    noise = np.mean((quiet.error / scale) ** 2, axis=-1)
    known = (unbiased.error > 0).all(axis=-1) & np.isfinite(apart) & np.isfinite(noise)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.minimum(1.0 / (1.0 + noise), (p - 2) / (p * apart))
    share = np.where(known & (p > 2), share, 0.0)
    bias = np.maximum(apart - 1.0 - noise, 0.0) + np.sqrt(0.5 / p) * (1.0 + noise)
    w, b = share[..., None], np.where(known, bias, 0.0)[..., None]
    path = np.where(known[..., None], quiet.jacobian, 0.0)
    path_error = np.where(known[..., None], quiet.error, 0.0)
    jacobian = unbiased.jacobian + w * (path - unbiased.jacobian)
    error = np.sqrt((1 - w) ** 2 * unbiased.error**2 + w**2 * (path_error**2 + b * scale**2))
    return jacobian, error, share
