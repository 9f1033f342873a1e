"""How far two samples are from each other, and how wide one is, where a few draws may lie far from most.

A posterior may have a trail: some per cent of the draws, many widths away from the others. Variances and outer
quantiles follow it wherever it goes; shares of draws hardly do, nor what is made of them by Φ⁻¹, normal scores.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import norm, rankdata

CENTRAL = np.array([0.16, 0.5, 0.84])  # 68 % lie within a standard deviation of a normal law's mean
FAR = 5.0  # standard deviations of a normal law, of which one draw in two million is farther off


def apart(one: Float[np.ndarray, "draw free"], other: Float[np.ndarray, "draw2 free"]) -> Float[np.ndarray, " free"]:
    """How far two samples are from each other, for each parameter, in standard deviations of a normal law.

    max over p in `CENTRAL` of |Φ⁻¹(F(x_p)) − Φ⁻¹(p)|, where x_p is the p-quantile of one sample and F the share of the
    other that is not above it; the larger value of both ways round. Of normal laws it is the shift of their means in
    standard deviations, or by what share one is wider than the other. It is the same in all coordinates.
    """
    ways = []
    for first, second in ((one, other), (other, one)):
        below = (second[:, None] <= np.quantile(first, CENTRAL, axis=0)).mean(axis=0)
        share = np.clip(below, 0.5 / len(second), 1.0 - 0.5 / len(second))
        ways.append(np.abs(norm.ppf(share) - norm.ppf(CENTRAL)[:, None]).max(axis=0))
    return np.maximum(*ways)


def covariance_of_most(draws: Float[np.ndarray, "draw free"]) -> Float[np.ndarray, "free free"]:
    """Covariance of a normal law; of another that of a normal one with as wide a middle.

    D R D, where D is half of what the central 68 % of each parameter span, and R the correlation of normal scores (van
    der Waerden's).
    """
    low, _, high = np.quantile(draws, CENTRAL, axis=0)
    scores = norm.ppf((rankdata(draws, axis=0) - 0.5) / len(draws))
    return np.outer(high - low, high - low) / 4 * np.atleast_2d(np.corrcoef(scores, rowvar=False))


def far_off(draws: Float[np.ndarray, "draw free"], of: Float[np.ndarray, "draw2 free"]) -> Bool[np.ndarray, " draw"]:
    """Which draws are in any parameter more than `FAR` halves of the central 68 % of a sample away from its median."""
    low, median, high = np.quantile(of, CENTRAL, axis=0)
    return (np.abs(draws - median) > FAR * 0.5 * (high - low)).any(axis=1)
