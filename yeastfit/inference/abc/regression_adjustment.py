"""Regression adjustment: where accepted draws would be, had each simulation been the observation.

Beaumont, Zhang & Balding 2002, doi:10.1093/genetics/162.4.2025. Of draws with weights w_i and distances d_i, by least
squares with weights W_i = w_i (1 − d_i²/δ²), δ the largest distance (Epanechnikov's kernel),

    u_i = α + (s_i − o)ᵀ β + error,    u_i* = α̂ + (u_i − α̂ − (s_i − o)ᵀ β̂) / √(1 − h_i),

o observed, s_i simulated; the u_i* have weights W_i. Residuals are shorter than errors by about √(1 − h_i), h_i the
leverage (MacKinnon & White 1985, doi:10.1016/0304-4076(85)90158-7); dividing by it gives few draws the right scatter.
u maps λ to the whole line, parameter by parameter, so that λ* stays in the prior's support a..b (Hamilton, Stoneking &
Excoffier 2005, doi:10.1073/pnas.0409071102):

    a > 0, b < ∞:  u = logit((log λ − log a) / (log b − log a))         a = 0, b = ∞:  u = log λ
    else finite:   u = logit((λ − a) / (b − a))                          one end:       u = ±log |λ − end|

Regression error shifts all adjusted draws together, most when the observation lies at the edge of the accepted
simulations: means over u* are less precise than over as many independent draws (`Accepted.worth`).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import expit, logit

from yeastfit.inference.prior.prior import Prior

ENOUGH = 4.0  # independent draws per coefficient: with fewer, the fit is noise
PARTS = 100  # blocks of the jackknife
ROUNDING = 1e-12  # of λ: smaller errors are rounding
LEAST = 0.01  # of 1 − h: a draw of more leverage has hardly a residual

Draws = Float[np.ndarray, "draw free"]
Weights = Float[np.ndarray, " draw"]


@dataclass(frozen=True)
class Accepted:
    """Draws that ABC accepted.

    Attributes:
        values: λ.
        weights: Sum to 1.
        statistics: Simulated with each draw.
        distances: From the data.
        observed: The data.
        prior: Of λ.
    """

    values: Draws
    weights: Weights
    statistics: Float[np.ndarray, "draw statistic"]
    distances: Float[np.ndarray, " draw"]
    observed: Float[np.ndarray, " statistic"]
    prior: Prior

    def adjusted(self) -> tuple[Draws, Weights, list[str]]:
        """λ* and their weights, or the draws as they are where too few lie near the data.

        Returns:
            Values, weights, and in words why the draws were not adjusted; empty where they were.
        """
        differences, weights = self.statistics - self.observed, self.weights
        if not differences.any():
            return self.values, weights, []
        largest = self.distances.max()
        near = weights * (1 - (self.distances / largest) ** 2) if largest > 0 else weights
        size = near.sum() ** 2 / np.sum(near**2) if near.any() else 0.0
        needed = ENOUGH * (1 + len(self.observed))
        if size < needed:
            why = f"not adjusted: {size:.0f} independent draws, a regression needs {needed:.0f}"
            return self.values, weights, [why]
        columns = list(zip(self.values.T, self.prior.support, strict=True))
        u = np.stack([to_line(one, *ends) for one, ends in columns], axis=1)
        scale = np.where(np.ptp(differences, axis=0) > 0, differences.std(axis=0), np.inf)
        design = np.column_stack([np.ones(len(differences)), differences / scale])
        root = np.sqrt(near)[:, None]
        inverse = np.linalg.pinv(root * design, rcond=len(design) * np.finfo(float).eps)
        fit, leverage = inverse @ (root * u), np.sum(root * design * inverse.T, axis=1)
        moved = fit[0] + (u - design @ fit) / np.sqrt(np.maximum(1 - leverage, LEAST))[:, None]
        adjusted = [from_line(one, *ends) for one, ends in zip(moved.T, self.prior.support, strict=True)]
        return np.stack(adjusted, axis=1), near / near.sum(), []

    def worth(self, parts: int = PARTS) -> Float[np.ndarray, " free"]:
        """Independent draws that would give the mean of λ with the same error as these do once they are adjusted.

            worth = (sd / error)²,    at most 1 / Σ W²,

        the error by block jackknife: consecutive draws are left out, block by block, and the others adjusted.

        Arguments:
            parts: Blocks; they must be independent of each other, such as chains. Independent draws have any.
        """
        values, near, _ = self.adjusted()
        sd = np.sqrt(near @ (values - near @ values) ** 2)
        parts = max(2, min(parts, len(near)))
        part, means = np.arange(len(near)) * parts // len(near), np.empty((parts, len(sd)))
        for k in range(parts):
            others = np.where(part == k, 0.0, self.weights)
            left, share, _ = replace(self, weights=others / (others.sum() or 1.0)).adjusted()
            means[k] = share @ left
        error, most = np.sqrt((parts - 1) * means.var(axis=0)), 1 / np.sum(near**2)
        some = error > ROUNDING * np.abs(self.values).max(axis=0)
        return np.clip(np.divide(sd, error, out=np.full_like(sd, np.inf), where=some) ** 2, 1.0, most)


def to_line(values: Float[np.ndarray, " draw"], low: float, high: float) -> Float[np.ndarray, " draw"]:
    """u of λ; finite inside the support."""
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
