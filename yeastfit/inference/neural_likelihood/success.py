"""Where simulations may fail: a quadratic for the logit of their success, which networks correct, and how wrong it is.

Given the terms φ(x) of a quadratic, P(success | x) = 1 / (1 + exp(−bᵀφ(x))), and b maximises

    Σ log P(outcome of row r | x_r) − ½ Σ_{k > 0} b_k².

The last term, a normal prior of all but the constant, keeps b finite where successes and failures can be told apart
exactly; beside hundreds of simulations it says nothing else.

**Misfit δ.** With y = 1 for success and 0 for failure, e = (y − P) / √(P (1 − P)) has variance 1 where P is right.
Where the logit is off by h, its mean is h √(P (1 − P)) to first order. δ is the mean square of a quadratic fitted to e,
less that of noise, as Δ is for the statistics (`cross_validation`).
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize
from scipy.special import expit, log_expit

LEAST = 1e-3  # P and 1 − P at least, where e is computed: a single surprise must not be all of δ


def quadratic_logit(
    features: Float[np.ndarray, "row feature"], came: Bool[np.ndarray, " row"]
) -> Float[np.ndarray, " feature"]:
    """b.

    Arguments:
        features: φ of each row, the constant first.
        came: Whether it succeeded.
    """
    sign, penalty = np.where(came, 1.0, -1.0), np.append(0.0, np.ones(features.shape[1] - 1))

    def loss(b: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (features @ b)
        value = 0.5 * (penalty * b) @ b - log_expit(margin).sum()
        return float(value), penalty * b - features.T @ (sign * expit(-margin))

    def curvature(b: np.ndarray) -> np.ndarray:
        share = expit(features @ b)
        return (features.T * (share * (1.0 - share))) @ features + np.diag(penalty)

    start = np.zeros(features.shape[1])
    share = (came.sum() + 0.5) / (len(came) + 1.0)
    start[0] = np.log(share / (1.0 - share))
    found: np.ndarray = minimize(loss, start, jac=True, hess=curvature, method="trust-exact").x
    return found


def success_misfit(
    probability: Float[np.ndarray, " row"], came: Bool[np.ndarray, " row"], features: Float[np.ndarray, "row feature"]
) -> float:
    """δ.

    Arguments:
        probability: P of each row, from what was not trained on it.
        came: Whether it succeeded.
        features: φ.
    """
    share = np.clip(probability, LEAST, 1.0 - LEAST)
    off = (came - share) / np.sqrt(share * (1.0 - share))
    basis = np.linalg.qr(features)[0]
    explained = np.sum((basis.T @ off) ** 2)
    left = (np.sum(off**2) - explained) / max(len(off) - basis.shape[1], 1)
    return float(max(explained - basis.shape[1] * left, 0.0) / len(off))
