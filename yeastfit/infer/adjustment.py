"""Regression adjustment: where accepted draws would be, had each simulation been the observation.

Beaumont, Zhang & Balding 2002, doi:10.1093/genetics/162.4.2025. Of draws with weights w_i and distances d_i, by least
squares with weights W_i = w_i (1 − d_i²/δ²), δ the largest distance (Epanechnikov's kernel),

    u_i = α + (s_i − o)ᵀ β + error,    u_i* = u_i − (s_i − o)ᵀ β̂,

o observed, s_i simulated; the u_i* have weights W_i. u is a map of λ on the whole line, parameter by parameter, so that
λ* stays in the prior's support a..b (Hamilton, Stoneking & Excoffier 2005, doi:10.1073/pnas.0409071102):

    a > 0, b < ∞:  u = logit((log λ − log a) / (log b − log a))         a = 0, b = ∞:  u = log λ
    else finite:   u = logit((λ − a) / (b − a))                          one end:       u = ±log |λ − end|
"""

import numpy as np
from jaxtyping import Float
from scipy.special import expit, logit

from yeastfit.infer.priors import Prior

ENOUGH = 4.0  # independent draws per coefficient: with fewer, the fit is noise

Draws = Float[np.ndarray, "draw free"]
Weights = Float[np.ndarray, " draw"]


def adjusted(
    values: Draws,
    weights: Weights,
    statistics: Float[np.ndarray, "draw statistic"],
    distances: Float[np.ndarray, " draw"],
    observed: Float[np.ndarray, " statistic"],
    prior: Prior,
) -> tuple[Draws, Weights, list[str]]:
    """λ* and their weights; as they were, and why in words, where there are too few draws near the data."""
    apart = statistics - observed
    if not apart.any():
        return values, weights, []
    largest = distances.max()
    near = weights * (1 - (distances / largest) ** 2) if largest > 0 else weights
    size = near.sum() ** 2 / np.sum(near**2) if near.any() else 0.0
    needed = ENOUGH * (1 + statistics.shape[1])
    if size < needed:
        return values, weights, [f"not adjusted: {size:.0f} independent draws, a regression needs {needed:.0f}"]
    u = np.stack([to_line(one, *ends) for one, ends in zip(values.T, prior.support, strict=True)], axis=1)
    scale = np.where(np.ptp(apart, axis=0) > 0, apart.std(axis=0), np.inf)
    design = np.column_stack([np.ones(len(apart)), apart / scale])
    root = np.sqrt(near)[:, None]
    slopes = np.linalg.lstsq(root * design, root * u, rcond=None)[0][1:]
    moved = u - design[:, 1:] @ slopes
    found = np.stack([from_line(one, *ends) for one, ends in zip(moved.T, prior.support, strict=True)], axis=1)
    return found, near / near.sum(), []


def to_line(values: Float[np.ndarray, " draw"], low: float, high: float) -> Float[np.ndarray, " draw"]:
    """u of λ, see above; finite inside the support."""
    if np.isfinite(low) and np.isfinite(high):
        share = np.log(values / low) / np.log(high / low) if low > 0 else (values - low) / (high - low)
        return logit(np.clip(share, np.finfo(float).tiny, 1 - np.finfo(float).epsneg))
    if np.isfinite(low):
        return np.log(values - low)
    return -np.log(high - values) if np.isfinite(high) else values


def from_line(u: Float[np.ndarray, " draw"], low: float, high: float) -> Float[np.ndarray, " draw"]:
    """λ of u, the inverse of `to_line`."""
    if np.isfinite(low) and np.isfinite(high):
        inside = low * (high / low) ** expit(u) if low > 0 else low + (high - low) * expit(u)
        return np.clip(inside, low, high)  # what rounding carries past an end
    if np.isfinite(low):
        return low + np.exp(u)
    return high - np.exp(-u) if np.isfinite(high) else u
