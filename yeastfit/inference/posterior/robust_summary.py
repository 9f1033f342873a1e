"""How far two samples are from each other, and how wide one is, where a few draws may lie far from most.

A posterior may have a trail: a few per cent of the draws, many widths away from the others. It dominates variances and
outer quantiles. Shares of draws, and the normal scores Φ⁻¹ of shares, hardly depend on it.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import norm, rankdata

CENTRAL = np.array([0.16, 0.5, 0.84])  # of a normal distribution 68 % lie within one standard deviation of the mean
FAR = 5.0  # standard deviations: of a normal distribution one draw in two million lies farther off


def apart(one: Float[np.ndarray, "draw free"], other: Float[np.ndarray, "draw2 free"]) -> Float[np.ndarray, " free"]:
    """How far two samples are from each other, for each parameter, in standard deviations.

        max over p in `CENTRAL` of |Φ⁻¹(F(x_p)) − Φ⁻¹(p)|,

    x_p the p-quantile of one sample, F the share of the other that does not exceed it; the samples change places, and
    the larger value counts. For two normal distributions it is the shift of the mean in standard deviations, or the
    relative difference of their widths. It does not depend on the coordinates.

    Arguments:
        one: A sample.
        other: Another one of the same parameters.
    """
    ways = []
    for first, second in ((one, other), (other, one)):
        below = (second[:, None] <= np.quantile(first, CENTRAL, axis=0)).mean(axis=0)
        share = np.clip(below, 0.5 / len(second), 1.0 - 0.5 / len(second))
        ways.append(np.abs(norm.ppf(share) - norm.ppf(CENTRAL)[:, None]).max(axis=0))
    return np.maximum(*ways)


def covariance_of_most(draws: Float[np.ndarray, "draw free"]) -> Float[np.ndarray, "free free"]:
    """Covariance of the normal distribution whose central 68 % are as wide as the sample's.

    D R D,    D half the width of the central 68 % of each parameter, R the correlation of van der Waerden's scores
    """
    low, _, high = np.quantile(draws, CENTRAL, axis=0)
    scores = norm.ppf((rankdata(draws, axis=0) - 0.5) / len(draws))
    return np.outer(high - low, high - low) / 4 * np.atleast_2d(np.corrcoef(scores, rowvar=False))


def far_off(draws: Float[np.ndarray, "draw free"], of: Float[np.ndarray, "draw2 free"]) -> Bool[np.ndarray, " draw"]:
    """Which draws lie more than `FAR` half widths of the central 68 % of a sample from its median, in any parameter."""
    low, median, high = np.quantile(of, CENTRAL, axis=0)
    return (np.abs(draws - median) > FAR * 0.5 * (high - low)).any(axis=1)
